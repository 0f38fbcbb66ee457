"""Sweeps on a Dask cluster of real processes on this machine."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from command import gapeval
from small_logs import drive, labels
from sweeps import GRID, MANY, begun, bytes_of, parts_of, wait_for

import gapeval as package
from gapeval.errors import ConfigError
from gapeval.sweep.cluster import differing, log_facts, scheduler_address

FOREVER = 120  # s, until a test gives up
CHANGED = "UNITS = 64"  # of units.py


def dask(what: str, *arguments: object, **environment: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "distributed.cli.dask_" + what, *map(str, arguments), "--no-dashboard"]
    return subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env=os.environ | environment,
        cwd="/",  # where no other gapeval lies
    )


def end(process: "subprocess.Popen[str]", number: int = signal.SIGKILL) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)
    process.wait()


@contextlib.contextmanager
def scheduler(folder: Path) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """Its address, HOST:PORT."""
    file = folder / "scheduler.json"
    process = dask("scheduler", "--host", "127.0.0.1", "--port", 0, "--scheduler-file", file)
    try:
        deadline = time.monotonic() + FOREVER
        address = ""
        while not address:
            assert process.poll() is None
            assert time.monotonic() < deadline
            with contextlib.suppress(OSError, ValueError):
                address = json.loads(file.read_text())["address"]
            time.sleep(0.05)
        yield address.removeprefix("tcp://"), process
    finally:
        end(process)


@contextlib.contextmanager
def worker(address: str, folder: Path, *arguments: object, **environment: str) -> Iterator[int]:
    """A worker that the scheduler knows; how many there are now."""
    from distributed import Client

    process = dask("worker", f"tcp://{address}", "--local-directory", folder, *arguments, **environment)
    try:
        with Client(f"tcp://{address}", set_as_default=False) as client:
            deadline = time.monotonic() + FOREVER
            before = 0
            while not before or process.poll() is not None:
                assert time.monotonic() < deadline
                before = len(client.nthreads())
                time.sleep(0.05)
        yield before
    finally:
        end(process)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A worker of three threads."""
    folder = tmp_path_factory.mktemp("cluster")
    with scheduler(folder) as (address, _), worker(address, folder, "--nthreads", 3):
        yield f"dask://{address}"


def swept(*arguments: object, **options: object) -> tuple[int, str]:
    """Status and last line."""
    process = begun(*arguments, **options)
    _, errors = process.communicate(timeout=600)
    assert "Traceback" not in errors
    return process.returncode, errors.rstrip().rpartition("\n")[2]


def test_a_cluster_gives_the_same_bytes_and_parts(tmp_path: Path, cluster: str) -> None:
    drive(tmp_path / "a.mcap", 5)
    drive(tmp_path / "b", 3, "sqlite3", seed=1)
    labels(tmp_path / "labels.geojson")
    asked = ("a.mcap", "b", "--labels", "labels.geojson", *GRID)
    status, line = swept(*asked, "-o", "cluster", "--executor", cluster, cwd=tmp_path)
    assert status == 0, line
    status, line = swept(*asked, "-o", "here", "--jobs", 2, cwd=tmp_path)
    assert status == 0, line
    assert bytes_of(tmp_path / "cluster") == bytes_of(tmp_path / "here")
    assert parts_of(tmp_path / "cluster").keys() == parts_of(tmp_path / "here").keys()


