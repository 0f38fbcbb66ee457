"""The result files: columns, fields, sums and ranks; and that they are whole or not there."""

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scenes import NOTHING, box, crossing, label, label_file, outlines

from gapeval.config import Config, Configuration, CrossingRules, Detector, Domain, Scoring
from gapeval.detections import DetectedFrame, Detections, read_detections, write_detections
from gapeval.errors import ConfigError, DetectionsError, GapevalError, LabelError
from gapeval.files import whole_file
from gapeval.frame import Frame, PoseQuality, Transform, Viewpoint, robot_plane
from gapeval.report.text import best_table, metrics_table, short
from gapeval.results import tables
from gapeval.results.from_detections import at_labelled_stamps, score_detections
from gapeval.results.from_sweep import log_names
from gapeval.results.store import open_store
from gapeval.results.tables import Point, cell, point
from gapeval.scoring.label_score import LabelScore
from gapeval.scoring.match import score
from gapeval.scoring.metrics import METRICS, SUMS, WITHOUT_LABELS, figures
from gapeval.scoring.scene import View, common_domain, common_plane, scene
from gapeval.sweep.evaluation import Answers, GapAnswer, Question, detected, evaluate, rescored

FILES = (
    *("summary.csv", "frames.csv", "labels.csv", "hits.csv", "approaches.csv", "timing.csv"),
    *("config.yaml", "manifest.json"),
)
MANIFEST = {"gapeval": "0", "logs": []}
POINTS = [point(Configuration(detector=Detector(n_o=number))) for number in (0, 1, 2)]


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def header(path):
    return path.read_text().partition("\n")[0].split(",")


def answer(hits=0, false_gaps=0, tp=0, covered=0.0, asked=4, labels=(), fallback="", gaps=()):
    """One configuration's answer for a frame of four labels of 1 m2 each."""
    sums = {"frames": 1, "scored_frames": 1, "asked": asked, "hits": hits}
    sums |= {"false_gaps": false_gaps, "tp": tp, "fn": asked - tp, "fp": false_gaps, "iou_sum": 0.75 * tp}
    sums |= {"label_area": float(asked), "covered_area": covered, "gaps": tp + false_gaps}
    return sums, tuple(labels), fallback, tuple(gaps)


def unlabelled(gaps=3):
    return {"frames": 1, "gaps": gaps}, (), "", ()


def together(answers):
    """The answers of several configurations for one frame."""
    sums, labels, fallbacks, gaps = zip(*answers, strict=True)
    added = np.array([[one.get(name, 0.0) for name in SUMS] for one in sums])
    hits = np.zeros((len(answers), 0), dtype=np.bool_)
    return Answers(added, labels, fallbacks, gaps, (), hits)


def alone(answers, row=0):
    """What one configuration contributes to the sums."""
    return dict(zip(SUMS, answers.sums[row].tolist(), strict=True))


def write(folder, frames, points=POINTS, logs=("a.bag",), with_gaps=False, config=None):
    """Result files of frames: (log, stamp, answers)."""
    timelines = {name: np.array([stamp for log, stamp, _ in frames if log == name]) for name, _, _ in frames}
    with open_store(folder, points, timelines, 2.0, with_gaps) as store:
        for log, stamp, answers in frames:
            store.add(log, stamp, together(answers), {"detect": [0.25, 0.75], "read": [0.5]})
        store.finish((config or Config()).to_yaml(), MANIFEST, logs)
    return store


# --- columns and fields ------------------------------------------------------------------------------

PARAMETERS = [
    *("k", "i_height", "i_width", "delta_r", "n_o", "pl_th", "x_min", "r_max", "z_min", "z_max"),
    *("origin", "plane", "edge", "kernel"),
    *("d_r", "standoff", "eta", "clearance", "uniform", "rules", "min_observed"),
]
COUNTED = [
    *("frames", "scored_frames", "empty_frames", "gaps", "traversable_npca", "traversable_pca"),
    *("plane_fallbacks", "asked", "hits", "tp", "fp", "fn", "false_gaps", "ignored", "not_counted"),
]
LABEL_COLUMNS = [
    *("log", "stamp", "configuration", "label", "state", "range", "length", "visible_area"),
    *("covered_area", "iou", "hit", "gaps"),
    *("near_edge_median", "near_edge_max", "near_edge_rays", "near_edge_missed", "bearing", "width", "area"),
    *("npca_traversable", "npca_length_error", "npca_yaw_error"),
    *("pca_traversable", "pca_length_error", "pca_yaw_error", "axis_angle", "traversable"),
]


