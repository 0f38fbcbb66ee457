"""A sweep that was stopped at any moment goes on where it was, and gives the bytes of one that was not."""

import json
import os
import resource
import shutil
import signal
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from command import gapeval
from hypothesis import given, settings
from hypothesis import strategies as st
from small_logs import cloud, drive, drive_with, feature, labels, stamps, trench_ring
from sweeps import GRID, MANY, alive, begun, bytes_of, parts_of, wait_for, workers_of


@pytest.fixture
def trench(tmp_path: Path) -> Path:
    return labels(tmp_path / "labels.geojson")


@pytest.mark.parametrize(("jobs", "moment"), [(2, 1), (2, 7), (1, 3)])
def test_killed_with_minus_nine_and_resumed(tmp_path: Path, trench: Path, jobs: int, moment: int) -> None:
    log, out = drive(tmp_path / "drive.mcap", 12), tmp_path / "out"
    asked = (log, "--labels", trench, *MANY)
    killed = begun(*asked, "-o", out, "--jobs", jobs)
    wait_for(lambda: len(parts_of(out)) >= moment, killed)
    workers = workers_of(killed)
    assert (len(workers) == jobs) or jobs == 1
    killed.kill()
    killed.communicate()
    there = parts_of(out)
    for worker in workers:  # which nobody else ends
        deadline = time.monotonic() + 60
        while alive(worker):
            assert time.monotonic() < deadline, "a worker outlives its parent"
            time.sleep(0.01)
    assert not bytes_of(out)
    done = gapeval("sweep", "--resume", out, "--jobs", 3 - jobs)
    assert done.status == 0, done.err
    assert f"resuming: {len(there)} of 12 frames are there" in done.err
    after = parts_of(out)
    assert {name: after[name] for name in there} == there, "a finished unit was repeated"
    assert len(after) == 12
    assert gapeval("sweep", *asked, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


def test_the_same_command_again_evaluates_nothing(tmp_path: Path, trench: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 3), tmp_path / "out"
    asked = ("sweep", log, "--labels", trench, *GRID, "-o", out)
    assert gapeval(*asked, "--jobs", 1).status == 0
    first, there = bytes_of(out), parts_of(out)
    again = gapeval(*asked, "--jobs", 2)
    assert "resuming: 3 of 3 frames are there" in again.err
    assert bytes_of(out) == first
    assert parts_of(out) == there


def test_resume_needs_neither_the_folder_nor_the_way_it_was_called_from(
    tmp_path: Path, trench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive(tmp_path / "drive.mcap", 2)
    monkeypatch.chdir(tmp_path)
    asked = ("-p", "z_min=.inf,5", "-p", "d_r=null,0.5")
    assert gapeval("sweep", "drive.mcap", "--labels", "labels.geojson", *asked, "-o", "out").status == 0
    first = bytes_of(tmp_path / "out")
    monkeypatch.chdir("/")
    assert gapeval("sweep", "--resume", tmp_path / "out").status == 0
    assert bytes_of(tmp_path / "out") == first


def test_another_grid_evaluates_only_what_is_new(tmp_path: Path, trench: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 3), tmp_path / "out"

    def sweep(where: Path, *choice: str) -> str:
        done = gapeval("sweep", log, "--labels", trench, *choice, "-o", where, "--jobs", 1)
        assert done.status == 0, done.err
        return done.out

    sweep(out, "-p", "n_o=0,1", "-p", "pl_th=0.05,0.1")
    there = parts_of(out)
    sweep(out, "-p", "n_o=2,1", "-p", "pl_th=0.1,0.05")  # two are new, two stand elsewhere
    added = parts_of(out)
    assert {name: added[name] for name in there} == there
    assert len(added) == 2 * len(there)
    sweep(tmp_path / "whole", "-p", "n_o=2,1", "-p", "pl_th=0.1,0.05")
    assert bytes_of(out) == bytes_of(tmp_path / "whole")
    sweep(out, "-p", "n_o=0", "-p", "pl_th=0.05")  # fewer: nothing is new
    sweep(tmp_path / "one", "-p", "n_o=0", "-p", "pl_th=0.05")
    assert bytes_of(out) == bytes_of(tmp_path / "one")
    assert parts_of(out) == added
    sharing = {row.split(",")[1]: row.split(",")[2] for row in (out / "timing.csv").read_text().splitlines()}
    assert sharing["read"] == "4.0", "it was read once for the four that were evaluated then"


def test_how_many_shared_a_step_is_right_when_frames_were_evaluated_twice(
    tmp_path: Path, trench: Path
) -> None:
    log, out = drive(tmp_path / "drive.mcap", 2), tmp_path / "out"
    for choice in ("0", "0,1,2"):
        asked = ("-p", f"n_o={choice}", "-p", "pl_th=0.05,0.1")
        assert gapeval("sweep", log, "--labels", trench, *asked, "-o", out, "--jobs", 1).status == 0
    rows = [row.split(",") for row in (out / "timing.csv").read_text().splitlines()]
    read = next(row for row in rows if row[1] == "read")
    assert (read[2], read[3]) == ("3.0", "2")  # once for 2 configurations, once for 4; two frames


def test_parts_with_gaps_serve_a_sweep_without_but_not_the_other_way_round(
    tmp_path: Path, trench: Path
) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    asked = ("sweep", log, "--labels", trench, "-p", "n_o=0,1", "--jobs", 1)
    assert gapeval(*asked, "--gaps", "-o", tmp_path / "with").status == 0
    assert gapeval(*asked, "-o", tmp_path / "without").status == 0
    with_gaps, without = bytes_of(tmp_path / "with"), bytes_of(tmp_path / "without")
    assert "resuming: 2 of 2" in gapeval(*asked, "-o", tmp_path / "with").err
    assert bytes_of(tmp_path / "with") == without
    assert "resuming" not in gapeval(*asked, "--gaps", "-o", tmp_path / "without").err
    assert bytes_of(tmp_path / "without") == with_gaps


def changed_labels(folder: Path) -> tuple[object, ...]:
    labels(folder / "labels.geojson", [feature([[x + 0.1, y, z] for x, y, z in trench_ring()])])
    return ()


def changed_log(folder: Path) -> tuple[object, ...]:
    drive(folder / "drive.mcap", 3, seed=5)
    return ()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (changed_labels, "labels.geojson"),
        (changed_log, "drive.mcap"),
        (lambda _: ("-p", "hit_coverage=0.9"), ""),
        (lambda _: ("-p", "scoring.domain.x_min=1", "-p", "scoring.domain.r_max=2.5"), ""),
        (lambda _: ("-p", "max_tf_gap=0.4"), ""),
    ],
    ids=["labels", "log", "scoring", "domain", "reading"],
)
def test_what_was_made_from_other_inputs_is_not_used(
    tmp_path: Path, trench: Path, change: Callable[[Path], Iterable[object]], named: str
) -> None:
    log, out = drive(tmp_path / "drive.mcap", 3), tmp_path / "out"
    asked = ("sweep", log, "--labels", trench, "-p", "delta_r=1.05,1.1", "--jobs", 1)
    assert gapeval(*asked, "-o", out).status == 0
    there = parts_of(out)
    more = change(tmp_path)
    again = gapeval("sweep", "--resume", out, "--jobs", 1) if named else gapeval(*asked, *more, "-o", out)
    assert again.status == 0
    assert "resuming" not in again.err
    assert (f"{named}: has changed since that sweep began" in again.err) == bool(named)
    assert len(parts_of(out)) == len(there), "parts of inputs that are gone are removed"
    assert not set(parts_of(out)) & set(there)
    assert gapeval(*asked, *more, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("damage", ["cut", "empty", "flipped", "foreign"])
def test_a_part_that_cannot_be_read_is_made_again(tmp_path: Path, trench: Path, damage: str) -> None:
    log, out = drive(tmp_path / "drive.mcap", 3), tmp_path / "out"
    asked = ("sweep", log, "--labels", trench, *GRID, "-o", out, "--jobs", 1)
    assert gapeval(*asked).status == 0
    first = bytes_of(out)
    path = sorted((out / "parts").glob("*.npz.zst"))[1]
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0x10
    path.write_bytes(
        {"cut": whole[:-9], "empty": b"", "flipped": bytes(flipped), "foreign": b"x" * 99}[damage]
    )
    again = gapeval(*asked)
    assert "resuming: 2 of 3 frames are there" in again.err
    assert bytes_of(out) == first


def test_two_sweeps_into_one_folder_at_once(tmp_path: Path, trench: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 12), tmp_path / "out"
    first = begun(log, "--labels", trench, *MANY, "-o", out, "--jobs", 1)
    wait_for(lambda: (out / "parts/sweep.json").exists(), first)
    order = (out / "parts/sweep.json").read_bytes()
    second = gapeval("sweep", log, "-p", "n_o=0", "-o", out)
    assert second.status == 1
    assert second.last_line == f"gapeval: {out}: another sweep writes here; wait for it, or choose another -o"
    assert (out / "parts/sweep.json").read_bytes() == order
    assert first.poll() is None
    first.kill()  # whose lock goes with it
    first.communicate()
    assert gapeval("sweep", log, "-p", "n_o=0", "-o", out).status == 0


def test_a_worker_that_is_killed_costs_nothing(tmp_path: Path, trench: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 10), tmp_path / "out"
    sweep = begun(log, "--labels", trench, *MANY, "-o", out, "--jobs", 2)
    wait_for(lambda: len(parts_of(out)) >= 1 and len(workers_of(sweep)) == 2, sweep)
    os.kill(workers_of(sweep)[0], signal.SIGKILL)
    _, errors = sweep.communicate(timeout=300)
    assert sweep.returncode == 0, errors
    assert gapeval("sweep", log, "--labels", trench, *MANY, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


def test_a_worker_that_is_killed_as_it_starts(tmp_path: Path, trench: Path) -> None:
    """While it is told what to do: what it is told must not fill the pipe that nobody reads any more."""
    log, out = drive(tmp_path / "drive.mcap", 6), tmp_path / "out"
    sweep = begun(log, "--labels", trench, *MANY, "-o", out, "--jobs", 2)
    wait_for(lambda: len(workers_of(sweep)) >= 1, sweep)
    os.kill(workers_of(sweep)[0], signal.SIGKILL)
    _, errors = sweep.communicate(timeout=120)
    assert sweep.returncode == 0, errors
    assert gapeval("sweep", log, "--labels", trench, *MANY, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("apart", [0.0, 0.002, 0.05])
def test_interrupted_twice(tmp_path: Path, trench: Path, apart: float) -> None:
    log, out = drive(tmp_path / "drive.mcap", 12), tmp_path / "out"
    sweep = begun(log, "--labels", trench, *MANY, "-o", out, "--jobs", 3)
    wait_for(lambda: len(parts_of(out)) >= 1, sweep)
    os.killpg(sweep.pid, signal.SIGINT)
    time.sleep(apart)
    if sweep.poll() is None:
        os.killpg(sweep.pid, signal.SIGINT)
    _, errors = sweep.communicate(timeout=60)
    assert sweep.returncode in (130, -signal.SIGINT), errors
    assert gapeval("sweep", "--resume", out).status == 0
    assert gapeval("sweep", log, "--labels", trench, *MANY, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_log_that_is_replaced_meanwhile(tmp_path: Path, trench: Path, jobs: int) -> None:
    """Nothing of the other log gets into the results, and nothing is counted as refused."""
    log, out = drive(tmp_path / "drive.mcap", 12), tmp_path / "out"
    other = drive(tmp_path / "other.mcap", 9, seed=4)
    kept = shutil.copy(log, tmp_path / "kept.mcap")
    asked = (log, "--labels", trench, *MANY, "--jobs", jobs)
    sweep = begun(*asked, "-o", out)
    wait_for(lambda: len(parts_of(out)) >= 1, sweep)
    other.replace(log)
    _, errors = sweep.communicate(timeout=300)
    assert sweep.returncode == 1, errors
    assert "has changed since the sweep began" in errors.rstrip().splitlines()[-1]
    found = json.loads((out / "manifest.json").read_text())
    assert found["failed"]
    assert found["logs"][0]["refused"] == {}
    Path(kept).replace(log)
    assert gapeval("sweep", *asked, "-o", out).status == 0
    assert gapeval("sweep", *asked, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


def test_a_part_under_the_name_of_another_is_made_again(tmp_path: Path, trench: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 4), tmp_path / "out"
    asked = ("sweep", log, "--labels", trench, *GRID, "-o", out, "--jobs", 1)
    assert gapeval(*asked).status == 0
    whole = bytes_of(out)
    one, other, *_ = sorted((out / "parts").glob("*.npz.zst"))
    shutil.copy(one, other)
    again = gapeval(*asked)
    assert "resuming: 3 of 4 frames are there" in again.err
    assert bytes_of(out) == whole


def limited(size: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def test_a_disk_that_is_full(tmp_path: Path, trench: Path) -> None:
    """No file may grow beyond a size: first the parts do not fit, then what is merged from them."""
    log, out = drive(tmp_path / "drive.mcap", 4), tmp_path / "out"
    asked = (log, "--labels", trench, *MANY[:4], "-o", out, "--jobs", 2)
    for size, kept in ((10_000, 0), (150_000, 4)):
        sweep = begun(*asked, preexec_fn=limited(size))
        _, errors = sweep.communicate(timeout=300)
        assert sweep.returncode == 1, errors
        last = errors.rstrip().splitlines()[-1]
        assert last.startswith("gapeval: ")
        assert "File too large" in last
        assert len(parts_of(out)) == kept
        assert [path.name for path in out.iterdir()] == ["parts"]
    assert gapeval("sweep", "--resume", out).status == 0
    assert len(parts_of(out)) == 4
    assert gapeval("sweep", *asked[:-4], "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_unit_that_fails_is_told_and_the_rest_goes_on(tmp_path: Path, trench: Path, jobs: int) -> None:
    """The end of the log is damaged while it is swept."""
    log, out = drive(tmp_path / "drive.mcap", 12), tmp_path / "out"
    whole = log.read_bytes()
    asked = (log, "--labels", trench, *MANY, "--jobs", jobs)
    sweep = begun(*asked, "-o", out)
    wait_for(lambda: len(parts_of(out)) >= 1, sweep)
    start, stop = int(len(whole) * 0.9), int(len(whole) * 0.92)
    with log.open("r+b") as file:  # in place: what lies elsewhere is never missing
        file.seek(start)
        file.write(bytes(stop - start))
    output, errors = sweep.communicate(timeout=300)
    assert sweep.returncode == 1, errors
    failed = json.loads((out / "manifest.json").read_text())["failed"]
    assert 1 <= len(failed) <= 11
    for one, stamp in zip(reversed(failed), reversed(stamps(12)), strict=False):
        assert (one["log"], one["first"], one["last"], one["frames"]) == ("drive.mcap", stamp, stamp, 1)
        assert "has changed since the sweep began" in one["reason"]
    lost = "1 frame" if len(failed) == 1 else f"{len(failed)} frames"
    last = errors.rstrip().splitlines()[-1]
    assert last.startswith(
        f"gapeval: {len(failed)} of 12 units failed, {lost}: the first because {log}: has changed"
    )
    assert last.endswith("; mend that, and run the same command again")
    assert "Traceback" not in errors
    assert f"{12 - len(failed)} frames of 1 log" in output
    log.write_bytes(whole)
    there = parts_of(out)
    again = gapeval("sweep", *asked, "-o", out)
    assert again.status == 0, again.err
    assert f"resuming: {12 - len(failed)} of 12 frames are there" in again.err
    assert {name: parts_of(out)[name] for name in there} == there
    assert gapeval("sweep", *asked, "-o", tmp_path / "whole").status == 0
    assert bytes_of(out) == bytes_of(tmp_path / "whole")


@pytest.mark.parametrize("jobs", [1, 2])
def test_fail_fast_stops_at_the_first_and_keeps_what_is_there(
    tmp_path: Path, trench: Path, jobs: int
) -> None:
    log, out = drive(tmp_path / "drive.mcap", 12), tmp_path / "out"
    whole = log.read_bytes()
    sweep = begun(log, "--labels", trench, *MANY, "--jobs", jobs, "--fail-fast", "-o", out)
    wait_for(lambda: len(parts_of(out)) >= 1, sweep)
    log.unlink()
    _, errors = sweep.communicate(timeout=300)
    assert sweep.returncode == 1
    last = errors.rstrip().splitlines()[-1]
    assert last.startswith(f"gapeval: 1 of 12 units failed, 1 frame: the first because {log}: no such file")
    assert [path.name for path in out.iterdir()] == ["parts"]
    there = parts_of(out)
    assert 1 <= len(there) < 12
    log.write_bytes(whole)
    assert gapeval("sweep", "--resume", out).status == 0
    assert {name: parts_of(out)[name] for name in there} == there


def test_resume_takes_everything_from_the_sweep(tmp_path: Path, trench: Path) -> None:
    log, out = drive(tmp_path / "drive.mcap", 1), tmp_path / "out"
    for arguments in ((log,), ("--labels", trench), ("-p", "n_o=0"), ("-o", out), ("--gaps",)):
        done = gapeval("sweep", *arguments, "--resume", out)
        assert done.status == 2
        assert "--resume takes" in done.last_line
    assert gapeval("sweep").status == 2
    done = gapeval("sweep", "--resume", out)
    assert (done.status, "no sweep was begun here" in done.last_line) == (1, True)
    assert not out.exists()
    (out / "parts").mkdir(parents=True)
    (out / "parts/sweep.json").write_text("{")
    done = gapeval("sweep", "--resume", out)
    assert (done.status, "name the logs again" in done.last_line) == (1, True)


def test_no_date_and_no_trace_of_resuming_in_the_manifest(tmp_path: Path, trench: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    assert gapeval("sweep", log, "-p", "n_o=0", "-o", tmp_path / "out", "--jobs", 1).status == 0
    document = json.loads((tmp_path / "out/manifest.json").read_text())
    assert set(document) == {
        *("gapeval", "revision", "source", "versions", "scorer", "scoring", "configurations"),
        *("logs", "labels", "failed"),
    }
    assert document["failed"] == []


def test_unusable_clouds_are_counted_once_however_often_their_unit_was_read(
    tmp_path: Path, trench: Path
) -> None:
    good, lost = [(stamp, cloud(index)) for index, stamp in enumerate(stamps(3))], np.full((50, 3), np.nan)
    log = drive_with(tmp_path / "drive.mcap", [*good[:1], (stamps(5)[4], lost), *good[1:]])
    out = tmp_path / "out"
    for choice in ("0", "0,1"):
        done = gapeval("sweep", log, "--labels", trench, "-p", f"n_o={choice}", "-o", out, "--jobs", 1)
        assert done.status == 0
        assert "refused    1 of 4 clouds" in done.out


# Indices of 2 x 2 x 2 configurations, in the order of their values below.
CHOICES = [
    ("-p", f"delta_r={delta_r}", "-p", f"n_o={n_o}", "-p", f"pl_th={pl_th}")
    for delta_r in ("1.03", "1.05", "1.03,1.05", "1.05,1.03")
    for n_o in ("0", "1", "0,1", "1,0")
    for pl_th in ("0.05", "0.1", "0.05,0.1", "0.1,0.05")
]


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with labels, in units of two frames and one, and the results of the whole grid."""
    folder = tmp_path_factory.mktemp("shared")
    stamped = [str(stamp) for stamp in stamps(17)[:9]]
    log = drive(folder / "drive.mcap", 17, "mcap-no-index")
    drawn = labels(folder / "labels.geojson", stamps=stamped)
    arguments = ("--labels", drawn, *GRID, *DOMAIN, "-o", folder / "whole", "--jobs", 1)
    assert gapeval("sweep", log, *arguments).status == 0
    assert len(parts_of(folder / "whole")) == 9
    return folder


DOMAIN = ("-p", "scoring.domain={x_min: 0.6, r_max: 3}")


@settings(max_examples=12, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(CHOICES), st.booleans()), min_size=1, max_size=4))
def test_any_earlier_sweeps_into_the_folder_change_no_byte(
    shared: Path, earlier: list[tuple[tuple[str, ...], bool]]
) -> None:
    out = shared / "out"
    shutil.rmtree(out, ignore_errors=True)
    asked = ("sweep", shared / "drive.mcap", "--labels", shared / "labels.geojson", *DOMAIN, "-o", out)
    for choice, gaps in earlier:
        assert gapeval(*asked, *choice, *(["--gaps"] if gaps else []), "--jobs", 1).status == 0
    done = gapeval(*asked, *GRID, "--jobs", 1)
    assert done.status == 0, done.err
    assert bytes_of(out) == bytes_of(shared / "whole")