def test_what_a_cluster_began_is_finished_without_it(tmp_path: Path) -> None:
    """The scheduler is killed in the middle."""
    log, drawn = drive(tmp_path / "drive.mcap", 12), labels(tmp_path / "labels.geojson")
    out, asked = tmp_path / "out", (log, "--labels", drawn, *MANY)
    with (
        scheduler(tmp_path) as (address, process),
        worker(address, tmp_path, "--nthreads", 1),
    ):
        sweep = begun(*asked, "-o", out, "--executor", f"dask://{address}")
        wait_for(lambda: len(parts_of(out)) >= 2, sweep)
        end(process)
        _, errors = sweep.communicate(timeout=FOREVER)
    assert sweep.returncode == 1
    last = errors.rstrip().rpartition("\n")[2]
    assert last.startswith(f"gapeval: --executor dask://{address}: lost the connection to the cluster")
    assert "Traceback" not in errors, errors
    there = parts_of(out)
    assert 2 <= len(there) < 12
    assert gapeval("sweep", "--resume", out).status == 0
    assert {name: parts_of(out)[name] for name in there} == there
    assert gapeval("sweep", *asked, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


def test_a_cluster_is_left_when_interrupted(tmp_path: Path, cluster: str) -> None:
    log, out = drive(tmp_path / "drive.mcap", 40), tmp_path / "out"
    sweep = begun(log, *MANY, "-o", out, "--executor", cluster)
    wait_for(lambda: len(parts_of(out)) >= 1, sweep)
    os.killpg(sweep.pid, signal.SIGINT)
    _, errors = sweep.communicate(timeout=FOREVER)
    assert sweep.returncode == 130, errors
    assert errors.rstrip().rpartition("\n")[2].endswith(f"gapeval sweep --resume {out}")
    assert "Traceback" not in errors
    one = drive(tmp_path / "one.mcap", 1)
    assert swept(one, "-p", "n_o=0", "-o", tmp_path / "next", "--executor", cluster)[0] == 0


def other_code(folder: Path) -> str:
    """The package with one line changed; what PYTHONPATH must be for it."""
    shutil.copytree(Path(package.__file__).parent, folder / "gapeval")
    units = folder / "gapeval/sweep/units.py"
    assert CHANGED in units.read_text()
    units.write_text(units.read_text().replace(CHANGED, CHANGED + "0"))
    return str(folder)


def test_a_worker_with_other_code_that_joins_later_ends_the_sweep(tmp_path: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 40), tmp_path / "out"
    other = other_code(tmp_path / "other")
    with scheduler(tmp_path) as (address, _), worker(address, tmp_path, "--nthreads", 1):
        sweep = begun(log, *MANY, "-o", out, "--executor", f"dask://{address}")
        wait_for(lambda: len(parts_of(out)) >= 1, sweep)
        with worker(address, tmp_path, "--nthreads", 2, PYTHONPATH=other):
            _, errors = sweep.communicate(timeout=FOREVER)
    assert sweep.returncode == 1, errors
    assert "gapeval: a worker that joined later differs: source is " in errors.rstrip().splitlines()[-1]
    assert not bytes_of(out)
    there = parts_of(out)
    assert gapeval("sweep", "--resume", out).status == 0
    assert {name: parts_of(out)[name] for name in there} == there


def test_workers_with_other_code_are_refused(tmp_path: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 1), tmp_path / "out"
    other = other_code(tmp_path / "other")
    with scheduler(tmp_path) as (address, _):
        url = f"dask://{address}"
        status, line = swept(log, "-o", out, "--executor", url)
        assert (status, line) == (
            1,
            f"gapeval: --executor {url}: no workers there; start some with `dask worker`",
        )
        with worker(address, tmp_path, PYTHONPATH=other):
            status, line = swept(log, "-o", out, "--executor", url)
    assert status == 1
    assert line.startswith("gapeval: worker tcp://127.0.0.1:")
    assert ": source is " in line
    assert line.endswith("all workers need the same code and logs")
    assert parts_of(out) == {}


def test_logs_that_are_not_the_same(tmp_path: Path) -> None:
    one, other = (
        drive(tmp_path / "one/log", 2, "sqlite3"),
        drive(tmp_path / "other/log", 2, "sqlite3", seed=1),
    )
    facts, others = (list(log_facts([str(path)]).values()) for path in (one, other))
    assert facts != others
    assert log_facts([str(one)]) == log_facts([str(one)])
    assert log_facts([str(tmp_path / "no")]) == {str(tmp_path / "no"): "missing"}
    assert differing({"/a.mcap": "9 bytes (ab)"}, {"/a.mcap": "missing"}) == (
        "/a.mcap is missing, here 9 bytes (ab)"
    )
    assert differing({"numpy": "2.3"}, {"numpy": "2.3", "more": "1"}) == ""


def test_nobody_there(tmp_path: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 1), tmp_path / "out"
    status, line = swept(log, "-o", out, "--executor", "dask://127.0.0.1:9")
    assert status == 1
    assert (
        line == "gapeval: --executor dask://127.0.0.1:9: no scheduler answers there; start `dask scheduler`"
    )


@pytest.mark.parametrize(
    "url", ["tcp://a:1", "dask://a", "dask://:1", "a:1", "dask://a:b", "dask://a:99999999", ""]
)
def test_urls_that_are_none(url: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected dask://HOST:PORT"):
        scheduler_address(url)
    done = gapeval("sweep", tmp_path / "no.mcap", "--executor", url, "-o", tmp_path / "out")
    assert (done.status, "expected dask://HOST:PORT" in done.last_line) == (2, True)


def test_jobs_and_a_cluster_are_two_things(tmp_path: Path) -> None:
    done = gapeval("sweep", tmp_path / "no.mcap", "--executor", "dask://a:1", "--jobs", 2)
    assert (done.status, "give one" in done.last_line) == (2, True)


def test_without_distributed_it_says_what_to_install(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 1)
    arguments = ["sweep", str(log), "-o", str(tmp_path / "out"), "--executor", "dask://127.0.0.1:9"]
    code = f"import sys; sys.modules['distributed'] = None; from gapeval.cli import main; main({arguments})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    last = done.stderr.rstrip().rpartition("\n")[2]
    assert last == "gapeval: --executor dask://127.0.0.1:9: needs pip install 'gapeval[cluster]'"
