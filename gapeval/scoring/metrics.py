"""Every metric, once: name, unit, which way is better, and how it follows from sums over frames."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray

# What a frame adds, and what it means. Summed over frames, divided once.
WITHOUT_LABELS = {
    "frames": "frames that were evaluated",
    "gaps": "gaps that were found",
    "traversable_npca": "gaps that are traversable by npca",
    "traversable_pca": "gaps that are traversable by pca",
    "axis_angles": "gaps with both axes",
    "axis_angle_sum": "rad, between the axes of npca and pca",
    "plane_fallbacks": "frames in which `plane: patch` or `gravity` fell back to the robot's plane",
}
WITH_LABELS = {
    "scored_frames": "frames that were labelled",
    "empty_frames": "scored frames without a label to ask for",
    "asked": "labels of which enough is visible",
    "hits": "asked labels that were hit",
    "pairs": "pairs of a gap and a label that it belongs to",
    "pairs_on_hits": "such pairs on labels that were hit",
    "paired_gaps": "gaps that belong to a label",
    "tp": "matched pairs",
    "fp": "gaps that count and were not matched",
    "fn": "labels that were asked for and not matched",
    "false_gaps": "gaps that count and belong to no label",
    "ignored": "gaps mostly in an `ignore` polygon",
    "not_counted": "gaps outside the domain, or that touch only labels that are not asked for",
    "iou_sum": "IoU of matched pairs",
    "label_area": "m2, visible, of labels that are asked for",
    "covered_area": "m2, the part of label_area that gaps cover",
    "over_area_sum": "m2, found outside every label",
}
OF_CROSSINGS = {
    f"{method}_{name}": f"{method}: {meaning}"
    for method in ("npca", "pca")
    for name, meaning in {
        "judged": "hit labels with `traversable`",
        "right": "hit labels with `traversable`, judged as labelled",
        "lengths": "hit labels with `length`",
        "length_error_sum": "m, |length - label|",
        "yaws": "hit labels with `crossing_yaw`",
        "yaw_error_sum": "rad, axial angle to the label",
    }.items()
}
OF_EDGES = {
    "paired_over_area_sum": "m2, found outside every label by gaps that belong to one",
    "shadowed_gaps": "false gaps that lie for more than half in shadow",
    "edges": "labels whose near edge was compared",
    "edge_median_sum": "m, median over rays, how late the near edge was seen",
    "edge_max_sum": "m, largest over rays, how late the near edge was seen",
    "edge_rays": "rays through visible labels",
    "edge_rays_missed": "such rays that meet no gap that belongs to the label",
}
SUMS = WITHOUT_LABELS | WITH_LABELS | OF_CROSSINGS | OF_EDGES

# Sums that a reader wants beside the metrics; the others only lead to them.
COUNTS = (
    "frames",
    "scored_frames",
    "empty_frames",
    "gaps",
    "traversable_npca",
    "traversable_pca",
    "plane_fallbacks",
    "asked",
    "hits",
    "tp",
    "fp",
    "fn",
    "false_gaps",
    "ignored",
    "not_counted",
)


@dataclass(frozen=True, slots=True)
class Metric:
    """A figure: `above` / `below`, each so many times some sums; undefined where `below` is 0.

    better: the direction in which a change is an improvement; `none` for what has no better.
    counts: what independent things it counts, for its interval where it is exactly 0 or 1: a share of
    labels, of those that were `judged`, or of blocks of time; a number of `events`; nothing for others.
    """

    name: str
    unit: str
    better: Literal["higher", "lower", "none"]
    meaning: str
    above: Mapping[str, float]
    below: Mapping[str, float]
    counts: Literal["labels", "judged", "blocks", "events", "nothing"] = "nothing"


MATCHED = {"tp": 2.0, "fp": 1.0, "fn": 1.0}
LABELLED = {"label_area": 1.0}
FRAMES = {"scored_frames": 1.0}

METRICS: tuple[Metric, ...] = (
    Metric(
        "hit_rate",
        "1",
        "higher",
        "share of asked labels that were hit",
        {"hits": 1.0},
        {"asked": 1.0},
        "labels",
    ),
    Metric(
        "coverage",
        "1",
        "higher",
        "share of the visible label area covered by gaps",
        {"covered_area": 1.0},
        LABELLED,
        "labels",
    ),
    Metric(
        "over_area",
        "m2",
        "lower",
        "found outside every label, per scored frame",
        {"over_area_sum": 1.0},
        FRAMES,
    ),
    Metric("fp_per_frame", "1", "lower", "false_gaps / scored_frames", {"false_gaps": 1.0}, FRAMES, "events"),
    Metric("splits", "1", "lower", "gaps per label that was hit", {"pairs_on_hits": 1.0}, {"hits": 1.0}),
    Metric(
        "merges", "1", "lower", "labels per gap that belongs to any", {"pairs": 1.0}, {"paired_gaps": 1.0}
    ),
    Metric("precision", "1", "higher", "tp / (tp + fp)", {"tp": 1.0}, {"tp": 1.0, "fp": 1.0}, "blocks"),
    Metric("recall", "1", "higher", "tp / (tp + fn)", {"tp": 1.0}, {"asked": 1.0}, "labels"),
    Metric("f1", "1", "higher", "2 tp / (2 tp + fp + fn)", {"tp": 2.0}, MATCHED, "blocks"),
    Metric("sq", "1", "higher", "mean IoU of matched pairs", {"iou_sum": 1.0}, {"tp": 1.0}),
    Metric("rq", "1", "higher", "recognition quality, equal to f1", {"tp": 2.0}, MATCHED, "blocks"),
    Metric("pq", "1", "higher", "panoptic quality, sq rq", {"iou_sum": 2.0}, MATCHED, "blocks"),
    *(
        metric
        for method in ("npca", "pca")
        for metric in (
            Metric(
                f"{method}_accuracy",
                "1",
                "higher",
                "share of hit labels with `traversable` judged so",
                {f"{method}_right": 1.0},
                {f"{method}_judged": 1.0},
                "judged",
            ),
            Metric(
                f"{method}_length_error",
                "m",
                "lower",
                "mean |length - label|",
                {f"{method}_length_error_sum": 1.0},
                {f"{method}_lengths": 1.0},
            ),
            Metric(
                f"{method}_yaw_error",
                "rad",
                "lower",
                "mean axial angle to label",
                {f"{method}_yaw_error_sum": 1.0},
                {f"{method}_yaws": 1.0},
            ),
        )
    ),
    Metric(
        "axis_angle",
        "rad",
        "none",
        "mean axial angle, npca to pca",
        {"axis_angle_sum": 1.0},
        {"axis_angles": 1.0},
    ),
    Metric(
        "near_edge_error",
        "m",
        "lower",
        "how late near edges are seen: mean over labels of the median ray",
        {"edge_median_sum": 1.0},
        {"edges": 1.0},
    ),
    Metric(
        "near_edge_late",
        "m",
        "lower",
        "how late near edges are seen: mean over labels of the worst ray",
        {"edge_max_sum": 1.0},
        {"edges": 1.0},
    ),
    Metric(
        "near_edge_missed",
        "1",
        "lower",
        "share of rays through labels on which nothing was found",
        {"edge_rays_missed": 1.0},
        {"edge_rays": 1.0},
        "labels",
    ),
    Metric(
        "under_coverage",
        "1",
        "lower",
        "share of the visible label area that no gap covers",
        {"label_area": 1.0, "covered_area": -1.0},
        LABELLED,
        "labels",
    ),
    Metric(
        "over_coverage",
        "1",
        "lower",
        "outside every label, of gaps that belong to one / visible label area",
        {"paired_over_area_sum": 1.0},
        LABELLED,
    ),
    Metric(
        "shadow_gaps",
        "1",
        "lower",
        "false gaps mostly in shadow, per scored frame",
        {"shadowed_gaps": 1.0},
        FRAMES,
        "events",
    ),
)


def figure(metric: Metric, sums: Mapping[str, NDArray[np.floating] | float]) -> FloatArray:
    """A metric of sums (...) by name; NaN where it is undefined."""
    above, below = _times(metric.above, sums), _times(metric.below, sums)
    undefined = np.full(np.broadcast(above, below).shape, np.nan)
    found: FloatArray = np.divide(above, below, out=undefined, where=below != 0)
    return found


def _times(weights: Mapping[str, float], sums: Mapping[str, NDArray[np.floating] | float]) -> FloatArray:
    (name, weight), *others = weights.items()
    total = weight * np.asarray(sums[name], dtype=np.float64)
    for name, weight in others:
        total = total + weight * np.asarray(sums[name], dtype=np.float64)
    return total


def figures(sums: Mapping[str, float]) -> dict[str, float | None]:
    """Every metric of these sums; None where it is undefined."""
    complete = dict.fromkeys(SUMS, 0.0) | dict(sums)
    found = {metric.name: float(figure(metric, complete)) for metric in METRICS}
    return {name: None if value != value else value for name, value in found.items()}