def test_columns_are_the_documented_ones(tmp_path):
    write(tmp_path, [("a.bag", 1, [unlabelled()] * 3)], with_gaps=True)
    names = [metric.name for metric in METRICS]
    each = [column for name in names for column in (name, f"{name}_low", f"{name}_high")]
    approached = ["first_hit_range", "towards_missed"]
    summary = ["log", "configuration", *PARAMETERS, "best", *each, *approached, *COUNTED]
    assert header(tmp_path / "summary.csv") == summary
    pose = ["pose_gap", "pose_roll", "pose_pitch", "pose_height"]
    frames = ["log", "stamp", "configuration", "plane_fallback", *pose, *SUMS]
    assert header(tmp_path / "frames.csv") == frames
    assert header(tmp_path / "labels.csv") == LABEL_COLUMNS
    assert header(tmp_path / "timing.csv") == ["log", "stage", "shared_by", "frames", "median", "p95"]
    known = ["traversable", "reason", "length", "yaw"]
    known += [f"{spot}_{axis}" for spot in ("centre", "start", "end") for axis in "xyz"]
    crossings = [f"{method}_{name}" for method in ("npca", "pca") for name in (*known, "tie")]
    gaps = ["log", "stamp", "configuration", "gap", "area", "weight", *crossings]
    assert header(tmp_path / "gaps.csv") == gaps


def test_no_column_is_there_twice_and_each_has_a_meaning():
    for columns in tables.FILES.values():
        assert len(set(columns)) == len(columns)
        assert all(tables.meanings()[name] for name in columns)


def test_every_detector_and_crossing_parameter_but_the_patch_is_a_column():
    expected = {*Detector.model_fields, *CrossingRules.model_fields} - {"patch"}
    assert set(PARAMETERS) == expected


def test_parameters_stand_beside_the_configuration(tmp_path):
    detector = Detector(k=5, i_height=9, delta_r=1.02, z_min=math.inf)
    mine = point(Configuration(detector=detector, crossing=CrossingRules(eta=0.1)))
    write(tmp_path, [], [mine])
    (row,) = [row for row in rows(tmp_path / "summary.csv") if row["log"] == "all"]
    assert row["configuration"] == Configuration(detector=detector, crossing=CrossingRules(eta=0.1)).id
    found = {
        name: row[name] for name in ("k", "i_height", "i_width", "delta_r", "z_min", "eta", "d_r", "n_o")
    }
    assert found == {
        "k": "5",
        "i_height": "9",
        "i_width": "33",
        "delta_r": "1.02",
        "z_min": "inf",
        "eta": "0.1",
        "d_r": "0.34",
        "n_o": "1",
    }


def test_k_is_empty_where_it_decides_nothing():
    assert point(Configuration(detector=Detector(i_height=9, i_width=9))).parameters["k"] is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, ""),
        (True, "true"),
        (False, "false"),
        (0.1 + 0.2, "0.30000000000000004"),
        (np.float64(0.1), "0.1"),
        (3.0, "3.0"),
        (1e-30, "1e-30"),
        (2**60 + 1, "1152921504606846977"),
        ("shadowed", "shadowed"),
    ],
)
def test_fields(value, text):
    assert cell(value) == text


LABEL = LabelScore(
    *("t", "partly", 0.1 + 0.2, None, 2.0, 1.0, 1 / 3, True, 2),
    *(-0.25, 0.5, 12, 3, -0.1, 0.6, 2.5),
    *(False, 0.125, None, True, -0.5, 0.25, 1.5),
)
HIDDEN = LabelScore("h", "shadowed", 4.0, 0.5, 0.0, None, None, None, None, bearing=0.5, width=0.5, area=1.0)


