"""Section 3.2 of the paper (Algorithm 2): may the robot cross a gap, and from where to where?"""

from collections.abc import Iterable, Sequence

import numpy as np

from gapeval.config import CrossingRules, Robot
from gapeval.detection import Detection
from gapeval.detection.contours import shapes_of
from gapeval.detection.grid import PolarGrid
from gapeval.detections import Crossing, Method
from gapeval.frame import Plane
from gapeval.share import Share
from gapeval.traversability.axes import both, contour_axes, convex_hulls, interior_axes
from gapeval.traversability.crossings import Crossings, candidates_of, crossings, gathered, ways_over
from gapeval.traversability.reasons import reasons_against

__all__ = ["Crossings", "assess", "assess_each", "by_gap"]


Asked = tuple[Detection, Robot, CrossingRules]


def assess(
    detection: Detection, robot: Robot | None = None, rules: CrossingRules | None = None
) -> list[Crossing]:
    """Algorithm 2 for all gaps of a detection, in both feature spaces: npca and pca of gap 0, of gap 1 ..."""
    found = assess_each([(detection, robot or Robot(), rules or CrossingRules())], Share())
    return found.of(0)


def assess_each(asked: Sequence[Asked], share: Share) -> Crossings:
    """Algorithm 2 for the gaps of many detections; what is equal is done once."""
    shapes = shapes_of([detection.gaps for detection, _, _ in asked])
    hulls = share(convex_hulls, shapes)
    # What depends on surfaces is worked out for all detections on one grid together.
    groups: dict[tuple[PolarGrid, Plane, Robot, CrossingRules], list[int]] = {}
    for index, (detection, robot, rules) in enumerate(asked):
        groups.setdefault((detection.surface.grid, detection.plane, robot, rules), []).append(index)
    found = []
    for (_, plane, robot, rules), indices in groups.items():
        by_contour = share(contour_axes, shapes, hulls)
        by_interior = share(interior_axes, shapes, hulls, rules.uniform)
        axes = share(both, by_contour, by_interior)
        ways = share(ways_over, axes, plane, robot, rules)
        detections = [asked[index][0] for index in indices]
        candidates = candidates_of([shapes.which[index] for index in indices], len(shapes))
        reasons = share.timed(reasons_against, detections, candidates, shapes, axes, ways, robot, rules)
        found.append(crossings(np.array(indices), candidates, reasons, axes, ways))
    return gathered(found)


def by_gap(crossings: Iterable[Crossing]) -> list[dict[Method, Crossing]]:
    """The crossings of each gap, by method."""
    grouped: dict[int, dict[Method, Crossing]] = {}
    for crossing in crossings:
        grouped.setdefault(crossing.gap, {})[crossing.method] = crossing
    return list(grouped.values())
