"""What single messages say, whatever they were encoded as: the plain data."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray, Transform
from gapeval.logs.read.messages.cloud import Points


@dataclass(frozen=True, slots=True)
class Head:
    """When and in which frame something was measured. stamp: [ns]; frame: without leading slash."""

    stamp: int
    frame: str


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """One sweep of a 2D laser of n beams.

    stamp: of the first beam [ns]. ranges: (n, e) [m], e echoes per beam, filled with NaN; intensities: (n, e)
    or None. angle_min: of the first beam, angle_increment: from beam to beam [rad]; time_increment: from beam
    to beam [s]; range_min, range_max: what counts as measured [m]. pose: frame<-laser, None where the beams
    are in the frame itself.
    """

    stamp: int
    frame: str
    ranges: FloatArray
    intensities: FloatArray | None
    angle_min: float
    angle_increment: float
    time_increment: float
    range_min: float
    range_max: float
    pose: Transform | None = None


@dataclass(frozen=True, slots=True)
class StampedTransform:
    """parent<-child. values: x, y, z [m], quaternion x, y, z, w."""

    stamp: int
    parent: str
    child: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class StampedPose:
    """parent<-child, as StampedTransform; child: empty where the message names none.

    covariance: 36 numbers, row by row, of x, y, z and the turns about them [m, rad]; None where it says
    nothing: all zero, not finite, or negative on its diagonal.
    """

    stamp: int
    parent: str
    child: str
    values: tuple[float, ...]
    covariance: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Orientation:
    """How a frame is turned against the world. quaternion: x, y, z, w."""

    stamp: int
    frame: str
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class TimedPoints:
    """points, and when each was measured: nanoseconds (N,) int64 after the message's stamp."""

    points: Points
    nanoseconds: NDArray[np.int64]
