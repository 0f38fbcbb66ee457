"""Rows of studies, each figure once more by plain loops over result files and clouds."""

import csv
import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from command import gapeval

from gapeval.detection.spacing import bin_match
from gapeval.errors import GapevalError
from gapeval.frame import Frame
from gapeval.logs.read import read_frames, read_recording
from gapeval.scoring.metrics import METRICS
from gapeval.studies.cases import plan_runs
from gapeval.studies.definition import Study
from gapeval.studies.logs import place
from gapeval.studies.rows import rows_of
from gapeval.studies.runs import Recordings
from gapeval.studies.tally import COLUMN, by_labels, read_tables
from gapeval.studies.timing import figures_of
from gapeval.sweep.grid import configurations

BYS = ("label", "range", "bearing", "width", "position")
PLAIN = {"scenes": ["plain"], "seeds": 5, "frames": 2}
STUDY = {
    "title": "Rows",
    "paper": "none",
    "question": "Are the rows right?",
    "says": "nothing",
    "grid": {"n_o": [0, 1]},
    "runs": [
        {"name": "labelled", "scenes": ["street", "tunnel"], "seeds": 1, "frames": 3},
        {"name": "false", "gaps": True, "simulated": True, "conditions": {"kind": "false"}, **PLAIN},
        {
            "name": "bins",
            "kind": "bins",
            "grid": {"delta_r": [1.075, 1.3]},
            "vary": {"roll": [0.0, 0.01]},
            **PLAIN,
        },
        {"name": "time", "kind": "time", "conditions": {"kind": "time"}, **PLAIN},
    ],
    "labels_by": list(BYS),
}
RANGES = [0, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 15, 20, 30, 50]
WIDTHS = [0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1, 1.5, 2, 3]
OF_GAPS = ("recall", "over_coverage")  # follow from gaps or matches, of which labels.csv does not tell
Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("rows")
    (folder / "mine.yaml").write_text(yaml.safe_dump(STUDY, sort_keys=False))
    result = gapeval("study", folder / "mine.yaml", "-o", folder / "out", "--jobs", 2)
    assert result.status == 0, result.err
    return folder / "out"


def rows(path: Path, **wanted: str) -> Rows:
    with path.open(newline="") as file:
        return [
            row for row in csv.DictReader(file) if all(row[key] == value for key, value in wanted.items())
        ]


def figures_are(row: dict[str, str], expected: dict[str, float | None]) -> None:
    """Each figure of a row, and no other but those of OF_GAPS."""
    for name in (metric.name for metric in METRICS if metric.name not in OF_GAPS):
        value = expected.get(name)
        found = row.get(name, "")
        assert (found == "") == (value is None), (row["by"], row["group"], name)
        if value is not None:
            assert float(found) == pytest.approx(value, rel=1e-9, abs=1e-12), (row["by"], row["group"], name)


def group_of(by: str, label: dict[str, str], stamps: dict[str, list[int]]) -> str:
    if by == "label":
        return label["label"]
    if by == "position":
        return "abc"[stamps[label["log"]].index(int(label["stamp"]))]
    if by == "bearing":
        sector = math.floor(math.degrees(float(label["bearing"])) / 30)
        return repr(round(math.radians(sector * 30 + 15), 3))
    edges = RANGES if by == "range" else WIDTHS
    return repr(float(max(edge for edge in edges if edge <= float(label[by]))))


def figures_of_labels(labels: Rows) -> dict[str, float | None]:
    def known(name: str) -> list[float]:
        return [float(one[name]) for one in labels if one[name] != ""]

    def mean(values: list[float]) -> float | None:
        return sum(values) / len(values) if values else None

    hit = [one for one in labels if one["hit"] == "true"]
    area, covered = sum(known("visible_area")), sum(known("covered_area"))
    rays = sum(known("near_edge_rays"))
    found = {
        "hit_rate": len(hit) / len(labels),
        "coverage": covered / area,
        "under_coverage": 1 - covered / area,
        "splits": mean([float(one["gaps"]) for one in hit]),
        "near_edge_error": mean(known("near_edge_median")),
        "near_edge_late": mean(known("near_edge_max")),
        "near_edge_missed": sum(known("near_edge_missed")) / rays if rays else None,
        "axis_angle": mean(known("axis_angle")),
    }
    for method in ("npca", "pca"):
        for what in ("length", "yaw"):
            name = f"{method}_{what}_error"
            found[name] = mean([abs(value) for value in known(name)])
    return found