def test_rows_of_labels(tmp_path):
    write(tmp_path, [("a.bag", 2**60 + 1, [answer(labels=[LABEL, HIDDEN])])], POINTS[:1])
    first, second = rows(tmp_path / "labels.csv")
    shown = {"log": "a.bag", "stamp": str(2**60 + 1), "configuration": POINTS[0].id}
    assert first == shown | {
        "label": "t",
        "state": "partly",
        "range": "0.30000000000000004",
        "length": "",
        "visible_area": "2.0",
        "covered_area": "1.0",
        "iou": repr(1 / 3),
        "hit": "true",
        "gaps": "2",
        "near_edge_median": "-0.25",
        "near_edge_max": "0.5",
        "near_edge_rays": "12",
        "near_edge_missed": "3",
        "bearing": "-0.1",
        "width": "0.6",
        "area": "2.5",
        "npca_traversable": "false",
        "npca_length_error": "0.125",
        "npca_yaw_error": "",
        "pca_traversable": "true",
        "pca_length_error": "-0.5",
        "pca_yaw_error": "0.25",
        "axis_angle": "1.5",
        "traversable": "",
    }
    assert second == shown | dict.fromkeys(LABEL_COLUMNS[8:], "") | {
        "label": "h",
        "state": "shadowed",
        "range": "4.0",
        "length": "0.5",
        "visible_area": "0.0",
        "bearing": "0.5",
        "width": "0.5",
        "area": "1.0",
    }


def test_rows_of_gaps_on_request(tmp_path):
    gap = GapAnswer(1 / 3, {"npca": crossing(length=0.1, yaw=-0.5)})
    write(tmp_path, [("a.bag", 1, [answer(gaps=[gap])])], POINTS[:1], with_gaps=True)
    (row,) = rows(tmp_path / "gaps.csv")
    assert (row["gap"], row["area"], row["npca_length"], row["npca_yaw"]) == ("0", repr(1 / 3), "0.1", "-0.5")
    assert (row["npca_traversable"], row["npca_tie"], row["npca_reason"]) == ("true", "false", "")
    assert [row[f"npca_centre_{axis}"] for axis in "xyz"] == ["1.0", "2.0", "3.0"]
    assert all(value == "" for name, value in row.items() if name.startswith("pca_"))


def test_gaps_are_not_written_unless_asked_for(tmp_path):
    write(tmp_path, [("a.bag", 1, [answer(gaps=[GapAnswer(1.0, {})])])], POINTS[:1])
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)


def test_sums_of_a_frame_that_was_not_labelled_are_empty_not_zero(tmp_path):
    write(tmp_path, [("a.bag", 1, [unlabelled()]), ("a.bag", 2, [answer(hits=2)])], POINTS[:1])
    first, second = rows(tmp_path / "frames.csv")
    assert {name for name in SUMS if first[name] != ""} == set(WITHOUT_LABELS)
    assert (first["gaps"], first["asked"], second["asked"], second["hits"]) == ("3", "", "4", "2")
    assert second["iou_sum"] == "0.0"  # a sum of areas or ratios is a float, a count is none
    assert second["label_area"] == "4.0"


def test_figures_that_are_undefined_are_empty(tmp_path):
    write(tmp_path, [("a.bag", 1, [unlabelled()])], POINTS[:1])
    for row in rows(tmp_path / "summary.csv"):
        assert all(row[metric.name] == "" for metric in METRICS)
        assert (row["frames"], row["gaps"], row["asked"]) == ("1", "3", "")
    write(tmp_path, [("a.bag", 1, [answer()])], POINTS[:1])
    (row, _) = rows(tmp_path / "summary.csv")
    assert (row["hit_rate"], row["splits"], row["sq"], row["precision"]) == ("0.0", "", "", "")


def test_a_fallback_is_told(tmp_path):
    write(tmp_path, [("a.bag", 1, [answer(fallback="patch has too few points"), answer()])], POINTS[:2])
    assert [row["plane_fallback"] for row in rows(tmp_path / "frames.csv")] == [
        "patch has too few points",
        "",
    ]


def test_how_well_the_pose_is_known_stands_beside_each_configuration(tmp_path):
    """Nothing where it is not known, as a whole or in part."""
    known = replace(together([answer(), answer()]), quality=PoseQuality(0.25, 0.001, 0.0, math.nan))
    for quality, expected in (
        (known, ("0.25", "0.001", "0.0", "")),
        (together([answer(), answer()]), ("",) * 4),
    ):
        with open_store(tmp_path, POINTS[:2], {"a.bag": np.array([1])}, 2.0) as store:
            store.add("a.bag", 1, quality, {})
            store.finish("", {}, ["a.bag"])
        for row in rows(tmp_path / "frames.csv"):
            assert tuple(row[f"pose_{name}"] for name in ("gap", "roll", "pitch", "height")) == expected
            assert row["frames"] == "1"


