"""Every figure of summary.csv that is compared: its unit, which way is better, and the sums behind it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from gapeval.scoring.metrics import COUNTS, METRICS, SUMS

Better = Literal["higher", "lower", "none"]


@dataclass(frozen=True, slots=True)
class Figure:
    """above / below, each so many times sums over frames; neither where it is no ratio of them."""

    name: str
    unit: str
    better: Better
    meaning: str
    above: Mapping[str, float]
    below: Mapping[str, float]


# Counts lead to the metrics, where they are held against each other; by themselves fewer or more is no
# better. Only a plane that could not be fitted is a fault whatever else happens.
FAULTS = ("plane_fallbacks",)
# What a frame is asked does not depend on what was detected in it.
ASKED = ("frames", "scored_frames", "empty_frames", "asked")

OF_METRICS = [
    Figure(metric.name, metric.unit, metric.better, metric.meaning, metric.above, metric.below)
    for metric in METRICS
]
OF_APPROACHES = [
    Figure("first_hit_range", "m", "higher", "mean range at which labels are hit first", {}, {}),
    Figure("towards_missed", "1", "lower", "labels that the robot drives towards, never hit", {}, {}),
]
OF_COUNTS = [
    Figure(name, "1", "lower" if name in FAULTS else "none", SUMS[name], {}, {})
    for name in COUNTS
    if name not in ASKED
]
FIGURES: dict[str, Figure] = {figure.name: figure for figure in (*OF_METRICS, *OF_APPROACHES, *OF_COUNTS)}
