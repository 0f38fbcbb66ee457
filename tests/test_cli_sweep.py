"""gapeval sweep, detect and score, as their users run them, on small logs."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from command import gapeval
from small_logs import cloud, drive, drive_with, feature, labels, stamps, trench_ring

from gapeval.config import load_config

GRID = ("-p", "delta_r=1.03,1.05", "-p", "n_o=0,1", "-p", "pl_th=0.05,0.1")
TABLES = ("summary.csv", "frames.csv", "labels.csv")
DETERMINISTIC = (*TABLES, "config.yaml", "manifest.json")


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def the_row(rows: list[dict[str, str]], **where: str) -> dict[str, str]:
    (row,) = [row for row in rows if all(row[key] == value for key, value in where.items())]
    return row


@pytest.fixture
def trench(tmp_path: Path) -> Path:
    return labels(tmp_path / "labels.geojson")


def test_the_trench_is_found_and_crossed(tmp_path: Path, trench: Path) -> None:
    log = drive(tmp_path / "drive.mcap")
    done = gapeval(
        "sweep", log, "--labels", trench, *GRID, "-p", "d_r=0.8", "-o", tmp_path / "out", "--jobs", 1
    )
    assert done.status == 0, done.err
    best = the_row(read(tmp_path / "out/summary.csv"), log="all", best="true")
    assert (best["hit_rate"], best["fp_per_frame"], best["frames"]) == ("1.0", "0.0", "4")
    assert float(best["coverage"]) > 0.8
    assert best["npca_accuracy"] == best["pca_accuracy"] == "1.0"
    assert float(best["npca_length_error"]) < 0.15
    assert float(best["npca_yaw_error"]) < 0.1
    assert best["configuration"] in done.out.splitlines()[3]
    assert "8 configurations on 4 frames of 1 log" in done.out
    assert "4 of 4 clouds of /points, robot base_link, in map by tf" in done.err


@pytest.mark.parametrize("container", ["bag", "bag-lz4", "sqlite3", "rosbag2-mcap"])
def test_every_container_gives_the_same_rows(tmp_path: Path, trench: Path, container: str) -> None:
    one, other = drive(tmp_path / "one" / "log", 2), drive(tmp_path / "other" / "log", 2, container)
    for log in (one, other):
        options = ("--labels", trench, *GRID, "-o", log.parent / "out", "--jobs", 1)
        assert gapeval("sweep", log, *options).status == 0
    for table in TABLES:
        assert (one.parent / "out" / table).read_bytes() == (other.parent / "out" / table).read_bytes()
    digests = [
        json.loads((log.parent / "out/manifest.json").read_text())["logs"][0]["sha256"]
        for log in (one, other)
    ]
    assert digests[0] == digests[1]


def test_any_number_of_workers_gives_the_same_bytes(tmp_path: Path, trench: Path) -> None:
    logs = [drive(tmp_path / "a.mcap", 5), drive(tmp_path / "b.bag", 3, "bag", seed=1)]
    for jobs in (1, 2, 4):
        options = ("--labels", trench, *GRID, "--gaps", "-o", tmp_path / str(jobs), "--jobs", jobs)
        assert gapeval("sweep", *logs, *options).status == 0
    for name in (*DETERMINISTIC, "gaps.csv"):
        first, *others = [(tmp_path / str(jobs) / name).read_bytes() for jobs in (1, 2, 4)]
        assert others == [first, first], name


@pytest.mark.parametrize(
    "choice",
    [
        (),
        ("-p", "n_o=0", "-p", "k=7"),
        ("-p", "plane=patch", "-p", "edge=zero", "-p", "kernel=cross"),
        ("-p", "eta=0.9", "-p", "rules=paper", "-p", "uniform=kdtree"),
        ("-p", "origin=robot", "-p", "i_width=33"),
    ],
)
def test_detect_then_score_gives_what_sweep_gives(
    tmp_path: Path, trench: Path, choice: tuple[str, ...]
) -> None:
    log = drive(tmp_path / "drive.mcap", 3)
    options = ("-p", "delta_r=1.05", *choice)
    assert (
        gapeval("sweep", log, "--labels", trench, *options, "-o", tmp_path / "sweep", "--jobs", 1).status == 0
    )
    assert gapeval("detect", log, "-o", tmp_path / "found.geojson", *options).status == 0
    scored = gapeval("score", tmp_path / "found.geojson", trench, "-o", tmp_path / "score")
    assert scored.status == 0, scored.err
    for table in TABLES:
        assert (tmp_path / "sweep" / table).read_bytes() == (tmp_path / "score" / table).read_bytes()
    made = load_config(tmp_path / "score/config.yaml")
    assert made.base.id == read(tmp_path / "score/summary.csv")[0]["configuration"]
    digests = [
        json.loads((tmp_path / d / "manifest.json").read_text())["logs"][0]["sha256"]
        for d in ("sweep", "score")
    ]
    assert digests[0] == digests[1]


def test_labels_once_for_all_logs_or_once_for_each(tmp_path: Path, trench: Path) -> None:
    logs = [drive(tmp_path / "day1" / "a.mcap", 2), drive(tmp_path / "day2" / "a.mcap", 3, seed=1)]
    far = labels(tmp_path / "far.geojson", [feature([[x + 90, y, z] for x, y, z in trench_ring()])])
    options = ("-p", "delta_r=1.05", "--jobs", 1)
    assert gapeval("sweep", *logs, "--labels", trench, *options, "-o", tmp_path / "one").status == 0
    rows = read(tmp_path / "one/summary.csv")
    assert [(row["log"], row["asked"]) for row in rows] == [
        ("day1/a.mcap", "2"),
        ("day2/a.mcap", "3"),
        ("all", "5"),
    ]
    each = ("--labels", trench, "--labels", far)
    assert gapeval("sweep", *logs, *each, *options, "-o", tmp_path / "each").status == 0
    rows = read(tmp_path / "each/summary.csv")
    assert [(row["log"], row["asked"]) for row in rows] == [
        ("day1/a.mcap", "2"),
        ("day2/a.mcap", "0"),
        ("all", "2"),
    ]
    assert {row["state"] for row in read(tmp_path / "each/labels.csv") if row["log"] == "day2/a.mcap"} == {
        "out_of_view"
    }
    wrong = gapeval("sweep", *logs, *each, "--labels", far, *options, "-o", tmp_path / "wrong")
    assert (wrong.status, wrong.last_line) == (
        2,
        "gapeval: 3 label files for 2 logs; give one for all, or one per log",
    )


def test_without_labels_there_are_gaps_and_timings(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    done = gapeval("sweep", log, *GRID, "-o", tmp_path / "out", "--jobs", 1)
    assert done.status == 0
    assert "No labels, so no configuration" in done.out
    for row in read(tmp_path / "out/summary.csv"):
        assert (row["frames"], row["hit_rate"], row["asked"], row["best"]) == ("2", "", "", "")
    assert any(int(row["gaps"]) > 0 for row in read(tmp_path / "out/frames.csv"))
    assert read(tmp_path / "out/labels.csv") == []
    timing = {row["stage"]: row for row in read(tmp_path / "out/timing.csv")}
    assert timing["cell_table"]["shared_by"] == "4.0"  # 8 configurations, 2 grids
    assert all(float(row["median"]) > 0 for row in timing.values())


def test_the_effective_configuration_gives_the_same_results(tmp_path: Path, trench: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    done = gapeval("sweep", log, "--labels", trench, *GRID, "-o", tmp_path / "first", "--jobs", 1)
    again = ("--config", tmp_path / "first/config.yaml", "-o", tmp_path / "again", "--jobs", 1)
    assert done.status == gapeval("sweep", log, "--labels", trench, *again).status == 0
    for name in DETERMINISTIC:
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_unusable_clouds_are_counted_and_named(tmp_path: Path, trench: Path) -> None:
    good, lost = [(stamp, cloud(index)) for index, stamp in enumerate(stamps(4))], np.full((50, 3), np.nan)
    clouds = [*good[:2], (stamps(6)[4], lost), (stamps(6)[5], np.empty((0, 3))), *good[2:]]
    log = drive_with(tmp_path / "drive.mcap", clouds)
    done = gapeval(
        "sweep", log, "--labels", trench, "-p", "delta_r=1.05", "-o", tmp_path / "out", "--jobs", 1
    )
    assert done.status == 0, done.err
    refused = json.loads((tmp_path / "out/manifest.json").read_text())["logs"][0]["refused"]
    assert sum(refused.values()) == 2
    assert all(reason in done.err for reason in refused)
    assert "refused    2 of 6 clouds" in done.out
    assert the_row(read(tmp_path / "out/summary.csv"), log="all")["frames"] == "4"


def test_only_labelled_stamps_are_scored(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 3)
    some = labels(tmp_path / "some.geojson", stamps=[str(stamps(3)[1]), "7"])
    done = gapeval("sweep", log, "--labels", some, "-p", "delta_r=1.05", "-o", tmp_path / "out", "--jobs", 1)
    assert done.status == 0
    assert "some.geojson: 1 labelled stamps are no cloud, the first 7" in done.err
    assert json.loads((tmp_path / "out/manifest.json").read_text())["labels"][0]["unmatched_stamps"] == 1
    row = the_row(read(tmp_path / "out/summary.csv"), log="all")
    assert (row["frames"], row["scored_frames"], row["asked"]) == ("3", "1", "1")


def test_every_gap_on_request(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    assert gapeval("sweep", log, *GRID, "--gaps", "-o", tmp_path / "out", "--jobs", 1).status == 0
    gaps, frames = read(tmp_path / "out/gaps.csv"), read(tmp_path / "out/frames.csv")
    assert len(gaps) == sum(int(row["gaps"]) for row in frames) > 0
    for row in gaps:
        assert (row["npca_traversable"] == "true") == (row["npca_reason"] == "")
        assert (row["npca_reason"] == "too_long") == (float(row["npca_length"]) > 0.34)
    assert gapeval("sweep", log, *GRID, "-o", tmp_path / "out", "--jobs", 1).status == 0
    assert not (tmp_path / "out/gaps.csv").exists(), "it would be of another sweep than the rest"


def test_a_failed_sweep_leaves_the_results_of_the_last(tmp_path: Path, trench: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    options = ("--labels", trench, "-p", "delta_r=1.05", "-o", tmp_path / "out", "--jobs", 1)
    assert gapeval("sweep", log, *options).status == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}
    empty = drive_with(tmp_path / "empty.mcap", [(stamp, np.full((5, 3), np.nan)) for stamp in stamps(3)])
    failed = gapeval("sweep", empty, *options)
    assert failed.status == 1
    after = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir() if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("sent", "begun", "later", "status"),
    [
        (signal.SIGINT, 1, 0.1, 130),  # in the middle of a unit
        (signal.SIGINT, 0, 0.0, 130),  # while the workers start
        (signal.SIGINT, 0, 0.15, 130),
        (signal.SIGINT, 0, 0.4, 130),
        (signal.SIGKILL, 1, 0.0, -signal.SIGKILL),
    ],
)
def test_an_interrupted_sweep_leaves_nothing_that_looks_whole(
    tmp_path: Path, sent: int, begun: int, later: float, status: int
) -> None:
    """Sent `later` [s] than when so many parts are there and the next are begun."""
    log = drive(tmp_path / "drive.mcap", 60)
    grid = ("-p", "delta_r=" + ",".join(f"{1.02 + step / 1000}" for step in range(60)), "-p", "n_o=0,1,2")
    command = [
        sys.executable,
        "-m",
        "gapeval",
        "sweep",
        str(log),
        *grid,
        "-o",
        str(tmp_path / "out"),
        "--jobs",
        "2",
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    parts = tmp_path / "out" / "parts"
    while process.poll() is None and not ((parts / "sweep.json").exists() and done(parts) >= begun):
        time.sleep(0.02)
    assert process.poll() is None, "it was done before it could be interrupted"
    time.sleep(later)
    os.killpg(process.pid, sent)
    _, errors = process.communicate(timeout=60)
    # Now and then Python, having handled the interrupt, still ends by the signal: a shell says 130 to both.
    assert process.returncode in (status, -sent), errors
    if sent == signal.SIGINT:
        last = errors.rstrip().splitlines()[-1]
        assert last == f"gapeval: interrupted; go on with: gapeval sweep --resume {tmp_path / 'out'}"
        assert "Traceback" not in errors
        assert list(parts.glob("*.part")) == []
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["parts"]


def done(parts: Path) -> int:
    return len(list(parts.glob("*.npz.zst")))


def test_real_log_hits_all_three_gaps_in_all_three_frames(tmp_path: Path, real_data: Path) -> None:
    street = real_data / "os1_street"
    config = Path(__file__).parent.parent / "configs/os1_street.yaml"
    tables = []
    for kind in ("mcap", "bag"):
        out = tmp_path / kind
        arguments = ("--labels", street / "labels.geojson", "--config", config, "-o", out)
        done = gapeval("sweep", street / f"os1_street.{kind}", *arguments)
        assert done.status == 0, done.err
        rows = read(out / "summary.csv")
        assert len(rows) >= 2 * 48
        best = the_row(rows, log="all", best="true")
        assert (best["asked"], best["hits"], best["hit_rate"]) == ("9", "9", "1.0")
        tables.append([(out / table).read_text().replace(f".{kind}", "") for table in TABLES])
    assert tables[0] == tables[1]


def test_on_level_ground_detect_and_score_are_a_sweep_and_say_so(tmp_path: Path) -> None:
    """A plane of its own is named in the manifest, so that nobody compares it with another."""
    log, drawn = drive(tmp_path / "drive.mcap", 2), labels(tmp_path / "labels.geojson")
    swept, scored, found = tmp_path / "swept", tmp_path / "scored", tmp_path / "d.geojson"
    level = ("-p", "plane=gravity", "-p", "n_o=0")
    assert gapeval("sweep", log, "--labels", drawn, *level, "-o", swept, "--gaps").status == 0
    assert gapeval("detect", log, "-o", found, *level).status == 0
    assert gapeval("score", found, drawn, "-o", scored).status == 0
    for name in ("frames.csv", "labels.csv"):
        assert read(swept / name)
        assert read(scored / name) == read(swept / name)
    assert {row["plane_fallback"] for row in read(swept / "frames.csv")} == {""}
    assert json.loads((swept / "manifest.json").read_text())["scoring"]["plane"] == "gravity"
    weights = [feature["properties"]["weight"] for feature in json.loads(found.read_text())["features"]]
    assert [row["weight"] for row in read(swept / "gaps.csv")] == list(map(repr, weights))
    assert all(0 < weight <= 1 for weight in weights)
    mixed = tmp_path / "mixed"
    assert gapeval("sweep", log, "--labels", drawn, "-p", "plane=gravity,robot", "-o", mixed).status == 0
    assert "plane" not in json.loads((mixed / "manifest.json").read_text())["scoring"]