def test_a_gap_has_the_weight_that_its_pose_leaves(tmp_path):
    gaps = [GapAnswer(1.0, {}, 0.9), GapAnswer(1.0, {})]
    write(tmp_path, [("a.bag", 1, [answer(gaps=gaps)])], POINTS[:1], with_gaps=True)
    assert [row["weight"] for row in rows(tmp_path / "gaps.csv")] == ["0.9", ""]


# --- sums over logs ----------------------------------------------------------------------------------


def test_all_is_the_sum_over_logs_divided_once(tmp_path):
    frames = [
        ("a.bag", 1, [answer(hits=4, covered=4.0, asked=4), answer()]),
        ("a.bag", 2, [answer(hits=1, covered=1.0, asked=1), answer()]),
        ("b.bag", 1, [answer(hits=0, covered=0.5, asked=10, false_gaps=2), answer(tp=4)]),
    ]
    store = write(tmp_path, frames, POINTS[:2], logs=("a.bag", "b.bag"))
    found = {(row["log"], row["configuration"]): row for row in rows(tmp_path / "summary.csv")}
    ids = [POINTS[0].id, POINTS[1].id]
    assert list(found) == [(log, name) for log in ("a.bag", "b.bag", "all") for name in ids]
    for name in ids:
        for count in COUNTED:
            logs = [int(found[log, name][count]) for log in ("a.bag", "b.bag")]
            assert int(found["all", name][count]) == sum(logs), count
    assert [float(found[log, ids[0]]["hit_rate"]) for log in ("a.bag", "b.bag", "all")] == [1.0, 0.0, 5 / 15]
    assert float(found["all", ids[0]]["coverage"]) == 5.5 / 15
    assert float(found["all", ids[0]]["fp_per_frame"]) == 2 / 3
    assert store.sums(POINTS[0])["hits"] == 5
    assert store.sums(POINTS[0], "b.bag")["hits"] == 0


def test_rows_of_frames_are_ordered_by_log_stamp_and_configuration(tmp_path):
    frames = [(log, stamp, [answer()] * 3) for log in ("b.bag", "a.bag") for stamp in (1, 2)]
    write(tmp_path, frames, logs=("b.bag", "a.bag"))
    found = [(r["log"], r["stamp"], r["configuration"]) for r in rows(tmp_path / "frames.csv")]
    ids = [one.id for one in POINTS]
    assert found == [(log, stamp, name) for log in ("b.bag", "a.bag") for stamp in "12" for name in ids]


def test_the_best_row_of_each_log_is_marked(tmp_path):
    frames = [
        ("a.bag", 1, [answer(hits=3), answer(hits=4), answer(hits=0)]),
        ("b.bag", 1, [answer(hits=4), answer(hits=0), answer(hits=0)]),
    ]
    write(tmp_path, frames, logs=("a.bag", "b.bag"))
    best = {r["log"]: r["configuration"] for r in rows(tmp_path / "summary.csv") if r["best"] == "true"}
    assert best == {"a.bag": POINTS[1].id, "b.bag": POINTS[0].id, "all": POINTS[0].id}
    assert sum(row["best"] != "" for row in rows(tmp_path / "summary.csv")) == 3


@pytest.mark.parametrize(
    "answers",
    [
        [answer(hits=1), answer(hits=2), answer(hits=1)],
        [answer(hits=2, false_gaps=2), answer(hits=2, false_gaps=1), answer(hits=1)],
        [answer(hits=2, tp=1), answer(hits=2, tp=2), answer(hits=2, tp=1)],
        [answer(hits=2, covered=1.0), answer(hits=2, covered=2.0), answer(hits=2, covered=1.5)],
        [answer(hits=4, covered=4.0), answer(hits=1, tp=2, false_gaps=1), answer(hits=4, tp=1)],
        [answer(hits=1, tp=1, covered=4.0), answer(hits=2, tp=1), answer(hits=1, tp=1)],
    ],
    ids=["hit rate", "false gaps", "pq", "coverage", "pq before all", "then hits"],
)
def test_what_is_best(tmp_path, answers):
    store = write(tmp_path, [("a.bag", 1, answers)])
    assert store.ranked()[0] == POINTS[1]


