"""The columns of the CSV files; names are the same in every file and in docs/results.md."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from gapeval.config import Configuration, CrossingRules, Detector, limits
from gapeval.detections import METHODS, crossing_properties
from gapeval.frame import PoseQuality
from gapeval.scoring.label_score import LabelScore
from gapeval.scoring.metrics import COUNTS, METRICS, SUMS, WITHOUT_LABELS
from gapeval.sweep.evaluation import GapAnswer

DETECTOR = (
    *("i_height", "i_width", "delta_r", "n_o", "pl_th", "x_min", "r_max", "z_min", "z_max"),
    *("origin", "plane", "edge", "kernel"),
)
CROSSING = ("d_r", "standoff", "eta", "clearance", "uniform", "rules", "min_observed")
PARAMETERS = ("k", *DETECTOR, *CROSSING)
METRIC_NAMES = tuple(metric.name for metric in METRICS)

POSE = tuple(f"pose_{field.name}" for field in fields(PoseQuality))

ENDS = ("low", "high")  # of the 95 % interval of a metric

SUMMARY, FRAMES, LABELS, GAPS = "summary.csv", "frames.csv", "labels.csv", "gaps.csv"
HITS, APPROACHES, TIMING = "hits.csv", "approaches.csv", "timing.csv"

SUMMARY_COLUMNS = (
    *("log", "configuration", *PARAMETERS, "best"),
    *(column for name in METRIC_NAMES for column in (name, *(f"{name}_{end}" for end in ENDS))),
    *("first_hit_range", "towards_missed", *COUNTS),
)
FRAME_COLUMNS = ("log", "stamp", "configuration", "plane_fallback", *POSE, *SUMS)
LABEL_COLUMNS = ("log", "stamp", "configuration", *(field.name for field in fields(LabelScore)))
POSITIONS = tuple(f"{spot}_{axis}" for spot in ("centre", "start", "end") for axis in "xyz")
CROSSING_COLUMNS = tuple(
    f"{method}_{name}"
    for method in METHODS
    for name in ("traversable", "reason", "length", "yaw", *POSITIONS, "tie")
)
GAP_COLUMNS = ("log", "stamp", "configuration", "gap", "area", "weight", *CROSSING_COLUMNS)
HIT_COLUMNS = ("log", "configuration", "by", "low", "high", "asked", "hits", "hit_rate")
APPROACH_COLUMNS = (
    *("log", "configuration", "label", "width", "asked", "hits", "first_asked", "first_hit"),
    *("nearest_missed", "nearest", "towards"),
)
TIMING_COLUMNS = ("log", "stage", "shared_by", "frames", "median", "p95")

FILES = {
    SUMMARY: SUMMARY_COLUMNS,
    FRAMES: FRAME_COLUMNS,
    LABELS: LABEL_COLUMNS,
    GAPS: GAP_COLUMNS,
    HITS: HIT_COLUMNS,
    APPROACHES: APPROACH_COLUMNS,
    TIMING: TIMING_COLUMNS,
}

Row = dict[str, Any]


def meanings() -> dict[str, str]:
    """What each column of each file means, for docs/results.md."""
    found = {
        "log": "the log's path below the logs' common parent; `all`: all logs together",
        "configuration": "12 hex digits over the parameters; `foreign` for a file that does not name any",
        "stamp": "ns, of the cloud",
        "best": "`true` for the best configuration of the log, chosen on these data; see scoring.md",
        "plane_fallback": "why the plane is the robot's though another was asked for; see detector.md",
        "pose_gap": "s, longest time between two transforms that the pose was interpolated from",
        "pose_roll": "rad, standard deviation of the robot's roll; see logs.md",
        "pose_pitch": "rad, of its pitch",
        "pose_height": "m, of its height",
        "label": "the label's id",
        "state": "`visible`, `partly`, `shadowed` or `out_of_view`",
        "range": "m, along the ground, from below the sensor to the nearest visible point of the label",
        "traversable": "the label's own: whether it can be crossed",
        "length": "m, the label's own",
        "visible_area": "m2",
        "covered_area": "m2, covered by gaps",
        "iou": "largest IoU with one gap",
        "hit": "whether it was hit; empty if it was not asked for",
        "near_edge_median": "m, how late the near edge is seen, median over rays; negative: early",
        "near_edge_max": "m, how late the near edge is seen, largest over rays",
        "near_edge_rays": "rays through the visible label, every half degree",
        "bearing": "rad, from below the sensor to that nearest point, robot frame; left is positive",
        "width": "m, the label's own length, else the least width of its convex hull",
        "gap": "the gap's index in its frame, near gaps first",
        "area": "m2",
        "weight": "probability that the pose is good enough for this gap; see detections.md",
        "by": "what the rows are classes of: `range`, as in labels.csv, or `width`",
        "low": "m, the class begins here",
        "high": "m, the class ends before this; `inf`: it has no end",
        "first_asked": "m, range at the first frame in which the label was asked for",
        "first_hit": "m, range at the first frame in which it was hit; empty: never",
        "nearest_missed": "m, nearest range at which it was asked for and not hit; empty: never",
        "nearest": "m, nearest range at which it was asked for",
        "towards": "whether the robot drives towards it: `nearest` is 1 m less than `first_asked`, or more",
        "first_hit_range": "m, mean of `first_hit` in approaches.csv, where `towards` is true",
        "towards_missed": "labels that the robot drives towards and that were never hit",
        "stage": "a step, by its function; `read`: a cloud; `view`, `scene`: domain, shadow, labels",
        "shared_by": "configurations that one execution serves, on average; 0.5: two for each",
        "median": "s, one execution: median over frames",
        "p95": "s, one execution: 95 % quantile over frames",
    }
    for section, names in ((Detector, ("k", *DETECTOR)), (CrossingRules, CROSSING)):
        found |= {name: section.model_fields[name].description or "" for name in names}
    found |= {metric.name: f"{metric.meaning} [{metric.unit}]" for metric in METRICS} | SUMS
    found |= {
        f"{name}_{end}": f"{what} end of the 95 % interval of {name}; see scoring.md"
        for name in METRIC_NAMES
        for end, what in zip(ENDS, ("lower", "upper"), strict=True)
    }
    for method in METHODS:
        found |= {
            f"{method}_traversable": "may the robot cross it",
            f"{method}_reason": "if not, why; see detector.md",
            f"{method}_length": "m, extent of the gap along the way",
            f"{method}_yaw": "rad, from START to END, robot frame",
            f"{method}_tie": "the shape has no direction of its own",
        }
        found |= {f"{method}_{name}": "m, robot frame" for name in POSITIONS}
    return found


def label_meanings() -> dict[str, str]:
    """What columns of labels.csv mean that are called the same in other files."""
    found = {
        "gaps": "gaps that belong to the label",
        "area": "m2, of the whole label",
        "covered_area": "m2, the part of visible_area that gaps cover",
        "near_edge_missed": "rays of near_edge_rays on which nothing that belongs to the label was found",
        "axis_angle": "rad, between the axes of npca and pca, of the gap that overlaps the label best",
    }
    for method in METHODS:
        found |= {
            f"{method}_traversable": "may the robot cross the gap that overlaps it best, if it was hit",
            f"{method}_length_error": "m, that gap's length - the label's; positive: too long",
            f"{method}_yaw_error": "rad, axial angle between that gap's way and the label's crossing_yaw",
        }
    return found


@dataclass(frozen=True, slots=True)
class Point:
    """What a result is filed under: a configuration's id and the columns of its parameters."""

    id: str
    parameters: Row


