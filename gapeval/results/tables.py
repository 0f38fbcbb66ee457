"""The columns of the CSV files; names are the same in every file and in docs/results.md."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from gapeval.config import Configuration
from gapeval.detections import METHODS, crossing_properties
from gapeval.scoring.metrics import COUNTS, METRICS, SUMS, SUMS_WITHOUT_LABELS, figures
from gapeval.sweep.evaluation import Answer

DETECTOR = (
    *("i_height", "i_width", "delta_r", "n_o", "pl_th", "x_min", "r_max", "z_min", "z_max"),
    *("origin", "plane", "edge", "kernel"),
)
CROSSING = ("d_r", "standoff", "eta", "clearance", "uniform", "rules", "min_observed")
PARAMETERS = ("k", *DETECTOR, *CROSSING)
METRIC_NAMES = tuple(metric.name for metric in METRICS)

SUMMARY = ("log", "configuration", *PARAMETERS, "best", *METRIC_NAMES, *COUNTS)
FRAMES = ("log", "stamp", "configuration", "plane_fallback", *SUMS)
LABELS = (
    "log",
    "stamp",
    "configuration",
    "label",
    "state",
    "range",
    "length",
    "visible_area",
    "covered_area",
    "iou",
    "hit",
    "gaps",
)
POSITIONS = tuple(f"{spot}_{axis}" for spot in ("centre", "start", "end") for axis in "xyz")
CROSSING_COLUMNS = tuple(
    f"{method}_{name}"
    for method in METHODS
    for name in ("traversable", "reason", "length", "yaw", *POSITIONS, "tie")
)
GAPS = ("log", "stamp", "configuration", "gap", "area", *CROSSING_COLUMNS)
TIMING = ("log", "stage", "shared_by", "frames", "median", "p95")

Row = dict[str, Any]


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
    return row | {name: getattr(crossing, name) for name in CROSSING}


def sums_row(sums: dict[str, float]) -> Row:
    """Sums as columns: counts as integers, nothing where nothing was scored."""
    scored = bool(sums.get("scored_frames"))
    names = SUMS if scored else SUMS_WITHOUT_LABELS
    return {name: _number(name, sums.get(name, 0)) for name in names}


def figures_row(sums: dict[str, float]) -> Row:
    """Every metric of some sums; empty where it is undefined."""
    return dict(figures(sums))


def label_rows(answer: Answer) -> Iterator[Row]:
    for label in answer.labels:
        yield {name: getattr(label, name) for name in LABELS[3:]}


def gap_rows(answer: Answer) -> Iterator[Row]:
    for index, gap in enumerate(answer.gaps):
        row: Row = {"gap": index, "area": gap.area}
        for method, crossing in gap.crossings.items():
            for name, value in crossing_properties(method, crossing).items():
                if isinstance(value, list):
                    row |= {f"{name}_{axis}": part for axis, part in zip("xyz", value, strict=True)}
                else:
                    row[name] = value
        yield row


def cell(value: Any) -> str | int | float:
    """A value as it stands in a file: nothing for None, floats as repr, true and false in lower case."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    return str(value)


def _number(name: str, value: float) -> float | int:
    return float(value) if name.endswith(("_sum", "_area")) else int(value)
