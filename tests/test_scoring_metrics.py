"""From sums over frames to figures, and what is judged of crossings."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import box, crossing, label, scored

from gapeval.config import Scoring
from gapeval.scoring.crossings import axial_angle
from gapeval.scoring.metrics import COUNTS, METRICS, SUMS, figures

DOMAIN = box(0, -10, 20, 10)

SUMS_BY_HAND = {
    "frames": 10,
    "scored_frames": 8,
    "gaps": 50,
    "asked": 20,
    "hits": 15,
    "pairs": 24,
    "pairs_on_hits": 18,
    "paired_gaps": 16,
    "tp": 12,
    "fp": 4,
    "fn": 8,
    "false_gaps": 2,
    "iou_sum": 9.0,
    "label_area": 40.0,
    "covered_area": 30.0,
    "over_area_sum": 6.0,
    "axis_angles": 48,
    "axis_angle_sum": 12.0,
    "npca_judged": 10,
    "npca_right": 9,
    "npca_lengths": 5,
    "npca_length_error_sum": 0.5,
    "npca_yaws": 4,
    "npca_yaw_error_sum": 1.0,
    "pca_judged": 8,
    "pca_right": 2,
    "pca_lengths": 4,
    "pca_length_error_sum": 3.0,
    "pca_yaws": 2,
    "pca_yaw_error_sum": 0.25,
    "edges": 16,
    "edge_median_sum": 0.8,
    "edge_max_sum": 4.0,
    "edge_rays": 200,
    "edge_rays_missed": 30,
    "paired_over_area_sum": 5.0,
    "shadowed_gaps": 1,
}
BY_HAND = {
    "hit_rate": 15 / 20,
    "coverage": 30 / 40,
    "over_area": 6 / 8,
    "fp_per_frame": 2 / 8,
    "splits": 18 / 15,
    "merges": 24 / 16,
    "precision": 12 / 16,
    "recall": 12 / 20,
    "f1": 24 / 36,
    "sq": 9 / 12,
    "rq": 24 / 36,
    "pq": 9 / (12 + 4 / 2 + 8 / 2),
    "npca_accuracy": 9 / 10,
    "npca_length_error": 0.5 / 5,
    "npca_yaw_error": 1 / 4,
    "pca_accuracy": 2 / 8,
    "pca_length_error": 3 / 4,
    "pca_yaw_error": 0.25 / 2,
    "axis_angle": 12 / 48,
    "near_edge_error": 0.8 / 16,
    "near_edge_late": 4 / 16,
    "near_edge_missed": 30 / 200,
    "under_coverage": 10 / 40,
    "over_coverage": 5 / 40,
    "shadow_gaps": 1 / 8,
}
HIGHER = {"hit_rate", "coverage", "precision", "recall", "f1", "sq", "rq", "pq"}


@pytest.mark.parametrize("name", BY_HAND)
def test_figures_by_hand(name):
    assert figures(SUMS_BY_HAND)[name] == pytest.approx(BY_HAND[name], abs=1e-15)


def test_every_metric_is_tested_by_hand_and_described():
    assert [metric.name for metric in METRICS] == list(BY_HAND)
    for metric in METRICS:
        assert metric.unit in ("1", "m", "m2", "rad")
        assert metric.meaning
        higher = metric.name in HIGHER or "accuracy" in metric.name
        better = "higher" if higher else "none" if metric.name == "axis_angle" else "lower"
        assert metric.better == better, metric.name


def test_names_are_unique_and_counts_are_sums():
    names = [*(metric.name for metric in METRICS), *SUMS]
    assert len(set(names)) == len(names)
    assert set(COUNTS) <= set(SUMS)


def test_without_anything_every_figure_is_undefined():
    assert figures({}) == dict.fromkeys(BY_HAND)


def test_pq_is_sq_times_rq():
    found = figures(SUMS_BY_HAND)
    assert found["pq"] == pytest.approx(found["sq"] * found["rq"], abs=1e-15)


def test_pq_of_gaps_without_a_match_is_zero_while_sq_is_undefined():
    found = figures({"tp": 0, "fp": 3, "fn": 1, "asked": 1})
    assert (found["pq"], found["sq"], found["precision"], found["recall"]) == (0.0, None, 0.0, 0.0)


def test_frames_are_summed_first_and_divided_once():
    frames = [
        {"asked": 1, "hits": 1, "label_area": 1.0, "covered_area": 1.0},
        {"asked": 3, "hits": 0, "label_area": 7.0, "covered_area": 1.0},
    ]
    found = figures({name: sum(frame[name] for frame in frames) for name in frames[0]})
    assert (found["hit_rate"], found["coverage"]) == (0.25, 0.25)  # the mean of the frames' would be 0.57


def test_sums_of_a_scored_frame_are_the_documented_ones():
    found = scored(DOMAIN, [label("p", box(0, 0, 1, 1))], [box(0, 0, 1, 1)]).sums
    assert set(found) == set(SUMS)


# --- angles ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (0.0, 0.0, 0.0),
        (0.0, math.pi, 0.0),
        (math.pi, -math.pi, 0.0),
        (0.0, math.pi / 2, math.pi / 2),
        (-math.pi / 2, math.pi / 2, 0.0),
        (0.1, math.pi - 0.1, 0.2),
        (3.0, -3.0, 2 * math.pi - 6.0),
        (-0.75 * math.pi, 0.0, math.pi / 4),
    ],
)
def test_axial_angles_by_hand(one, other, expected):
    assert axial_angle(one, other) == pytest.approx(expected, abs=1e-12)


@settings(deadline=None, derandomize=True)
@given(st.floats(-7, 7), st.floats(-7, 7), st.integers(-3, 3))
def test_axial_angles_know_no_sign(one, other, turns):
    angle = axial_angle(one, other)
    assert 0 <= angle <= math.pi / 2
    assert axial_angle(other, one) == pytest.approx(angle, abs=1e-12)
    assert axial_angle(one + turns * math.pi, other) == pytest.approx(angle, abs=1e-9)
    # The angle between two lines, from their unit vectors.
    assert math.cos(angle) == pytest.approx(abs(math.cos(one - other)), abs=1e-9)


# --- crossings ---------------------------------------------------------------------------------------

PIT = box(2, 0, 4, 1)


def of_gap(gap, **npca):
    """Both crossings of a gap; pca differs in what is not given."""
    return {
        "npca": crossing(gap, "npca", **npca),
        "pca": crossing(gap, "pca", **({"traversable": False, "length": 3.0, "yaw": 0.5} | npca)),
    }


def judged(labels, gaps, crossings, **options):
    return scored(DOMAIN, labels, gaps, crossings=crossings, **options).sums


def test_crossings_are_judged_where_the_label_says_something():
    trench = label("t", PIT, traversable=True, length=1.5, crossing_yaw=math.pi)
    crossings = [
        {
            "npca": crossing(0, "npca", True, 1.25, 0.25),
            "pca": crossing(0, "pca", False, 2.0, math.pi / 2),
        }
    ]
    found = judged([trench], [PIT], crossings)
    assert (found["npca_judged"], found["npca_right"]) == (1, 1)
    assert (found["pca_judged"], found["pca_right"]) == (1, 0)
    assert (found["npca_lengths"], found["npca_length_error_sum"]) == (1, 0.25)
    assert (found["pca_lengths"], found["pca_length_error_sum"]) == (1, 0.5)
    assert found["npca_yaw_error_sum"] == pytest.approx(0.25, abs=1e-12)
    assert found["pca_yaw_error_sum"] == pytest.approx(math.pi / 2, abs=1e-12)
    assert (found["npca_yaws"], found["pca_yaws"]) == (1, 1)
    assert (found["traversable_npca"], found["traversable_pca"]) == (1, 0)


def test_a_label_that_says_nothing_judges_nothing():
    found = judged([label("t", PIT)], [PIT], [of_gap(0)])
    silent = ("judged", "right", "lengths", "length_error_sum", "yaws", "yaw_error_sum")
    assert all(found[f"{method}_{name}"] == 0 for method in ("npca", "pca") for name in silent)


def test_not_traversable_can_be_right():
    found = judged([label("t", PIT, traversable=False)], [PIT], [of_gap(0, traversable=False)])
    assert (found["npca_right"], found["pca_right"]) == (1, 1)


def test_the_gap_of_largest_iou_among_those_that_belong_is_judged():
    trench = label("t", PIT, length=1.0)
    gaps = [box(2, 0, 3, 1), box(2.5, 0, 4, 1)]
    found = judged([trench], gaps, [of_gap(0, length=9.0), of_gap(1, length=1.5)])
    assert (found["npca_lengths"], found["npca_length_error_sum"]) == (1, 0.5)


def test_a_gap_of_larger_iou_that_does_not_belong_is_not_judged():
    """The first covers 0.9 m2 of 2 and lies out by as much again; the second is small, but wholly inside."""
    trench = label("t", PIT, length=1.0)
    gaps = [box(1, 0, 2.9, 1), box(3.5, 0, 4, 1)]
    found = judged(
        [trench],
        gaps,
        [of_gap(0, length=9.0), of_gap(1, length=1.5)],
        rules=Scoring(belongs=0.5, hit_coverage=0.2),
    )
    assert (found["npca_lengths"], found["npca_length_error_sum"]) == (1, 0.5)


def test_a_label_that_is_hit_by_gaps_of_which_none_belongs_is_not_judged():
    trench = label("t", PIT, traversable=True, length=1.0)
    gaps = [box(1, 0, 2.9, 1), box(3.1, 0, 5, 1)]
    found = judged([trench], gaps, [of_gap(0), of_gap(1)], rules=Scoring(belongs=0.5))
    assert (found["hits"], found["pairs"]) == (1, 0)
    assert (found["npca_judged"], found["npca_lengths"]) == (0, 0)


def test_only_a_label_that_was_hit_is_judged():
    trench = label("t", PIT, traversable=True)
    assert judged([trench], [box(2, 0, 2.9, 1)], [of_gap(0)])["npca_judged"] == 0
    assert judged([trench], [box(2, 0, 3, 1)], [of_gap(0)])["npca_judged"] == 1


def test_a_gap_that_merges_two_labels_is_judged_by_both():
    labels = [label("a", PIT, traversable=True), label("b", box(4, 0, 6, 1), traversable=False)]
    found = judged(labels, [box(2, 0, 6, 1)], [of_gap(0, traversable=True)])
    assert (found["npca_judged"], found["npca_right"]) == (2, 1)


def test_a_file_of_another_program_may_know_one_crossing_or_none():
    trench = label("t", PIT, traversable=True)
    found = judged([trench], [PIT, box(9, 0, 10, 1)], [{"pca": crossing(0, "pca")}, {}])
    assert (found["npca_judged"], found["pca_judged"], found["pca_right"]) == (0, 1, 1)
    assert (found["axis_angles"], found["gaps"], found["traversable_pca"]) == (0, 2, 1)


def test_the_angle_between_npca_and_pca_is_always_told():
    crossings = [of_gap(0), {"npca": crossing(1, yaw=3.0), "pca": crossing(1, "pca", yaw=-3.0)}]
    found = judged([], [PIT, box(9, 0, 10, 1)], crossings)
    assert found["axis_angles"] == 2
    assert found["axis_angle_sum"] == pytest.approx(0.5 + 2 * math.pi - 6.0, abs=1e-12)