def point(configuration: Configuration) -> Point:
    return Point(configuration.id, parameters(configuration))


def parameters(configuration: Configuration) -> Row:
    """The parameters of a configuration beside its id; k only where it decides the resolution."""
    detector, crossing = configuration.detector, configuration.crossing
    decides = detector.i_height is None or detector.i_width is None
    row: Row = {"k": detector.k if decides else None}
    row |= {"i_height": detector.height, "i_width": detector.width}
    row |= {name: getattr(detector, name) for name in DETECTOR if name not in row}
    distances = asdict(limits(crossing, configuration.robot))
    return row | {name: getattr(crossing, name) for name in CROSSING} | distances


def sums_row(sums: Mapping[str, float]) -> Row:
    """Sums as columns: counts as integers, nothing where nothing was scored."""
    names = SUMS if sums["scored_frames"] else WITHOUT_LABELS
    return {name: _number(name, sums[name]) for name in names}


def pose_row(quality: PoseQuality | None) -> list[float | None]:
    """What stands in the columns POSE; nothing for what is not known."""
    values = [None] * len(POSE) if quality is None else [getattr(quality, name[5:]) for name in POSE]
    return [value if value is not None and math.isfinite(value) else None for value in values]


def label_rows(labels: Iterable[LabelScore]) -> Iterator[list[Any]]:
    """What follows the configuration in the columns of labels.csv."""
    for label in labels:
        yield [getattr(label, name) for name in LABEL_COLUMNS[3:]]


def gap_rows(gaps: Iterable[GapAnswer]) -> Iterator[list[Any]]:
    """What follows the configuration in the columns of gaps.csv."""
    for index, gap in enumerate(gaps):
        row: Row = {"gap": index, "area": gap.area, "weight": gap.weight}
        for method, crossing in gap.crossings.items():
            for name, value in crossing_properties(method, crossing).items():
                if isinstance(value, list):
                    row |= {f"{name}_{axis}": part for axis, part in zip("xyz", value, strict=True)}
                else:
                    row[name] = value
        yield [row.get(name) for name in GAP_COLUMNS[3:]]


def cell(value: Any) -> str | int | float:
    """A value as it stands in a file: nothing for None, floats as repr, true and false in lower case."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    return str(value)


def is_real(name: str) -> bool:
    """Whether a sum is of areas, angles or ratios; the others are counts."""
    return name.endswith(("_sum", "_area"))


def _number(name: str, value: float) -> float | int:
    return float(value) if is_real(name) else int(value)
