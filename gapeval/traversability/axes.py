"""Sections 3.2.1 and 3.2.2: along which axis would each gap be crossed?"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.detection.contours import Gap, Gaps, Shapes
from gapeval.detection.grid import row_edges
from gapeval.frame import FloatArray
from gapeval.ragged import sums

TIE = 0.95  # ratio of eigenvalues above which a shape has no direction of its own
ROUNDING = 1e-9  # what differs by less is equal


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """Where each gap would be crossed; arrays over gaps.

    centre: m_j, (N_g, 2). e_opt: unit vectors, (N_g, 2). low, high: extent of the gap along e_opt,
    relative to the centre [m], (N_g,). tie: (N_g,).
    """

    centre: FloatArray
    e_opt: FloatArray
    low: FloatArray
    high: FloatArray
    tie: NDArray[np.bool_]

    @property
    def length(self) -> FloatArray:
        """The paper's len_j [m]."""
        return self.high - self.low


@dataclass(frozen=True, slots=True, eq=False)
class Hulls:
    """Con_j: the convex hull of each gap."""

    polygons: NDArray[np.object_]


def convex_hulls(gaps: Gaps | Shapes) -> Hulls:
    return Hulls(np.asarray(shapely.convex_hull(gaps.polygons), dtype=object))


def contour_axes(gaps: Gaps | Shapes, hulls: Hulls) -> Axes:
    """Section 3.2.1, NPCA: covariance of the normals of the convex contour, each edge weighted by its length.

    That is the limit of uniform sampling. e_opt is the first eigenvector: most of the contour faces it.
    """
    start, end, owner = _edges(hulls.polygons)
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.where(length > 0, length, 1.0)[:, None]
    total = sums(length, owner, len(gaps))
    covariance = sums(normal[:, :, None] * normal[:, None, :] * length[:, None, None], owner, len(gaps))
    covariance /= total[:, None, None]
    centre = sums((start + end) / 2 * length[:, None], owner, len(gaps)) / total[:, None]
    return _axes(hulls, centre, covariance, eigenvector=1)


def interior_axes(gaps: Gaps | Shapes, hulls: Hulls, uniform: str) -> Axes:
    """Section 3.2.2: covariance of the interior; e_opt is the second eigenvector, across the gap.

    `uniform: area` takes exact second moments of the polygon, the limit of uniform density;
    `uniform: kdtree` the paper's down-sampled cloud of cell centres.
    """
    if uniform == "kdtree":
        clouds = [uniform_cloud(gap) for gap in gaps]
        centre = np.array([cloud.mean(axis=0) for cloud in clouds]).reshape(-1, 2)
        covariance = np.array([np.cov(cloud.T, bias=True) for cloud in clouds]).reshape(-1, 2, 2)
    else:
        centre, covariance = area_moments(gaps.polygons)
    return _axes(hulls, centre, covariance, eigenvector=0)


def area_moments(polygons: NDArray[np.object_]) -> tuple[FloatArray, FloatArray]:
    """Area centroids (N, 2) and covariances (N, 2, 2) of (Multi)Polygons with holes, by Green's theorem."""
    count = len(polygons)
    shift = shapely.get_coordinates(shapely.centroid(polygons))
    parts, owner = shapely.get_parts(polygons, return_index=True)
    rings, part = shapely.get_rings(parts, return_index=True)
    hole = np.concatenate([[False], part[1:] == part[:-1]]) if len(part) else np.empty(0, dtype=bool)
    start, end, ring = _edges(np.asarray(rings, dtype=object))
    gap = owner[part[ring]]
    (x0, y0), (x1, y1) = (start - shift[gap]).T, (end - shift[gap]).T  # for precision
    cross = x0 * y1 - x1 * y0
    orientation = np.sign(np.bincount(ring, cross, len(rings)))
    cross *= np.where(hole, -orientation, orientation)[ring]  # exteriors count, holes are taken away
    x, y = x0 + x1, y0 + y1
    area = np.bincount(gap, cross, count) / 2
    mean_x, mean_y = (np.bincount(gap, of * cross, count) / 6 / area for of in (x, y))
    xx, xy, yy = (
        np.bincount(gap, of * cross, count) / 24 / area
        for of in (x0 * x0 + x1 * x1 + x * x, x0 * y0 + x1 * y1 + x * y, y0 * y0 + y1 * y1 + y * y)
    )
    xx, xy, yy = xx - mean_x * mean_x, xy - mean_x * mean_y, yy - mean_y * mean_y
    covariance = np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)
    return np.column_stack([mean_x, mean_y]) + shift, covariance


