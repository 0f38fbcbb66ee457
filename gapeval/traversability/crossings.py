"""Section 3.2.3: the ways over gaps, and the crossings that come of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.config import CrossingRules, Robot, limits
from gapeval.detection.surface import BoolArray
from gapeval.detections import METHODS, Crossing
from gapeval.frame import FloatArray, Plane
from gapeval.ragged import IndexArray
from gapeval.traversability.axes import ROUNDING, Axes


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """From where to where each shape would be crossed, by both methods, robot frame [m].

    start, end: (2 M, 2). yaw: from START to END [rad], (2 M,). centre3, start3, end3: on the plane, (2 M, 3).
    """

    start: FloatArray
    end: FloatArray
    yaw: FloatArray
    centre3: FloatArray
    start3: FloatArray
    end3: FloatArray


def ways_over(axes: Axes, plane: Plane, robot: Robot, rules: CrossingRules) -> Ways:
    """Section 3.2.3: START and END of each shape."""
    start, end = poses(axes, robot, rules)
    way = end - start
    yaw = np.arctan2(way[:, 1], way[:, 0])
    on_plane = (np.column_stack([places, plane.height(places)]) for places in (axes.centre, start, end))
    return Ways(start, end, yaw, *on_plane)


def poses(axes: Axes, robot: Robot, rules: CrossingRules) -> tuple[FloatArray, FloatArray]:
    """START and END (N_g, 2): `standoff` before and behind the gap, or the paper's eta from its centre."""
    if rules.eta is not None:
        low, high = np.full_like(axes.low, -rules.eta), np.full_like(axes.high, rules.eta)
    else:
        standoff = limits(rules, robot).standoff
        low, high = axes.low - standoff, axes.high + standoff
    one, other = axes.centre + low[:, None] * axes.e_opt, axes.centre + high[:, None] * axes.e_opt
    swapped = (np.hypot(*one.T) > np.hypot(*other.T) + ROUNDING)[:, None]
    return np.where(swapped, other, one), np.where(swapped, one, other)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Gaps of images on one grid with a way over each; (N,) of each, ordered by image, method and gap.

    image: which image. gap: which gap of that. shape: its place among the shapes. way: that among the ways.
    """

    image: IndexArray
    gap: IndexArray
    shape: IndexArray
    way: IndexArray

    def __getitem__(self, index: IndexArray) -> "Candidates":
        return Candidates(self.image[index], self.gap[index], self.shape[index], self.way[index])


def candidates_of(images: Sequence[IndexArray], shapes: int) -> Candidates:
    """Every gap of images, given by the shapes that theirs have, by both methods."""
    counts = [len(which) for which in images]
    nothing = np.empty(0, dtype=np.intp)
    return Candidates(
        np.repeat(np.arange(len(images)), [len(METHODS) * count for count in counts]),
        np.concatenate([nothing, *(np.arange(count) for count in counts for _ in METHODS)]),
        np.concatenate([nothing, *(which for which in images for _ in METHODS)]),
        np.concatenate([nothing, *(which + i * shapes for which in images for i in range(len(METHODS)))]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """The crossings of the gaps of many detections, by both methods, as arrays; see Crossing.

    detection, method (its place in METHODS), gap, reason (str), length, yaw, tie: (N,).
    centre, start, end: (N, 3).
    """

    detection: IndexArray
    method: IndexArray
    gap: IndexArray
    reason: NDArray[np.object_]
    length: FloatArray
    yaw: FloatArray
    centre: FloatArray
    start: FloatArray
    end: FloatArray
    tie: BoolArray

    def of(self, detection: int) -> list[Crossing]:
        """Those of one detection: npca and pca of gap 0, of gap 1 ..."""
        rows = np.flatnonzero(self.detection == detection)
        rows = rows[np.lexsort((self.method[rows], self.gap[rows]))]
        return [self._crossing(row) for row in rows.tolist()]

    def _crossing(self, row: int) -> Crossing:
        x, y, z = (tuple(places[row].tolist()) for places in (self.centre, self.start, self.end))
        return Crossing(
            gap=int(self.gap[row]),
            method=METHODS[self.method[row]],
            traversable=self.reason[row] == "",
            reason=str(self.reason[row]),
            length=float(self.length[row]),
            yaw=float(self.yaw[row]),
            centre=x,
            start=y,
            end=z,
            tie=bool(self.tie[row]),
        )


def crossings(
    detections: IndexArray, candidates: Candidates, reasons: NDArray[np.object_], axes: Axes, ways: Ways
) -> Crossings:
    """The crossings of candidates, whose images are these detections."""
    way = candidates.way
    return Crossings(
        detections[candidates.image],
        way // (len(ways.yaw) // len(METHODS)) if len(way) else way,
        candidates.gap,
        reasons,
        axes.length[way],
        ways.yaw[way],
        ways.centre3[way],
        ways.start3[way],
        ways.end3[way],
        axes.tie[way],
    )


def gathered(parts: Sequence[Crossings]) -> Crossings:
    """All in one, in their order."""
    if len(parts) == 1:
        return parts[0]
    names = Crossings.__dataclass_fields__
    return Crossings(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