@pytest.mark.parametrize("by", BYS)
def test_groups_of_labels_are_sums_over_labels_csv(out, by) -> None:
    frames = rows(out / "mine" / "labelled" / "frames.csv")
    stamps: dict[str, list[int]] = {}
    for frame in frames:
        seen = stamps.setdefault(frame["log"], [])
        if int(frame["stamp"]) not in seen:
            seen.append(int(frame["stamp"]))
    groups: dict[tuple[str, str, str], Rows] = {}
    for label in rows(out / "mine" / "labelled" / "labels.csv"):
        if label["hit"] != "":
            for scene in ("all", label["log"].partition("-")[0]):
                key = scene, label["configuration"], group_of(by, label, stamps)
                groups.setdefault(key, []).append(label)
    found = {(row["scene"], row["configuration"], row["group"]): row for row in rows(out / "mine.csv", by=by)}
    assert found.keys() == groups.keys()
    assert len(groups) > 6
    for key, labels in groups.items():
        figures_are(found[key], figures_of_labels(labels))
        if found[key]["hit_rate"] in ("0.0", "1.0"):  # Clopper and Pearson's limits
            distinct = len({(one["log"], one["label"]) for one in labels})
            ends = (0.025 ** (1 / distinct), 1.0) if float(found[key]["hit_rate"]) else (
                0.0, 1 - 0.025 ** (1 / distinct))  # fmt: skip
            assert [float(found[key][f"hit_rate_{end}"]) for end in ("low", "high")] == pytest.approx(ends)
        assert int(found[key]["asked"]) == len(labels)
        assert int(found[key]["hits"]) == sum(one["hit"] == "true" for one in labels)
        assert int(found[key]["logs"]) == len({one["log"] for one in labels} if key[0] != "all" else stamps)


def test_groups_of_labels_add_up_to_the_sums_of_frames(out) -> None:
    """Every sum that labels add to, frame by frame and configuration by configuration."""
    planned = plan_runs("mine", Study.model_validate(STUDY), {}, None)[0]
    tables = read_tables(planned, out / "mine" / "labelled")
    for by in BYS:
        sums = sum(tally.sums for _, tally in by_labels(tables, by))
        added = sums.any(axis=(0, 1))
        added[COLUMN["axis_angles"]] = added[COLUMN["axis_angle_sum"]] = (
            False  # here of gaps, there of labels
        )
        assert added.sum() >= 15
        np.testing.assert_allclose(sums[..., added], tables.whole.sums[..., added], rtol=1e-9, atol=1e-9)
        labels = [
            frozenset().union(*of) for of in zip(*(t.labels for _, t in by_labels(tables, by)), strict=True)
        ]
        assert tuple(labels) == tables.whole.labels


def test_groups_claim_nothing_that_they_do_not_know(out) -> None:
    for by in BYS:
        assert all(row[name] == "" for row in rows(out / "mine.csv", by=by) for name in OF_GAPS)
    assert all(row["shadow_gaps"] == "" for row in rows(out / "mine.csv", by="gap_range"))


def test_false_gaps_by_range_are_those_of_gaps_csv(out) -> None:
    number = len({(row["log"], row["stamp"]) for row in rows(out / "mine" / "false" / "frames.csv")})
    groups: dict[tuple[str, str], list[float]] = {}
    for gap in rows(out / "mine" / "false" / "gaps.csv"):
        distance = math.hypot(float(gap["npca_centre_x"]), float(gap["npca_centre_y"]))
        key = gap["configuration"], repr(math.floor(distance) + 0.5)
        groups.setdefault(key, []).append(float(gap["area"]))
    configured = {row["configuration"] for row in rows(out / "mine" / "false" / "frames.csv")}
    rings = {ring for _, ring in groups}
    assert len(groups) > 2
    found = rows(out / "mine.csv", by="gap_range")
    assert {(row["scene"], row["configuration"], row["group"]) for row in found} == {
        (scene, one, ring) for scene in ("all", "plain") for one in configured for ring in rings
    }
    for row in found:
        areas = groups.get((row["configuration"], row["group"]), [])
        assert float(row["fp_per_frame"]) == pytest.approx(len(areas) / number)
        assert float(row["over_area"]) == pytest.approx(sum(areas) / number)
        assert int(row["gaps"]) == int(row["false_gaps"]) == len(areas)
        assert int(row["frames"]) == int(row["scored_frames"]) == number
        assert row["kind"] == "false"