def test_among_equals_the_first_of_the_grid_is_best(tmp_path):
    assert write(tmp_path, [("a.bag", 1, [answer(hits=1)] * 3)]).ranked() == POINTS


def test_nothing_is_best_without_labels_or_without_choice(tmp_path):
    assert write(tmp_path, [("a.bag", 1, [unlabelled()] * 3)]).ranked() == []
    assert all(row["best"] == "" for row in rows(tmp_path / "summary.csv"))
    write(tmp_path, [("a.bag", 1, [answer(hits=4)])], POINTS[:1])
    assert all(row["best"] == "" for row in rows(tmp_path / "summary.csv"))


def test_timing(tmp_path):
    write(tmp_path, [("a.bag", stamp, [answer()] * 3) for stamp in (1, 2)])
    detect, read = rows(tmp_path / "timing.csv")
    # Two executions per frame for three configurations; half a second each on average.
    expected = {"log": "a.bag", "stage": "detect", "shared_by": "1.5", "frames": "2"}
    assert detect == expected | {"median": "0.5", "p95": "0.5"}
    assert (read["stage"], read["shared_by"]) == ("read", "3.0")


def test_configuration_and_manifest_are_written(tmp_path):
    config = Config(grid={"detector.k": [5, 6]}, detector=Detector(n_o=2))
    write(tmp_path, [("a.bag", 1, [answer()] * 3)], config=config)
    assert Config.model_validate(yaml.safe_load((tmp_path / "config.yaml").read_text())) == config
    assert json.loads((tmp_path / "manifest.json").read_text()) == MANIFEST


# --- whole or not there ------------------------------------------------------------------------------


class BreakOffError(Exception):
    pass


@pytest.mark.parametrize("error", [BreakOffError, KeyboardInterrupt, OSError])
def test_files_appear_only_if_the_block_ends_well(tmp_path, error):
    folder = tmp_path / "new"

    def interrupted():
        with open_store(folder, POINTS, {"a.bag": np.array([1])}, 2.0) as store:
            store.add("a.bag", 1, together([answer()] * 3), {})
            assert not any((folder / name).exists() for name in FILES)
            raise error

    with pytest.raises((error, GapevalError)):
        interrupted()
    assert list(folder.iterdir()) == []


def test_an_older_result_stays_until_the_new_one_is_complete(tmp_path):
    write(tmp_path, [("a.bag", 1, [answer(hits=1)] * 3)])
    before = {name: (tmp_path / name).read_bytes() for name in FILES}

    def interrupted():
        with open_store(tmp_path, POINTS, {"a.bag": np.array([1])}, 2.0) as store:
            store.add("a.bag", 1, together([answer(hits=2)] * 3), {})
            assert {name: (tmp_path / name).read_bytes() for name in FILES} == before
            raise BreakOffError

    with pytest.raises(BreakOffError):
        interrupted()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    write(tmp_path, [("a.bag", 1, [answer(hits=2)] * 3)])
    assert rows(tmp_path / "frames.csv")[0]["hits"] == "2"


def test_gaps_of_an_older_result_do_not_stay_beside_a_new_one_without(tmp_path):
    write(tmp_path, [("a.bag", 1, [answer(gaps=[GapAnswer(1.0, {})])])], POINTS[:1], with_gaps=True)
    write(tmp_path, [("b.bag", 1, [answer()])], POINTS[:1], logs=("b.bag",))
    assert not (tmp_path / "gaps.csv").exists()


def test_a_single_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "d.geojson"
    path.write_text("old")

    def interrupted():
        with whole_file(path) as file:
            file.write("new")
            raise BreakOffError

    with pytest.raises(BreakOffError):
        interrupted()
    assert [found.name for found in tmp_path.iterdir()] == ["d.geojson"]
    assert path.read_text() == "old"
    with whole_file(path) as file:
        file.write("new")
    assert path.read_text() == "new"


