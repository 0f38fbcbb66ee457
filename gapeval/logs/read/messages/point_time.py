"""When each point of a cloud was measured: found from the names and values of its fields alone."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gapeval.logs.read.messages.cloud import (
    DATATYPES,
    NO_TIME,
    PackedCloud,
    PackedField,
    UnreadableCloudError,
    column,
    kept_points,
)
from gapeval.logs.read.messages.measurement import TimedPoints

NAMES = frozenset(
    {"t", "time", "timestamp", "time_stamp", "timestamps", "offset_time", "time_offset", "timeoffset", "ts"}
)
Unit = Literal["s", "us", "ns"]
Origin = Literal["stamp", "absolute"]
NANOSECONDS: dict[Unit, int] = {"s": 1_000_000_000, "us": 1_000, "ns": 1}
# A scan takes 5 ms to 3 s. No two units make the same numbers such a span.
SHORTEST, LONGEST = 5_000_000, 3_000_000_000  # ns
NEAR = 10_000_000_000  # ns; from the stamp to an absolute time that is of the same clock


@dataclass(frozen=True, slots=True)
class TimeField:
    """The field that holds the times. type: of its numbers; origin: what they count from; span: [s]."""

    name: str
    type: str
    unit: Unit
    origin: Origin
    span: float


def timed_points(cloud: PackedCloud) -> tuple[TimedPoints, TimeField]:
    """The points, when each was measured, and how that was found.

    Raises UnreadableCloudError: NO_TIME where no field says it, or what one says is not plausible.
    """
    points, kept = kept_points(cloud)
    fields = [f for f in cloud.fields if f.name.lower() in NAMES]
    if not fields:
        names = ", ".join(f.name for f in cloud.fields)
        raise UnreadableCloudError(NO_TIME, f"no field is named like a time; it has {names}")
    refusals = []
    for found in fields:
        try:
            values = column(cloud, found)[kept]
            nanoseconds, time = _relative(values, found, cloud)
        except UnreadableCloudError as error:
            refusals.append(error.detail)
            continue
        return TimedPoints(points, nanoseconds), time
    raise UnreadableCloudError(NO_TIME, "; ".join(refusals))


def _relative(
    values: NDArray[Any], found: PackedField, cloud: PackedCloud
) -> tuple[NDArray[np.int64], TimeField]:
    """Nanoseconds after the cloud's stamp of values (N,)."""
    kind = DATATYPES[found.datatype][0]
    if not np.isfinite(values).all():
        raise UnreadableCloudError(NO_TIME, f"{found.name} is not finite for every point")
    first, last = values.min(), values.max()
    # Differences of near numbers are exact, while seconds since 1970 times 1e9 are not.
    base = int(first)
    span = float(last) - float(first)
    unit = _unit(span, found, first, last)
    factor = NANOSECONDS[unit]
    origin, shift = _origin(base * factor, found, cloud)
    wide = np.asarray(values, dtype=np.float64 if values.dtype.kind == "f" else np.int64)
    steps = np.rint((wide - base) * factor).astype(np.int64)
    return steps + shift, TimeField(found.name, kind, unit, origin, span * factor / 1e9)


def _unit(span: float, found: PackedField, first: Any, last: Any) -> Unit:
    for unit, factor in NANOSECONDS.items():
        # Whole seconds are no times of points.
        is_fine = unit != "s" or isinstance(first, np.floating)
        if is_fine and SHORTEST <= span * factor <= LONGEST:
            return unit
    raise UnreadableCloudError(
        NO_TIME,
        f"{found.name} goes from {_shown(first)} to {_shown(last)}, which is no scan in s, us or ns",
    )


def _origin(first: int, found: PackedField, cloud: PackedCloud) -> tuple[Origin, int]:
    """What the times count from, and how long after the stamp is `first` of them [ns]."""
    if cloud.time_origin is not None and abs(cloud.time_origin - cloud.stamp) <= NEAR:
        return "absolute", first + cloud.time_origin - cloud.stamp
    from_stamp, from_zero = abs(first - cloud.stamp), abs(first)
    if from_stamp <= min(NEAR, from_zero):
        return "absolute", first - cloud.stamp
    if from_zero <= LONGEST:
        return "stamp", first
    raise UnreadableCloudError(
        NO_TIME,
        f"{found.name} begins at {first // 1_000_000_000} s, near neither 0 nor the stamp, "
        f"{cloud.stamp // 1_000_000_000} s",
    )


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, np.floating) else f"{value}"
