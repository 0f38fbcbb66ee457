"""How late the near edge of a label is seen: what rays from the sensor's foot meet first."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray, spans
from gapeval.scoring.scene import Polygons, Scene
from gapeval.visibility import AZIMUTH_STEP, BINS

# The middles of the bins, so that no ray runs along a side of a shadow or a column of a gap.
RAYS = (np.arange(BINS) + 0.5) * AZIMUTH_STEP  # rad, robot frame
TOWARDS = np.column_stack([np.cos(RAYS), np.sin(RAYS)])


@dataclass(frozen=True, slots=True, eq=False)
class NearEdges:
    """Sets of gaps (I) against labels (A): first entry into gaps that belong to the label less that into it.

    median, largest [m] over the rays that meet such a gap, NaN where none does; positive: seen late.
    rays: (A,) that meet the visible label. missed: (I, A) of them that meet no gap that belongs to it.
    """

    median: FloatArray
    largest: FloatArray
    rays: IndexArray
    missed: IndexArray


def near_edges(
    scene: Scene,
    gaps: Polygons,
    belongs: NDArray[np.bool_],
    owner: IndexArray,
    which: IndexArray,
    number: int,
) -> NearEdges:
    """gaps: (M,) the visible parts of distinct gaps; belongs: (M, A).

    Every gap of every set, in the order of the sets: whose it is, `owner`, and `which` of the distinct ones.
    """
    origin, asked = scene.view.origin, scene.asked
    begins = entries(np.array([label.visible for label in asked], dtype=object), origin)
    crossed = np.isfinite(begins)
    rays = crossed.sum(axis=1)
    some = belongs.any(axis=1)
    place = np.cumsum(some) - 1
    found = entries(gaps[some], origin)
    median, largest = np.full((2, number, len(asked)), np.nan)
    missed = np.tile(rays, (number, 1))
    for label in range(len(asked)):
        of = np.flatnonzero(belongs[which, label])
        if len(of) == 0:
            continue
        first = np.flatnonzero(np.diff(owner[of], prepend=-1))
        here = crossed[label]
        late = found[place[which[of]]][:, here] - begins[label, here]
        late = np.sort(np.minimum.reduceat(late, first, axis=0), axis=1)
        met = np.isfinite(late).sum(axis=1)
        missed[owner[of[first]], label] -= met
        some_met = np.flatnonzero(met)
        own, late, met = owner[of[first[some_met]]], late[some_met], met[some_met]
        row = np.arange(len(met))
        median[own, label] = (late[row, (met - 1) // 2] + late[row, met // 2]) / 2
        largest[own, label] = late[row, met - 1]
    return NearEdges(median, largest, rays, missed)


def entries(polygons: Polygons, origin: tuple[float, float]) -> FloatArray:
    """How far [m] along each ray from the origin each polygon begins, (N, BINS); infinite where it does not.

    0 on all rays where the origin lies in it. A ray through a vertex meets one of its two edges, or both or
    none where the boundary turns back there.
    """
    parts, polygon = shapely.get_parts(polygons, return_index=True)
    inner, part = shapely.get_parts(parts, return_index=True)  # an intersection may be a collection
    rings, of = shapely.get_rings(inner, return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    xy -= origin
    angle = np.arctan2(xy[:, 1], xy[:, 0]) / AZIMUTH_STEP - 0.5  # counted in rays
    following = np.ceil(angle).astype(np.intp)  # the first ray that is not before the vertex
    start = np.flatnonzero(ring[1:] == ring[:-1])
    end = start + 1
    last = following[end] - BINS * np.rint((angle[end] - angle[start]) / BINS).astype(np.intp)
    first = np.minimum(following[start], last)
    ray, edge = spans(first, np.maximum(following[start], last) - first)
    ray %= BINS
    towards, one, other = TOWARDS[ray], xy[start[edge]], xy[end[edge]]
    left, right = _cross(towards, one), _cross(towards, other)
    apart = left - right
    share = np.divide(left, apart, out=np.zeros_like(left), where=apart != 0).clip(0.0, 1.0)
    met = one + share[:, None] * (other - one)
    distance = np.maximum((towards * met).sum(axis=1), 0.0)
    nearest = np.full((len(polygons), BINS), np.inf)
    np.minimum.at(nearest, (polygon[part[of[ring[start[edge]]]]], ray), distance)
    nearest[shapely.intersects_xy(polygons, *origin)] = 0.0
    return nearest


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    product: FloatArray = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return product
