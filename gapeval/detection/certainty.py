"""How sure a gap is, as far as it depends on the robot's pose (Section 4.5)."""

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.frame import PoseQuality


def weights(
    polygons: NDArray[np.object_], quality: PoseQuality | None, pl_th: float
) -> list[float] | list[None]:
    """Of each gap (N,): the probability that the plane is wrong by at most Pl_th where it is least sure.

    A pose that is turned by roll about x and pitch about y, and lifted, moves the plane at (x, y) by
    height + y roll - x pitch. By more than Pl_th, and ground is no longer taken for ground: it looks like a
    gap. It moves most at one of the far vertices of the gap. None where the log does not tell how well its
    poses are known.
    """
    if quality is None or not all(map(math.isfinite, (quality.roll, quality.pitch, quality.height))):
        return [None] * len(polygons)
    places, owner = shapely.get_coordinates(polygons, return_index=True)
    x, y = places.T
    deviation = np.sqrt(quality.height**2 + (y * quality.roll) ** 2 + (x * quality.pitch) ** 2)
    worst = np.zeros(len(polygons))
    np.maximum.at(worst, owner, deviation)
    return [math.erf(pl_th / (sigma * math.sqrt(2))) if sigma > 0 else 1.0 for sigma in worst.tolist()]
