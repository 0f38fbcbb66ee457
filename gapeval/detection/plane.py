"""The robot's supporting plane of Section 3.1.1."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.config import BodyBox, Patch
from gapeval.frame import FloatArray, Frame, Plane, robot_plane
from gapeval.visibility import without_body

MOST_TILTED = 0.5  # cosine of 60 degrees, against gravity


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """The plane that is used, and why it is not the one that was asked for; empty if it is."""

    plane: Plane
    fallback: str = ""


def supporting_plane(
    frame: Frame, kind: str, patch: Patch, x_min: float, ground_z: float, body: BodyBox | None = None
) -> PlaneFit:
    """Section 3.1.1: the plane that carries the robot, `plane: robot`, `patch` or `gravity`."""
    if kind == "gravity":
        return gravity_plane(frame.up, ground_z)
    if kind == "patch":
        return patch_plane(without_body(frame.points, body), patch, x_min, ground_z)
    return PlaneFit(robot_plane(ground_z))


def gravity_plane(up: tuple[float, float, float] | None, ground_z: float) -> PlaneFit:
    """`plane: gravity`: the level plane through (0, 0, ground_z) of the robot frame.

    up: unit vector against gravity, robot frame. Falls back to the robot's plane without any, or where the
    robot would lie on its side.
    """
    if up is None:
        return PlaneFit(robot_plane(ground_z), "no orientation")
    if up[2] < MOST_TILTED:
        return PlaneFit(robot_plane(ground_z), "tilted too much")
    a, b, c = up
    return PlaneFit(Plane(a, b, c, -(c * ground_z)))


def patch_plane(points: NDArray[np.float32], patch: Patch, x_min: float, ground_z: float) -> PlaneFit:
    """`plane: patch`: a robust fit to the points (N, 3) in a fixed area in front of the robot.

    Least trimmed squares from the robot's plane: the nearest half of the points pulls the plane until
    it rests, then all points within 2.5 robust standard deviations. No chance in it: same points, same
    plane. Falls back to the robot's plane, with the reason, beyond the patch's limits.
    """
    p: FloatArray = points.astype(np.float64)
    inside = (p[:, 0] >= x_min) & (p[:, 0] <= x_min + patch.depth) & (np.abs(p[:, 1]) <= patch.width / 2)
    reach = patch.max_offset + np.tan(patch.max_tilt) * np.hypot(patch.depth, patch.width) / 2
    p = p[inside & (np.abs(p[:, 2] - ground_z) <= reach)]
    flat = robot_plane(ground_z)
    if len(p) < patch.min_points:
        return PlaneFit(flat, "patch has too few points")
    p = p[np.lexsort(p.T)]  # the order of points must not matter, not even in the last bit
    middle = np.array([x_min + patch.depth / 2, 0.0])
    design = np.column_stack([p[:, :2] - middle, np.ones(len(p))])
    slope: FloatArray = np.array([0.0, 0.0, ground_z])
    residual: FloatArray
    for _ in range(30):
        residual = np.abs(design @ slope - p[:, 2])
        kept = np.argsort(residual, kind="stable")[: (len(p) + 1) // 2]
        previous = slope
        slope = _least_squares(design[kept], p[kept, 2])
        if np.array_equal(previous, slope):
            break
    residual = np.abs(design @ slope - p[:, 2])
    kept = np.flatnonzero(residual <= 2.5 * 1.4826 * np.median(residual) + 1e-6)
    slope = _least_squares(design[kept], p[kept, 2])
    if np.arctan(np.hypot(slope[0], slope[1])) > patch.max_tilt:
        return PlaneFit(flat, "patch is tilted too much")
    if abs(slope[2] - ground_z) > patch.max_offset:
        return PlaneFit(flat, "patch is too far above or below the ground")
    normal = np.array([-slope[0], -slope[1], 1.0]) / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    d = -normal @ np.array([middle[0], middle[1], slope[2]])
    return PlaneFit(Plane(*(float(value) for value in (*normal, d))))


def _least_squares(design: FloatArray, z: FloatArray) -> FloatArray:
    return np.linalg.lstsq(design, z, rcond=None)[0].astype(np.float64)