def drawn(values: np.ndarray, statistic) -> list[float]:
    """The middle 95 % of 500 draws, one after the other."""
    chosen = np.random.default_rng(2013).integers(0, len(values), (len(values), 500))
    return np.quantile([statistic(values[one]) for one in chosen.T], (0.025, 0.975)).tolist()


def test_bins_are_held_against_echoes_log_by_log(out) -> None:
    planned = plan_runs("mine", Study.model_validate(STUDY), {}, None)[2]
    found = rows(out / "mine.csv", by="bins")
    assert len(found) == 4
    recordings = Recordings(out, {})
    both = configurations(planned.config)
    for row, (roll, configuration) in zip(found, itertools.product((0.0, 0.01), both), strict=True):
        assert float(row["roll"]) == roll
        assert row["configuration"] == configuration.id
        assert float(row["delta_r"]) == configuration.detector.delta_r
        filled, ratio = [], []
        for case in planned.cases:
            if dict(case.conditions)["roll"] != roll:
                continue
            recording = recordings.of(case, planned.config.log)
            matches = [bin_match(frame, configuration) for frame in read_frames(recording, 0, 2)]
            assert len(matches) == 2
            filled.append(np.mean([match.filled for match in matches]))
            ratio.append(np.mean([match.ratio for match in matches]))
        for name, values, statistic in (
            ("bin_filled", filled, np.mean),
            ("bin_ratio", ratio, np.mean),
            ("bin_mismatch", ratio, lambda one: abs(np.mean(np.log2(one)))),
        ):
            measured = [float(row[f"{name}{end}"]) for end in ("", "_low", "_high")]
            expected = [statistic(np.array(values)), *drawn(np.array(values), statistic)]
            assert measured == pytest.approx(expected, rel=1e-9), name
        assert (row["scene"], row["logs"]) == ("all", "5")


def test_times_are_of_every_frame(out) -> None:
    found = rows(out / "mine.csv", kind="time")
    planned = plan_runs("mine", Study.model_validate(STUDY), {}, None)[3]
    assert [row["configuration"] for row in found] == [one.id for one in configurations(planned.config)]
    points = []
    for case in planned.cases:
        recording = read_recording(place(case, out).log, planned.config.log)
        points += [len(frame.points) for frame in read_frames(recording, 0, 2) if isinstance(frame, Frame)]
    for row in found:
        assert int(row["frames"]) == len(points) == 10
        assert float(row["points"]) == np.median(points)
        least, median, p95, most = (float(row[name]) for name in ("least", "median", "p95", "most"))
        assert 0 < least <= median <= p95 <= most
        assert least <= float(row["mean"]) <= most


def test_figures_of_times() -> None:
    times = np.array([5.0, 1.0, 2.0, 3.0, 40.0])
    found = figures_of(times)
    values = {name: one.value for name, one in found.items()}
    assert values == {"median": 3.0, "p95": pytest.approx(33.0), "mean": 10.2, "least": 1.0, "most": 40.0}
    for name, statistic in (("median", np.median), ("mean", np.mean)):
        assert [found[name].low, found[name].high] == pytest.approx(drawn(times, statistic))
    assert [found["p95"].low, found["p95"].high] == pytest.approx(
        drawn(times, lambda one: np.quantile(one, 0.95))
    )


def test_the_best_of_each_scene_is_marked_once(out) -> None:
    """By pq, then by hit_rate, then by few false gaps; groups, and rows without labels, have none."""
    whole = rows(out / "mine.csv", by="", kind="", roll="")
    for scene in ("all", "street", "tunnel"):
        mine = [row for row in whole if row["scene"] == scene]
        best = [row for row in mine if row["best"] == "true"]
        assert len(mine) == 2
        order = sorted(
            mine,
            key=lambda row: (
                -float(row["pq"] or 0),
                -float(row["hit_rate"]),
                float(row["fp_per_frame"]),
                -float(row["coverage"]),
            ),
        )
        assert best == order[:1]
    assert sum(row["best"] == "true" for row in rows(out / "mine.csv")) == 3


