"""scripts/bench on tiny clouds: what it says adds up. No times are judged."""

import json
import operator
import os
import sys
from dataclasses import replace

import bench
import numpy as np
import pytest
from bench_figures import PARTS, Skipped, Target, figure, line
from bench_logs import ONE, Kind, in_the_box
from bench_parts import PART, QUICK, one_core
from bench_process import took

GRID = {"k": (4, 5), "delta_r": (1.1,), "n_o": (0, 1), "pl_th": (0.1,)}
# One frame once: then a ratio of medians is the median of ratios.
EFFORT = replace(
    QUICK,
    frames=1,
    repetitions=1,
    points=(1000, 2000, 4000),
    sizes=(1, 2, 4),
    grid=GRID,
    large=GRID,
    compared=(20, 10),
)
IN_PROCESS = ["a", "b", "c", "d", "g", "i", "j", "k"]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("GAPEVAL_DATA", raising=False)
        kind = Kind(sensor="vlp16", points=20000, boxed=2000)
        return bench.prepared(tmp_path_factory.mktemp("bench"), kind, EFFORT)


@pytest.fixture(scope="module")
def found(prepared):
    whole = {"header": bench.header(prepared)} | bench.as_json(bench.measured(prepared, IN_PROCESS))
    return json.loads(json.dumps(whole, allow_nan=False))


def median(found, part, log, name):
    (one,) = [f for f in found["figures"] if (f["part"], f["log"], f["name"]) == (part, log, name)]
    return one["median"]


def test_every_part_is_there_on_every_log(found) -> None:
    assert set(PART) == set(PARTS)
    skipped = {one["part"] for one in found["skipped"]}
    measured = {(one["part"], one["log"]) for one in found["figures"]}
    for part in set(IN_PROCESS) - skipped:
        for log in {"g": ("simulated",), "j": ("",), "k": ("simulated",)}.get(part, ("simulated", "dense")):
            assert (part, log) in measured
    assert set(found["header"]["logs"]) == {"simulated", "dense"}
    assert "GAPEVAL_DATA is not set" in found["header"]["real"]
    assert all(bench.header_lines(found["header"]))


def test_figures_have_range_and_verdict(found) -> None:
    judged = 0
    for one in found["figures"]:
        assert one["samples"] > 0
        assert one["p5"] <= one["median"] <= one["p95"]
        for target in one["targets"]:
            compare = {"<=": operator.le, "<": operator.lt, ">=": operator.ge}[target["comparison"]]
            assert target["met"] is compare(one["median"], target["value"])
            judged += 1
    assert judged >= 8


def test_dense_clouds_have_the_points_that_were_asked_for(prepared, found) -> None:
    dense = prepared.logs[1]
    assert found["header"]["logs"]["dense"]["points"] == [20000] * 3
    boxed = int(in_the_box(dense.frames[0], dense.grid(ONE)[0].detector).sum())
    assert boxed == pytest.approx(2000, abs=2)  # written and read, a point may cross the edge of the box


@pytest.mark.parametrize("part", ["b", "c"])
@pytest.mark.parametrize("log", ["simulated", "dense"])
def test_ratios_and_steps_add_up(found, part, log) -> None:
    together, singly = (median(found, part, log, name) for name in ("together", "one by one"))
    assert median(found, part, log, "one by one / together") == pytest.approx(singly / together)
    of_step = [
        one["median"]
        for one in found["figures"]
        if (one["part"], one["log"], one["unit"]) == (part, log, "us/config")
    ]
    assert sum(of_step) == pytest.approx(together * 1e3)
    assert min(of_step) >= 0


def test_growth_is_that_of_its_figures(found) -> None:
    times = [median(found, "g", "simulated", f"N_P {n:,}: detect + assess") for n in EFFORT.points]
    r2 = np.corrcoef(EFFORT.points, times)[0, 1] ** 2
    assert median(found, "g", "simulated", "straight line: R2") == pytest.approx(r2)
    each = [median(found, "g", "simulated", f"{n} configurations") for n in EFFORT.sizes]
    assert median(found, "g", "simulated", "4 / 2, per configuration") == pytest.approx(each[2] / each[1])


def test_a_target_is_judged_by_the_median() -> None:
    assert Target("<=", 2.5).met(2.5)
    assert not Target("<", 2.5).met(2.5)
    assert not Target(">=", 6).met(5.9)
    text = line(figure("a", "", "some", "ms", [1.0, 2.0, 90.0], ("<=", 2.5), ("<=", 1.0)))
    assert "<= 2.5 met; <= 1 not met" in text
    assert [v["met"] for v in figure("h", "", "some", "MB", [3.0], ("<", 3.0)).verdicts()] == [False]


def test_what_is_skipped_is_said(prepared, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pypatchworkpp", None)
    assert list(PART["i"](prepared)) == [Skipped("i", "pypatchworkpp is not installed here")]


def test_a_process_and_its_own_are_measured() -> None:
    hungry = "b = bytearray([1]) * 300_000_000"
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {hungry!r}])"
    measured = took(sys.executable, "-c", parent)
    assert 300e6 <= measured.peak < 600e6
    assert measured.cpu > 0
    with pytest.raises(RuntimeError, match="no such thing"):
        took(sys.executable, "-c", "raise SystemExit('no such thing')")


def test_the_cores_are_given_back() -> None:
    if not hasattr(os, "sched_getaffinity"):
        pytest.skip("no affinity here")
    before = os.sched_getaffinity(0)
    with one_core():
        assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == before
