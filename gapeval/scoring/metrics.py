"""Every metric, once: name, unit, which way is better, and how it follows from sums over frames."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

Sums = Mapping[str, float]

# What a frame adds, and what it means. Summed over frames, divided once.
WITHOUT_LABELS = {
    "frames": "frames that were evaluated",
    "gaps": "gaps that were found",
    "traversable_npca": "gaps that are traversable by npca",
    "traversable_pca": "gaps that are traversable by pca",
    "axis_angles": "gaps with both axes",
    "axis_angle_sum": "rad, between the axes of npca and pca",
    "plane_fallbacks": "frames in which `plane: patch` fell back to the robot's plane",
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
SUMS = WITHOUT_LABELS | WITH_LABELS | OF_CROSSINGS

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
    """better: the direction in which a change is an improvement; `none` for what has no better."""

    name: str
    unit: str
    better: Literal["higher", "lower", "none"]
    meaning: str
    figure: Callable[[Sums], float | None]


def ratio(above: str, below: str) -> Callable[[Sums], float | None]:
    """Undefined where there is nothing to divide by."""
    return lambda sums: sums[above] / sums[below] if sums[below] else None


def _detected(sums: Sums) -> float:
    return sums["tp"] + sums["fp"]


def _precision(sums: Sums) -> float | None:
    return sums["tp"] / _detected(sums) if _detected(sums) else None


def _f1(sums: Sums) -> float | None:
    whole = 2 * sums["tp"] + sums["fp"] + sums["fn"]
    return 2 * sums["tp"] / whole if whole else None


def _pq(sums: Sums) -> float | None:
    whole = 2 * sums["tp"] + sums["fp"] + sums["fn"]
    return 2 * sums["iou_sum"] / whole if whole else None


METRICS: tuple[Metric, ...] = (
    Metric("hit_rate", "1", "higher", "share of asked labels that were hit", ratio("hits", "asked")),
    Metric(
        "coverage",
        "1",
        "higher",
        "share of the visible label area covered by gaps",
        ratio("covered_area", "label_area"),
    ),
    Metric(
        "over_area",
        "m2",
        "lower",
        "found outside every label, per scored frame",
        ratio("over_area_sum", "scored_frames"),
    ),
    Metric("fp_per_frame", "1", "lower", "false_gaps / scored_frames", ratio("false_gaps", "scored_frames")),
    Metric("splits", "1", "lower", "gaps per label that was hit", ratio("pairs_on_hits", "hits")),
    Metric("merges", "1", "lower", "labels per gap that belongs to any", ratio("pairs", "paired_gaps")),
    Metric("precision", "1", "higher", "tp / (tp + fp)", _precision),
    Metric("recall", "1", "higher", "tp / (tp + fn)", ratio("tp", "asked")),
    Metric("f1", "1", "higher", "2 tp / (2 tp + fp + fn)", _f1),
    Metric("sq", "1", "higher", "mean IoU of matched pairs", ratio("iou_sum", "tp")),
    Metric("rq", "1", "higher", "recognition quality, equal to f1", _f1),
    Metric("pq", "1", "higher", "panoptic quality, sq rq", _pq),
    Metric(
        "npca_accuracy",
        "1",
        "higher",
        "share of hit labels with `traversable` judged so",
        ratio("npca_right", "npca_judged"),
    ),
    Metric(
        "npca_length_error",
        "m",
        "lower",
        "mean |length - label|",
        ratio("npca_length_error_sum", "npca_lengths"),
    ),
    Metric(
        "npca_yaw_error",
        "rad",
        "lower",
        "mean axial angle to label",
        ratio("npca_yaw_error_sum", "npca_yaws"),
    ),
    Metric(
        "pca_accuracy",
        "1",
        "higher",
        "share of hit labels with `traversable` judged so",
        ratio("pca_right", "pca_judged"),
    ),
    Metric(
        "pca_length_error",
        "m",
        "lower",
        "mean |length - label|",
        ratio("pca_length_error_sum", "pca_lengths"),
    ),
    Metric(
        "pca_yaw_error", "rad", "lower", "mean axial angle to label", ratio("pca_yaw_error_sum", "pca_yaws")
    ),
    Metric(
        "axis_angle", "rad", "none", "mean axial angle, npca to pca", ratio("axis_angle_sum", "axis_angles")
    ),
)


def figures(sums: Sums) -> dict[str, float | None]:
    """Every metric of these sums; None where it is undefined."""
    complete = dict.fromkeys(SUMS, 0.0) | dict(sums)
    return {metric.name: metric.figure(complete) for metric in METRICS}