def test_intervals_of_labels_are_those_of_the_sweep(out) -> None:
    ours = {
        (row["scene"], row["configuration"]): row for row in rows(out / "mine.csv", by="", kind="", roll="")
    }
    for theirs in rows(out / "mine" / "labelled" / "summary.csv"):
        mine = ours[theirs["log"].partition("-")[0], theirs["configuration"]]
        for name in (f"{metric.name}_{end}" for metric in METRICS for end in ("low", "high")):
            value, expected = mine.get(name, ""), theirs[name]
            assert (value == "") == (expected == ""), name
            assert value == "" or float(value) == pytest.approx(float(expected)), name


def test_bins_that_see_no_ground_are_not_measured(out, tmp_path) -> None:
    figure = {"of": "bin_ratio", "where": {"by": "bins"}}
    claim = {"claim": "it", "section": "", "words": "", "figures": {"r": figure}, "holds": "r.value > 1"}
    run = {"kind": "bins", "scenes": ["plain"]}
    (tmp_path / "bins.yaml").write_text(
        yaml.safe_dump(STUDY | {"grid": {}, "labels_by": [], "runs": [run], "claims": [claim]})
    )
    home = out / "logs" / "plain-lms151-seed0-frames2"
    log = ("--log", home / "plain.mcap", "--labels", home / "labels.geojson", "-p", "robot.ground_z=-30")
    result = gapeval("study", tmp_path / "bins.yaml", *log, "-o", tmp_path / "out", "--jobs", 1)
    assert result.status == 0, result.err
    assert [row["verdict"] for row in rows(tmp_path / "out" / "claims.csv")] == ["not measured"]
    assert "nan" not in (tmp_path / "out" / "bins.csv").read_text()


@pytest.mark.parametrize(
    ("by", "value", "group"),
    [
        ("range", 0.0, 0.0), ("range", 0.999, 0.0), ("range", 1.0, 1.0), ("range", 20.0, 20.0),
        ("range", 99.0, 50.0),
        ("width", 0.2, 0.2), ("width", 0.19, 0.0), ("width", 2.0, 2.0), ("width", 7.0, 3.0),
        ("bearing", 0.0, 0.262), ("bearing", -0.001, -0.262),
        ("bearing", 3.1, 2.88), ("bearing", -3.1, -2.88),
    ],
)  # fmt: skip
def test_a_group_holds_its_lower_edge(out, by, value, group) -> None:
    tables = read_tables(
        plan_runs("mine", Study.model_validate(STUDY), {}, None)[0], out / "mine" / "labelled"
    )
    moved = replace(tables, asked=tables.asked.assign(**{by: value}))
    assert [one for one, _ in by_labels(moved, by)] == [group]


@pytest.mark.parametrize(
    ("figure", "kept"),
    [
        ({"of": "gaps_that_no_row_has"}, {"hit_rate", "coverage"}),
        ({"of": "fp_per_frame", "minus": {"n_o": 0}}, {"fp_per_frame", "hit_rate", "coverage"}),
        ({"of": "over_area", "weigh": "n_o"}, {"over_area", "hit_rate", "coverage"}),
    ],
)
def test_draws_are_kept_of_what_claims_compare(out, figure, kept) -> None:
    claim = {"claim": "it", "section": "", "words": "", "figures": {"one": figure}, "holds": "true"}
    study = Study.model_validate(STUDY | {"claims": [claim], "labels_by": []})
    planned = plan_runs("mine", study, {}, None)[1]
    for row in rows_of(planned, study, read_tables(planned, out / "mine" / "false")):
        drawn_ones = {name for name, one in row.figures.items() if one.draws is not None}
        assert drawn_ones == kept & row.figures.keys()


def test_a_log_that_is_read_otherwise_is_another_recording(out) -> None:
    planned = plan_runs("mine", Study.model_validate(STUDY), {}, None)[1]
    recordings, settings = Recordings(out, {}), planned.config.log
    case = planned.cases[0]
    assert recordings.of(case, settings).cloud_topic == recordings.of(case, settings).cloud_topic
    assert len(recordings.opened) == 1
    with pytest.raises(GapevalError):
        recordings.of(case, settings.model_copy(update={"cloud_topic": "/another"}))
