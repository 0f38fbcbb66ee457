"""A planar scan -> points in the laser's own plane."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gapeval.config import RotatingLaser
from gapeval.frame import FloatArray
from gapeval.logs.read.messages.measurement import LaserScan
from gapeval.logs.read.messages.message import UndecodableError

WIDEST = 2 * np.pi + 0.1  # rad; no planar scan sees more than all around

LONGEST = 100.0  # s from beam to beam; what says more, or NaN, is no time


@dataclass(frozen=True, slots=True, eq=False)
class Echoes:
    """What a scan measured, in the scan's frame.

    points: (N, 3) [m]; nanoseconds: (N,) of each since the scan's stamp. no_echo: beams without any, or out
    of range; shadows: beams dropped by the shadow filter.
    """

    points: FloatArray
    nanoseconds: NDArray[np.int64]
    no_echo: int
    shadows: int


def echoes(scan: LaserScan, settings: RotatingLaser) -> Echoes:
    """Points of the beams with an echo. angle_max is not believed; the number of ranges is."""
    ranges = one_echo(in_range(scan, settings), scan.intensities, settings.echo)
    seen = np.isfinite(ranges)
    azimuth = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    kept = seen & ~grazing(np.where(seen, ranges, np.inf), scan.angle_increment, settings.shadow_filter)
    r, azimuth = ranges[kept], azimuth[kept]
    points = np.column_stack([r * np.cos(azimuth), r * np.sin(azimuth), np.zeros(len(r))])
    if scan.pose is not None:
        points = scan.pose.apply(points)
    when = beam_times(len(ranges), increment(scan.time_increment, settings))[kept]
    return Echoes(points, when, int(len(ranges) - seen.sum()), int(seen.sum() - kept.sum()))


def require_angles(scan: LaserScan) -> None:
    """Raises UndecodableError for a scan that does not say where its beams point."""
    turned = scan.angle_increment * max(len(scan.ranges) - 1, 1)
    if not (np.isfinite(scan.angle_min + turned) and 0 < abs(turned) <= WIDEST):
        raise UndecodableError(
            f"its beams are {scan.angle_increment:g} rad apart, {len(scan.ranges)} of them"
        )


def increment(own: float, settings: RotatingLaser) -> float:
    """Seconds from beam to beam: the user's word, else the scan's; 0 for what is no time."""
    chosen = own if settings.time_increment is None else settings.time_increment
    return chosen if abs(chosen) < LONGEST else 0.0


def beam_times(beams: int, seconds: float) -> NDArray[np.int64]:
    """(beams,) [ns] since the scan's stamp, which is the first beam's."""
    return np.round(np.arange(beams) * (seconds * 1e9)).astype(np.int64)


def last_beam(beams: int, seconds: float) -> int:
    """[ns] since the scan's stamp; to the nanosecond as beam_times has it."""
    return int(np.round(max(beams - 1, 0) * (seconds * 1e9)))


def one_echo(
    ranges: FloatArray, intensities: FloatArray | None, echo: Literal["first", "last", "strongest"]
) -> FloatArray:
    """Of each beam's echoes (n, e) the one that was asked for (n,), NaN where there is none."""
    if ranges.shape[1] == 1:
        return ranges[:, 0]
    if echo == "strongest" and intensities is not None:
        # An echo of unknown strength is the weakest, but it is one.
        weakest = np.finfo(np.float64).min
        strength = np.where(np.isnan(ranges), -np.inf, np.nan_to_num(intensities, nan=weakest))
        best: FloatArray = ranges[np.arange(len(ranges)), np.argmax(strength, axis=1)]
        return best
    filled = np.where(np.isnan(ranges), -np.inf if echo == "last" else np.inf, ranges)
    chosen = filled.max(axis=1) if echo == "last" else filled.min(axis=1)
    return np.where(np.isfinite(chosen), chosen, np.nan)


def in_range(scan: LaserScan, settings: RotatingLaser) -> FloatArray:
    """Its ranges (n, e), NaN but where range_min <= r < range_max, by the scan and by the user."""
    low, high = settings.range or (-np.inf, np.inf)
    ranges = scan.ranges
    with np.errstate(invalid="ignore"):
        seen = (ranges >= max(scan.range_min, low)) & (ranges < min(scan.range_max, high))
        seen &= np.isfinite(ranges) & (ranges > 0)
    return np.where(seen, ranges, np.nan)


def grazing(ranges: FloatArray, step: float, least: float) -> NDArray[np.bool_]:
    """Beams that brush along an edge: the line to a neighbour's echo meets one of the two beams at less than
    an angle [rad]. ranges: (n,) [m], inf where there is no echo; step: between beams [rad].
    """
    dropped = np.zeros(len(ranges), dtype=np.bool_)
    if least <= 0:
        return dropped
    with np.errstate(invalid="ignore"):
        here, there = ranges[:-1], ranges[1:]
        angle = np.abs(np.arctan2(there * np.sin(abs(step)), here - there * np.cos(step)))
        sharp = (np.minimum(angle, np.pi - angle) < least) & np.isfinite(here + there)
    dropped[:-1] |= sharp
    dropped[1:] |= sharp
    return dropped