def test_a_folder_that_cannot_be_written_is_named_in_one_line(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(GapevalError) as caught, open_store(folder, POINTS, {"a.bag": np.array([1])}, 2.0):
            pass
        assert str(caught.value).startswith(f"{folder}: cannot write here: ")
        assert str(caught.value).endswith("choose another folder")
        assert "\n" not in str(caught.value)


def test_an_error_of_reading_is_not_blamed_on_the_folder(tmp_path):
    def reading():
        with open_store(tmp_path, POINTS, {"a.bag": np.array([1])}, 2.0):
            (tmp_path / "drive.bag").read_bytes()

    with pytest.raises((OSError, GapevalError)) as caught:
        reading()
    assert "cannot write" not in str(caught.value)


# --- names of logs -----------------------------------------------------------------------------------


def test_logs_are_called_by_their_path_below_their_common_parent(tmp_path):
    assert log_names([tmp_path / "a.bag"]) == ("a.bag",)
    assert log_names([tmp_path / "x" / "a.bag", tmp_path / "y" / "a.bag"]) == ("x/a.bag", "y/a.bag")
    assert log_names([tmp_path / "a.bag", tmp_path / "y" / "z" / "a.bag"]) == ("a.bag", "y/z/a.bag")
    assert log_names([Path("b.bag"), Path("a.bag")]) == ("b.bag", "a.bag")


def test_a_log_that_is_named_twice_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="a log is named twice"):
        log_names([tmp_path / "a.bag", tmp_path / "x" / ".." / "a.bag"])


def test_a_log_called_all_is_not_taken_for_all_logs(tmp_path):
    frames = [("all", 1, [answer(hits=1)]), ("b.bag", 1, [answer(hits=1)])]
    store = write(tmp_path, frames, POINTS[:1], logs=("all", "b.bag"))
    assert store.sums(POINTS[0])["hits"] == 2


# --- text --------------------------------------------------------------------------------------------


def test_the_table_of_metrics_has_every_metric_with_unit_and_meaning():
    text = metrics_table(answer(hits=3, tp=2)[0])
    lines = {line.split()[0]: line for line in text.splitlines() if line}
    for metric in METRICS:
        assert metric.meaning in lines[metric.name]
    assert lines["hit_rate"].split()[1] == "0.75"
    assert lines["splits"].split()[1] == "0"
    assert lines["axis_angle"].split()[1] == "-"
    assert "asked 4  hits 3  tp 2  fp 0  fn 2" in text


def test_the_table_of_the_best_shows_what_differs(tmp_path):
    store = write(tmp_path, [("a.bag", 1, [answer(hits=1), answer(hits=3), answer(hits=2)])])
    lines = best_table(store).splitlines()
    head = next(index for index, line in enumerate(lines) if line.startswith("configuration"))
    assert lines[head].split()[:3] == ["configuration", "n_o", "hit_rate"]
    found = [line.split()[:3] for line in lines[head + 1 : head + 4]]
    assert found == [[POINTS[1].id, "1", "0.75"], [POINTS[2].id, "2", "0.5"], [POINTS[0].id, "0", "0.25"]]
    assert lines[head + 4 :] == [
        "",
        f"95 % intervals of {POINTS[1].id}: fp_per_frame 0 to 3.689, pq 0 to 0.975; see scoring.md",
    ]


def test_without_labels_there_is_no_best_table(tmp_path):
    text = best_table(write(tmp_path, [("a.bag", 1, [unlabelled()] * 3)]))
    assert text == "No labels, so no configuration is better than another."


@pytest.mark.parametrize(("value", "text"), [(None, "-"), (1 / 3, "0.3333"), (12, "12"), (1e-7, "1e-07")])
def test_short_figures(value, text):
    assert short(value) == text


# --- scores of a detections file ---------------------------------------------------------------------

DOMAIN = box(0, -5, 10, 5)
PIT = box(2, 0, 4, 1)


def detected_frame(stamp=5, polygons=(PIT,), domain=DOMAIN):
    plane = robot_plane(0.0)
    gaps = outlines(polygons)
    crossings = [{"npca": crossing(index), "pca": crossing(index, "pca")} for index in range(len(gaps))]
    return DetectedFrame(stamp, None, plane, plane, domain, NOTHING, (0.0, 0.0), gaps, crossings)


def detections(*frames, configuration=None, log="drive.bag"):
    path = Path("d.geojson")
    return Detections(path, "base_link", "map", log, "ab", configuration, frames, 0)


def pit_label(**known):
    return label("p", PIT, **({"start": 0, "end": 100} | known))


