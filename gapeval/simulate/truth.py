"""The labels of a scene, from its geometry and the robot alone."""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from gapeval.config import CrossingRules, Robot, limits
from gapeval.frame import FloatArray
from gapeval.labels import Label
from gapeval.simulate.scene import Hole, Scene

ROUND = 0.9  # a hole that is nearly as wide as long has no direction of its own
HEADROOM = 1.0  # m; what hangs higher is in no robot's way


def labels(scene: Scene, robot: Robot, fixed_frame: str) -> list[Label]:
    """A label for each hole: its outline on the level ground, and what there is to know of crossing it."""
    return [_label(scene, hole, robot, fixed_frame) for hole in scene.holes]


def _label(scene: Scene, hole: Hole, robot: Robot, fixed_frame: str) -> Label:
    way = narrowest(hole.outline)
    ring = shapely.get_coordinates(hole.outline.exterior)
    return Label(
        id=hole.id,
        kind="gap",
        frame_id=fixed_frame,
        parts=((np.column_stack([ring, np.zeros(len(ring))]),),),
        traversable=can_be_crossed(scene, way, robot),
        length=way.length,
        crossing_yaw=None
        if way.roundness > ROUND
        else math.atan2(way.across[1], way.across[0]) + 0.0,  # no -0.0
    )


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """The way over a hole where it is narrowest.

    middle: (2,) [m]; across: its direction, (2,), of unit length; length: to cross [m]; roundness: that by
    the hole's extent along it.
    """

    middle: FloatArray
    across: FloatArray
    length: float
    roundness: float


def narrowest(outline: shapely.Polygon) -> Way:
    """Through the middle of the narrowest strip that holds an outline.

    The least width of a polygon is at right angles to an edge of its convex hull.
    """
    ring = shapely.get_coordinates(shapely.convex_hull(outline))
    edges = np.diff(ring, axis=0)
    along = edges / np.linalg.norm(edges, axis=1)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    widths = np.ptp(ring @ across.T, axis=0)
    best = int(np.argmin(widths))
    u, v = along[best], across[best]
    low, high = (ring @ np.column_stack([u, v])).min(axis=0), (ring @ np.column_stack([u, v])).max(axis=0)
    centre = (low + high) / 2
    width, length = float(high[1] - low[1]), float(high[0] - low[0])
    v = v if (v[0], v[1]) > (0.0, 0.0) else -v
    return Way(centre[0] * u + centre[1] * across[best], v, width, width / length)


def can_be_crossed(scene: Scene, way: Way, robot: Robot) -> bool:
    """Whether the robot can stand before and behind the middle of a hole that is short enough.

    The paper's rules (Section 3.2.3) asked of the true scene, with the robot's own default distances.
    """
    rules = limits(CrossingRules(), robot)
    if way.length > rules.d_r:
        return False
    away = (way.length / 2 + rules.standoff) * way.across
    ends = shapely.points(np.array([way.middle - away, way.middle + away]))
    low_things = [solid.outline for solid in scene.solids if solid.bottom < HEADROOM]
    taken = shapely.union_all([*(other.outline for other in scene.holes), *low_things])
    return bool((shapely.distance(ends, taken) > rules.clearance).all())
