"""Units given to workers, some of which die, fail or are stopped."""

import os
import signal
import time
from contextlib import closing
from pathlib import Path

import pytest

from gapeval.sweep.executor import WorkerDiedError, in_processes, in_this_process, results
from gapeval.sweep.units import Span, StoppedError, Unit

UNITS = [Unit(Span(0, number, number + 1), ()) for number in range(12)]


def number_of(unit):
    return unit.span.first


def work(task, unit, stopped):
    """Task: folder, in which each attempt at a unit leaves a line; units that kill; units that raise."""
    folder, deadly, wrong = task
    with (folder / str(number_of(unit))).open("a") as file:
        file.write(f"{os.getpid()}\n")
    if number_of(unit) in deadly:
        os.kill(os.getpid(), signal.SIGKILL)
    if number_of(unit) in wrong:
        raise ValueError(f"unit {number_of(unit)}")
    return str(number_of(unit)).encode()


def until_stopped(task, unit, stopped):
    """Goes on until it is told to stop."""
    (task / f"begun {number_of(unit)}").touch()
    while not stopped():
        time.sleep(0.01)
    (task / f"stopped {number_of(unit)}").touch()
    raise StoppedError


def attempts(folder):
    return {int(path.name): len(path.read_text().splitlines()) for path in folder.iterdir()}


@pytest.mark.parametrize("jobs", [1, 3])
def test_what_a_unit_raises_is_its_own_affair(tmp_path, jobs):
    task = (tmp_path, (), (2, 5))
    workers = in_processes(work, task, jobs) if jobs > 1 else in_this_process(work, task)
    found = {number_of(one.unit): one for one in results(workers, UNITS)}
    assert sorted(found) == list(range(12))
    assert {number for number, one in found.items() if one.error} == {2, 5}
    assert str(found[5].error) == "unit 5"
    assert all(one.made == str(number).encode() for number, one in found.items() if not one.error)
    assert set(attempts(tmp_path).values()) == {1}


@pytest.mark.parametrize("deadly", [(4,), (0, 11), (3, 4, 5)])
def test_a_unit_that_kills_its_worker_is_found_and_the_others_are_done(tmp_path, deadly):
    workers = in_processes(work, (tmp_path, deadly, (7,)), 3)
    found = {number_of(one.unit): one for one in results(workers, UNITS)}
    assert sorted(found) == list(range(12))
    died = {number for number, one in found.items() if isinstance(one.error, WorkerDiedError)}
    assert died == set(deadly)
    assert "fewer --jobs" in str(found[deadly[0]].error)
    assert isinstance(found[7].error, ValueError)
    assert all(one.made == str(number).encode() for number, one in found.items() if not one.error)


def test_results_come_as_they_are_finished_and_few_are_in_hands(tmp_path):
    for one in results(in_processes(work, (tmp_path, (), ()), 2), UNITS):
        assert len(attempts(tmp_path)) <= 12
        assert one.error is None
        break
    assert len(attempts(tmp_path)) < 12


def test_leaving_stops_workers_in_the_middle_of_their_units(tmp_path: Path):
    with closing(results(in_processes(until_or_first, tmp_path, 2), UNITS)) as found:
        assert next(found).made == b"first"
    begun, stopped = (
        {path.name.split()[1] for path in tmp_path.glob(f"{what} *")} for what in ("begun", "stopped")
    )
    assert begun == stopped
    assert len(begun) <= 4


def until_or_first(task, unit, stopped):
    return b"first" if number_of(unit) == 0 else until_stopped(task, unit, stopped)