def test_each_labelled_frame_is_scored(tmp_path):
    found = detections(detected_frame(5), detected_frame(6, ()), detected_frame(7))
    labels = label_file(pit_label(), stamps=frozenset({5, 6}))
    scored = score_detections(found, labels, Config(), 0, tmp_path)
    assert (scored.sums["frames"], scored.sums["scored_frames"], scored.sums["hits"]) == (3, 2, 1)
    assert scored.unmatched == 0
    first, second, third = rows(tmp_path / "frames.csv")
    assert [first["hits"], second["hits"], third["hits"]] == ["1", "0", ""]
    assert {row["log"] for row in rows(tmp_path / "summary.csv")} == {"drive.bag", "all"}
    assert first["configuration"] == "foreign"


def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert score_detections(detections(detected_frame()), label_file(pit_label()), Config(), 0, None).sums[
        "hits"
    ]
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_ours_is_filed_under_its_configuration(tmp_path):
    mine = Configuration(detector=Detector(k=5, n_o=2))
    said = {"id": mine.id} | json.loads(mine.model_dump_json())
    found = detections(detected_frame(), configuration=said)
    score_detections(found, label_file(pit_label()), Config(), 0, tmp_path)
    row = rows(tmp_path / "summary.csv")[0]
    assert (row["configuration"], row["k"], row["n_o"]) == (mine.id, "5", "2")


def moved(frames, stamps, tolerance):
    kept, unmatched = at_labelled_stamps(
        [detected_frame(stamp) for stamp in frames], label_file(stamps=frozenset(stamps)), tolerance
    )
    return [frame.stamp for frame in kept], unmatched


def test_stamps_match_exactly_unless_a_tolerance_is_given():
    assert moved([95, 205], [100, 200], 0) == ([95, 205], 2)
    assert moved([95, 205], [100, 200], 5) == ([100, 200], 0)
    assert moved([95, 206], [100, 200], 5) == ([100, 206], 1)
    assert moved([100], [100, 200], 0) == ([100], 1)


def test_an_exact_match_wins_over_a_near_one():
    assert moved([95, 100], [100], 10) == ([95, 100], 0)
    assert moved([100, 105], [100], 10) == ([100, 105], 0)


def test_a_nearer_frame_wins_over_a_farther_one():
    assert moved([92, 101], [100], 10) == ([92, 100], 0)


def test_a_frame_that_is_not_labelled_is_not_scored_twice_under_tolerance():
    labels = label_file(pit_label(), stamps=frozenset({10}))
    found = detections(detected_frame(8, ()), detected_frame(10))
    scored = score_detections(found, labels, Config(), 5, None)
    assert (scored.sums["scored_frames"], scored.sums["hits"]) == (1, 1)


def test_a_file_without_domain_takes_the_box_of_the_options():
    found = detections(detected_frame(5, [PIT, box(8, 0, 9, 1)], domain=None))
    with pytest.raises(ConfigError, match="no domain in the file"):
        score_detections(found, label_file(pit_label()), Config(), 0, None)
    near = Config(scoring=Scoring(domain=Domain(x_min=0.5, r_max=6)))
    scored = score_detections(found, label_file(pit_label()), near, 0, None)
    assert (scored.sums["hits"], scored.sums["not_counted"], scored.sums["false_gaps"]) == (1, 1, 0)


def test_a_file_without_frames_is_refused():
    with pytest.raises(DetectionsError, match="no frames"):
        score_detections(detections(), label_file(), Config(), 0, None)


def test_labels_of_another_frame_are_refused():
    drawn = label_file(label("p", PIT, start=None, end=None))
    with pytest.raises(LabelError, match="moves with the robot frame"):
        score_detections(detections(detected_frame()), drawn, Config(), 0, None)


def field_with_a_hole(stamp=5):
    """Ground seen by a rolling laser, but for a hole, and a wall to the left of it."""
    x, y = np.meshgrid(np.arange(-1, 3.5, 0.04), np.arange(-3, 3, 0.04))
    keep = ~((x > 1.5) & (x < 2.1) & (abs(y) < 0.8))
    ground = np.column_stack([x[keep], y[keep], np.zeros(keep.sum())])
    wall = np.array([(1.2, side, up) for side in np.arange(0.9, 2.1, 0.008) for up in (0.1, 0.5, 0.9)])
    points = np.vstack([ground, wall]).astype(np.float32)
    tilt = [0.0, 0.02, 0.1, math.sqrt(1 - 0.02**2 - 0.01)]
    return Frame(
        stamp, points, Transform.of([0.1, 0.0, 0.6], [0, 0, 0, 1]), -1.2, Transform.of([3, 2, 1], tilt)
    )


