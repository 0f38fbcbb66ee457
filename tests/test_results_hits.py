"""hits.csv, approaches.csv and the intervals in summary.csv, made again from labels.csv and frames.csv."""

import csv
import itertools
import math
import shutil
from collections import defaultdict

import numpy as np
import pytest
from command import gapeval
from hypothesis import given, settings
from hypothesis import strategies as st
from small_logs import drive, feature, labels, trench_ring
from sweeps import bytes_of

from gapeval.results.hits import EDGES, Approaches, FirstHits, HitCounts
from gapeval.scoring.intervals import block_draws, interval
from gapeval.scoring.metrics import METRICS, SUMS, figure
from gapeval.scoring.scene import AskedLabel

GRID = ("-p", "delta_r=1.03,1.05", "-p", "n_o=0,1,2", "-p", "pl_th=0.05", "-p", "r_max=2.5")
FRAMES = {"a.mcap": 28, "b.bag": 12}
BLOCK = 0.2


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Two logs of a robot that drives 1.4 m and 0.6 m towards a trench, and past a ditch beside it."""
    folder = tmp_path_factory.mktemp("swept")
    logs = [
        drive(folder / "a.mcap", FRAMES["a.mcap"]),
        drive(folder / "b.bag", FRAMES["b.bag"], "bag", seed=1),
    ]
    ditch = [[0.9, 1.3, 0], [1.3, 1.3, 0], [1.3, 1.9, 0], [0.9, 1.9, 0], [0.9, 1.3, 0]]
    drawn = labels(
        folder / "labels.geojson",
        [feature(trench_ring(), traversable=True, length=0.6), feature(ditch, id="ditch")],
    )
    asked = (*logs, "--labels", drawn, *GRID, "-p", f"scoring.block={BLOCK}")
    for jobs in (1, 3):
        assert gapeval("sweep", *asked, "-o", folder / str(jobs), "--jobs", jobs).status == 0
    return folder


def test_neither_workers_nor_parts_that_are_there_change_a_byte(swept):
    assert bytes_of(swept / "1") == bytes_of(swept / "3")
    first = bytes_of(swept / "3")
    parts = sorted((swept / "3" / "parts").glob("*.npz.zst"))
    for part in parts[::3]:
        part.unlink()
    assert gapeval("sweep", "--resume", swept / "3", "--jobs", 2).status == 0
    assert bytes_of(swept / "3") == first


def test_another_block_needs_no_frame_anew(swept, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(swept / "1", out)
    asked = [swept / log for log in FRAMES]
    given = ("--labels", swept / "labels.geojson", *GRID, "-p", "scoring.block=0.4", "-o", out)
    done = gapeval("sweep", *asked, *given, "--jobs", 1)
    assert "resuming: 40 of 40 frames are there" in done.err
    before, after = rows(swept / "1" / "summary.csv")[0], rows(out / "summary.csv")[0]
    assert after["coverage"] == before["coverage"]
    assert before["coverage_low"] != ""
    assert after["coverage_low"] == ""  # fewer than 10 blocks


def test_hits_are_those_of_labels_by_range_and_width(swept):
    asked, hits = defaultdict(int), defaultdict(int)
    for row in rows(swept / "3" / "labels.csv"):
        if row["hit"] == "":
            continue
        for by, edges in EDGES.items():
            for low, high in itertools.pairwise(edges):
                if low <= float(row[by]) < high:
                    for log in (row["log"], "all"):
                        asked[log, row["configuration"], by, low, high] += 1
                        hits[log, row["configuration"], by, low, high] += row["hit"] == "true"
    found = rows(swept / "3" / "hits.csv")
    keys = [(r["log"], r["configuration"], r["by"], float(r["low"]), float(r["high"])) for r in found]
    assert set(keys) == set(asked)
    assert len(keys) == len(set(keys))
    assert {row["by"] for row in found} == {"range", "width"}
    assert any(0 < int(row["hits"]) < int(row["asked"]) for row in found)
    for key, row in zip(keys, found, strict=True):
        assert (int(row["asked"]), int(row["hits"])) == (asked[key], hits[key])
        assert float(row["hit_rate"]) == hits[key] / asked[key]
    order = [row["configuration"] for row in rows(swept / "3" / "summary.csv") if row["log"] == "all"]
    places = [(["a.mcap", "b.bag", "all"].index(log), order.index(name)) for log, name, *_ in keys]
    assert places == sorted(places)


def test_approaches_are_those_of_labels_frame_by_frame(swept):
    asked = defaultdict(list)
    for row in rows(swept / "3" / "labels.csv"):
        if row["hit"] != "":
            asked[row["log"], row["configuration"], row["label"]].append(row)
    found = {(r["log"], r["configuration"], r["label"]): r for r in rows(swept / "3" / "approaches.csv")}
    assert set(found) == set(asked)
    for key, frames in asked.items():
        row = found[key]
        ranges = [float(frame["range"]) for frame in frames]
        hits = [float(frame["range"]) for frame in frames if frame["hit"] == "true"]
        missed = [float(frame["range"]) for frame in frames if frame["hit"] == "false"]
        assert (int(row["asked"]), int(row["hits"])) == (len(frames), len(hits))
        assert (float(row["first_asked"]), float(row["nearest"])) == (ranges[0], min(ranges))
        assert row["first_hit"] == (repr(hits[0]) if hits else "")
        assert row["nearest_missed"] == (repr(min(missed)) if missed else "")
        assert row["towards"] == ("true" if ranges[0] - min(ranges) >= 1 else "false")
        assert row["width"] == frames[0]["width"]
    assert {row["towards"] for row in found.values()} == {"true", "false"}


def test_the_first_hit_is_told_in_the_summary(swept):
    approaches = rows(swept / "3" / "approaches.csv")
    for row in rows(swept / "3" / "summary.csv"):
        towards = [
            one
            for one in approaches
            if one["configuration"] == row["configuration"]
            and row["log"] in ("all", one["log"])
            and one["towards"] == "true"
        ]
        hit = [float(one["first_hit"]) for one in towards if one["first_hit"]]
        assert row["first_hit_range"] == (repr(sum(hit) / len(hit)) if hit else "")
        assert row["towards_missed"] == (str(len(towards) - len(hit)) if towards else "")


def test_intervals_are_those_of_the_sums_of_frames(swept):
    """Everything again, from frames.csv and the functions that draw."""
    frames = rows(swept / "3" / "frames.csv")
    known = 0
    for row in rows(swept / "3" / "summary.csv"):
        replicates = dict.fromkeys(SUMS, 0.0)
        for seed, log in enumerate(FRAMES):
            if row["log"] in ("all", log):
                of = [f for f in frames if (f["log"], f["configuration"]) == (log, row["configuration"])]
                stamps = np.array([int(frame["stamp"]) for frame in of])
                weights = block_draws(stamps, BLOCK, [2013, seed]).astype(float)
                for name in SUMS:
                    replicates[name] = replicates[name] + weights @ [float(frame[name]) for frame in of]
        for metric in METRICS:
            told = (row[f"{metric.name}_low"], row[f"{metric.name}_high"])
            enough = row["log"] != "b.bag"  # of 6 blocks
            exact = row[metric.name] in ("0.0", "1.0") and metric.counts != "nothing"
            if exact:
                assert "" not in told
            elif not enough or row[metric.name] == "":
                assert told == ("", "")
            else:
                low, high = interval(figure(metric, replicates))
                if math.isnan(low):
                    assert told == ("", "")
                else:
                    known += 1
                    expected = pytest.approx([float(low), float(high)], rel=1e-9, abs=1e-12)
                    assert [float(told[0]), float(told[1])] == expected
    assert known > 50


def test_a_score_of_detections_has_the_same_files(swept, tmp_path):
    found = tmp_path / "found.geojson"
    chosen = ("-p", "delta_r=1.05", "-p", "n_o=1", "-p", "pl_th=0.05", "-p", "r_max=2.5")
    assert gapeval("detect", swept / "a.mcap", "-o", found, *chosen).status == 0
    given = (swept / "labels.geojson", "-p", f"scoring.block={BLOCK}", "-o", tmp_path / "score")
    assert gapeval("score", found, *given).status == 0
    (row,) = [r for r in rows(tmp_path / "score" / "summary.csv") if r["log"] == "a.mcap"]
    for name in ("summary.csv", "hits.csv", "approaches.csv"):
        expected = [
            r
            for r in rows(swept / "3" / name)
            if (r["log"], r["configuration"]) == ("a.mcap", row["configuration"])
        ]
        here = [r for r in rows(tmp_path / "score" / name) if r["log"] == "a.mcap"]
        assert len(here) == len(expected) > 0
        for one, other in zip(here, expected, strict=True):
            for column in one:
                if column != "best":
                    assert one[column] == other[column] or float(one[column]) == pytest.approx(
                        float(other[column]), rel=1e-9
                    ), (name, column)


# --- by hand -----------------------------------------------------------------------------------------


def asked(name, at, width=0.5):
    return AskedLabel(name, at, width, False)


def test_an_approach_by_hand():
    found = Approaches(2)
    for at, hit in ((3.0, (0, 0)), (2.5, (1, 0)), (2.2, (0, 0)), (1.9, (1, 0)), (2.4, (1, 0))):
        found.add([asked("p", at)], np.array(hit, dtype=bool)[:, None])
    one, other = next(found.rows(0)), next(found.rows(1))
    about = {"label": "p", "width": 0.5, "asked": 5, "first_asked": 3.0, "nearest": 1.9, "towards": True}
    assert one == about | {"hits": 3, "first_hit": 2.5, "nearest_missed": 2.2}
    assert other == about | {"hits": 0, "first_hit": None, "nearest_missed": 1.9}
    first = FirstHits.none(2)
    first.add(found)
    assert first.figures(0) == {"first_hit_range": 2.5, "towards_missed": 0}
    assert first.figures(1) == {"first_hit_range": None, "towards_missed": 1}
    assert FirstHits.none(1).figures(0) == {"first_hit_range": None, "towards_missed": None}


@settings(deadline=None, derandomize=True)
@given(st.lists(st.sampled_from([*EDGES["range"][:-1], 0.1, 7.5, 1e6]), min_size=1))
def test_every_range_is_in_one_class(ranges):
    found = HitCounts(1)
    for at in ranges:
        found.add([asked("p", at, width=at)], np.ones((1, 1), dtype=bool))
    for by in EDGES:
        assert found.asked[by].sum() == found.hits[by].sum() == len(ranges)
    for row in found.rows(0):
        inside = sum(row["low"] <= at < row["high"] for at in ranges)
        assert row["asked"] == row["hits"] == inside > 0