def uniform_cloud(gap: Gap) -> FloatArray:
    """Section 3.2.2: cell centres (M, 2), thinned by a kd-tree to leaves of size tau, Eq. (6).

    tau is the width of the farthest row of the gap; a leaf's size is its largest distance from its centroid.
    """
    rows = np.flatnonzero(gap.cells.any(axis=1))
    edges = row_edges(gap.grid, int(rows[-1]) + 1)
    tau = edges[-1] - edges[-2]
    leaves: list[FloatArray] = []
    pending = [gap.point_cloud(interior=True)]
    while pending:
        cloud = pending.pop()
        centroid = cloud.mean(axis=0)
        if len(cloud) == 1 or np.hypot(*(cloud - centroid).T).max() < tau:
            leaves.append(centroid)
            continue
        axis = int(np.argmax(np.ptp(cloud, axis=0)))
        order = np.argsort(cloud[:, axis], kind="stable")
        pending += [cloud[order[: len(cloud) // 2]], cloud[order[len(cloud) // 2 :]]]
    return np.array(leaves)


def both(one: Axes, other: Axes) -> Axes:
    """First the axes of all shapes by one method, then by the other."""
    return Axes(
        np.concatenate([one.centre, other.centre]),
        np.concatenate([one.e_opt, other.e_opt]),
        np.concatenate([one.low, other.low]),
        np.concatenate([one.high, other.high]),
        np.concatenate([one.tie, other.tie]),
    )


def _axes(hulls: Hulls, centre: FloatArray, covariance: FloatArray, eigenvector: int) -> Axes:
    """PCA: the wanted eigenvector (0: smallest eigenvalue, 1: largest), and the gap's extent along it."""
    values, vectors = np.linalg.eigh(covariance)
    tie = values[:, 0] >= TIE * values[:, 1]  # also if both are 0
    e_opt = vectors[:, :, eigenvector]
    # An axis has no sign; fix one that rounding cannot turn.
    backwards = (e_opt[:, 0] < -ROUNDING) | ((np.abs(e_opt[:, 0]) <= ROUNDING) & (e_opt[:, 1] < 0))
    e_opt = e_opt * np.where(backwards, -1.0, 1.0)[:, None]
    distance = np.hypot(centre[:, 0], centre[:, 1])[:, None]
    away = np.where(distance > 0, centre / np.where(distance > 0, distance, 1.0), np.array([1.0, 0.0]))
    e_opt = np.where(tie[:, None], away, e_opt)
    corner, owner = shapely.get_coordinates(hulls.polygons, return_index=True)
    along = ((corner - centre[owner]) * e_opt[owner]).sum(axis=1)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    if len(first) == 0:
        return Axes(centre, e_opt, np.empty(0), np.empty(0), tie)
    return Axes(centre, e_opt, np.minimum.reduceat(along, first), np.maximum.reduceat(along, first), tie)


def _edges(rings: NDArray[np.object_]) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Start and end (M, 2) of each edge of closed rings or polygons without holes, and whose it is (M,)."""
    places, owner = shapely.get_coordinates(rings, return_index=True)
    inner = owner[1:] == owner[:-1]
    return places[:-1][inner], places[1:][inner], owner[1:][inner]