UP = (0.02, -0.03, math.sqrt(1 - 0.02**2 - 0.03**2))
ELSEWHERE = Viewpoint(Transform.of([-0.6, 0.8, 0.7], [0, 0, 0, 1]), -1.2)


QUALITY = PoseQuality(0.05, 0.01, 0.02, math.nan)


@pytest.mark.parametrize("others", [(), (ELSEWHERE,)])
@pytest.mark.parametrize("plane", ["robot", "patch", "gravity"])
def test_detect_then_score_is_exactly_what_sweep_gives(tmp_path, plane, others):
    chosen = Configuration(detector=Detector(plane=plane))
    rules, frame = Scoring(), replace(field_with_a_hole(), others=others, up=UP, quality=QUALITY)
    drawn = label("hole", box(1.5, -0.8, 2.1, 0.8), traversable=True, length=0.6, crossing_yaw=0.0)
    other = label("behind the wall", box(1.4, 1.8, 1.9, 2.2))
    labels = label_file(drawn, other)
    where = common_domain([chosen], rules)
    question = Question((chosen,), rules, *where, plane=common_plane([chosen]))
    swept, _ = evaluate(frame, question, labels, "base_link")
    path = tmp_path / "d.geojson"
    with path.open("w") as file:
        found = {"frame_id": "base_link", "fixed_frame": "map", "log": {}, "configuration": {}}
        write_detections(file, found, [detected(frame, chosen, question)])
    again = rescored(read_detections(path).frames[0], labels, "base_link", rules)
    assert alone(again) == alone(swept)
    assert again.labels == swept.labels
    assert repr(again.quality) == repr(swept.quality) == repr(QUALITY)
    assert alone(swept)["hits"] == 1
    assert {row.state for row in swept.labels[0]} == {"visible", "shadowed"}


def test_a_sweep_gives_each_configuration_what_it_gets_alone():
    rules, frame = Scoring(domain=Domain(x_min=0.6, r_max=3)), field_with_a_hole()
    found = tuple(
        Configuration(detector=Detector(k=k, n_o=n_o, pl_th=pl_th))
        for k in (4, 6)
        for n_o in (0, 1, 2)
        for pl_th in (0.05, 0.2)
    )
    labels = label_file(label("hole", box(1.5, -0.8, 2.1, 0.8), length=0.6))
    swept, _ = evaluate(frame, Question(found, rules, rules.domain, "sensor"), labels, "base_link")
    for row, chosen in enumerate(found):
        question = Question((chosen,), rules, rules.domain, "sensor")
        assert alone(evaluate(frame, question, labels, "base_link")[0]) == alone(swept, row)
    assert len({figures(alone(swept, row))["coverage"] for row in range(len(found))}) > 3


def test_a_frame_that_was_not_labelled_is_not_scored():
    question = Question((Configuration(),), Scoring(), Domain(x_min=0.6, r_max=3), "sensor", keep_gaps=True)
    labels = label_file(label("hole", box(1.5, -0.8, 2.1, 0.8)), stamps=frozenset({6}))
    for drawn in (None, labels):
        found, _ = evaluate(field_with_a_hole(), question, drawn, "base_link")
        assert alone(found)["scored_frames"] == 0
        assert found.labels == ((),)
        assert len(found.gaps[0]) == alone(found)["gaps"] > 0


def test_scoring_a_scene_by_hand_equals_scoring_the_file():
    frame, rules = detected_frame(polygons=[PIT, box(6, 0, 7, 1)]), Scoring()
    labels = label_file(pit_label(traversable=True))
    seen = scene(5, None, View(frame.plane, DOMAIN, NOTHING, (0.0, 0.0)), labels, "base_link", rules)
    by_hand = score(seen, frame.polygons, frame.crossings, rules).sums | {"plane_fallbacks": 0}
    assert alone(rescored(frame, labels, "base_link", rules)) == by_hand


def test_points_are_what_results_are_filed_under():
    assert point(Configuration()) == Point(Configuration().id, tables.parameters(Configuration()))
