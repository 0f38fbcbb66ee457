"""Points that were measured one after the other by a sensor that moves, put where they are at one time."""

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray, rotation_matrices
from gapeval.logs.read.transforms import Stamps, Transforms, slerp


def covers(knots: Stamps, times: Stamps) -> bool:
    """Whether all times (N,) lie between the first and last knot (K,), sorted; nothing is extrapolated."""
    return not len(times) or bool(knots[0] <= times.min() and times.max() <= knots[-1])


def moved(points: NDArray[np.floating], times: Stamps, knots: Stamps, transforms: Transforms) -> FloatArray:
    """Points (N, 3), each measured at its time (N,), by the transform between the knots (K,) around it.

    knots: sorted, at least two. Translation is interpolated linearly, rotation along the shorter arc.
    """
    distinct, which = np.unique(times, return_inverse=True)
    found = between(distinct, knots, transforms)
    matrices = rotation_matrices(found.quaternion)[which]
    turned = np.einsum("nij,nj->ni", matrices, points.astype(np.float64))
    return np.asarray(turned + found.translation[which], dtype=np.float64)


def between(times: Stamps, knots: Stamps, transforms: Transforms) -> Transforms:
    """Transforms at times (M,) that the knots (K,) cover."""
    right = np.clip(np.searchsorted(knots, times, side="left"), 1, len(knots) - 1)
    left = right - 1
    width = np.maximum(knots[right] - knots[left], 1)
    share = ((times - knots[left]) / width)[:, None]
    a, b = transforms.translation[left], transforms.translation[right]
    rotation = slerp(transforms.quaternion[left], transforms.quaternion[right], share)
    return Transforms(a + (b - a) * share, rotation)
