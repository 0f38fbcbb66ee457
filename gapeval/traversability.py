"""Section 3.2 of the paper (Algorithm 2): may the robot cross a gap, and from where to where?"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.config import CrossingRules, Robot, limits
from gapeval.detection import Detection, Share, Surface, alone
from gapeval.detection.contours import Gap, Gaps
from gapeval.detection.grid import cell_polygons, cells, corners, midpoints, row_edges
from gapeval.detections import Crossing, Method
from gapeval.frame import FloatArray, Plane

TIE = 0.95  # ratio of eigenvalues above which a shape has no direction of its own
ROUNDING = 1e-9  # what differs by less is equal
FOOTPRINT = 9, 7  # samples of a footprint along and across


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


def assess(
    detection: Detection, robot: Robot | None = None, rules: CrossingRules | None = None, share: Share = alone
) -> list[Crossing]:
    """Algorithm 2 for all gaps of a detection, in both feature spaces: npca and pca of gap 0, of gap 1 ...

    share: how to do a step; see `gapeval.detection.alone`.
    """
    robot, rules = robot or Robot(), rules or CrossingRules()
    hulls = share(convex_hulls, detection.gaps)
    by_contour = share(contour_axes, detection.gaps, hulls)
    by_interior = share(interior_axes, detection.gaps, hulls, rules.uniform)
    surface, plane, gaps = detection.surface, detection.plane, detection.gaps
    npca = share(crossings, "npca", surface, plane, gaps, by_contour, robot, rules)
    pca = share(crossings, "pca", surface, plane, gaps, by_interior, robot, rules)
    return [crossing for pair in zip(npca, pca, strict=True) for crossing in pair]


def by_gap(crossings: Iterable[Crossing]) -> list[dict[Method, Crossing]]:
    """The crossings of each gap, by method."""
    grouped: dict[int, dict[Method, Crossing]] = {}
    for crossing in crossings:
        grouped.setdefault(crossing.gap, {})[crossing.method] = crossing
    return list(grouped.values())


@dataclass(frozen=True, slots=True, eq=False)
class Hulls:
    """Con_j: the convex hull of each gap."""

    polygons: NDArray[np.object_]


def convex_hulls(gaps: Gaps) -> Hulls:
    return Hulls(np.asarray(shapely.convex_hull(gaps.polygons), dtype=object))


def contour_axes(gaps: Gaps, hulls: Hulls) -> Axes:
    """Section 3.2.1, NPCA: covariance of the normals of the convex contour, each edge weighted by its length.

    That is the limit of uniform sampling. e_opt is the first eigenvector: most of the contour faces it.
    """
    start, end, owner = _edges(hulls.polygons)
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.where(length > 0, length, 1.0)[:, None]
    total = _sums(length, owner, len(gaps))
    covariance = _sums(normal[:, :, None] * normal[:, None, :] * length[:, None, None], owner, len(gaps))
    covariance /= total[:, None, None]
    centre = _sums((start + end) / 2 * length[:, None], owner, len(gaps)) / total[:, None]
    return _axes(hulls, centre, covariance, eigenvector=1)


def interior_axes(gaps: Gaps, hulls: Hulls, uniform: str) -> Axes:
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
    shift = np.column_stack(
        [shapely.get_x(shapely.centroid(polygons)), shapely.get_y(shapely.centroid(polygons))]
    )
    parts, owner = shapely.get_parts(polygons, return_index=True)
    rings, part = shapely.get_rings(parts, return_index=True)
    hole = np.concatenate([[False], part[1:] == part[:-1]]) if len(part) else np.empty(0, dtype=bool)
    start, end, ring = _edges(np.asarray(rings, dtype=object))
    start, end = start - shift[owner[part[ring]]], end - shift[owner[part[ring]]]  # for precision
    cross = start[:, 0] * end[:, 1] - end[:, 0] * start[:, 1]
    orientation = np.sign(_sums(cross, ring, len(rings)))
    cross *= np.where(hole, -orientation, orientation)[ring]  # exteriors count, holes are taken away
    gap = owner[part[ring]]
    area = _sums(cross, gap, count) / 2
    mean = _sums((start + end) * cross[:, None], gap, count) / 6 / area[:, None]
    products = start[:, :, None] * start[:, None, :] + end[:, :, None] * end[:, None, :]
    products += (start + end)[:, :, None] * (start + end)[:, None, :]
    second = _sums(products * cross[:, None, None], gap, count) / 24 / area[:, None, None]
    return mean + shift, second - mean[:, :, None] * mean[:, None, :]


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


def crossings(
    method: Method,
    surface: Surface,
    plane: Plane,
    gaps: Gaps,
    axes: Axes,
    robot: Robot,
    rules: CrossingRules,
) -> list[Crossing]:
    """Section 3.2.3: START and END of each gap, and the first reason against crossing it, if any."""
    start, end = poses(axes, robot, rules)
    way = end - start
    yaw = np.arctan2(way[:, 1], way[:, 0])
    columns = zip(
        reasons_against(surface, gaps, axes, start, end, robot, rules),
        axes.length.tolist(),
        yaw.tolist(),
        _on_plane(plane, axes.centre),
        _on_plane(plane, start),
        _on_plane(plane, end),
        axes.tie.tolist(),
        strict=True,
    )
    return [
        Crossing(index, method, reason == "", reason, *others)
        for index, (reason, *others) in enumerate(columns)
    ]


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


def reasons_against(
    surface: Surface,
    gaps: Gaps,
    axes: Axes,
    start: FloatArray,
    end: FloatArray,
    robot: Robot,
    rules: CrossingRules,
) -> list[str]:
    """The first of too_long, gap, obstacle, own_gap, clipped, unobserved that applies to a gap, or empty."""
    clearance = limits(rules, robot).clearance
    short = np.flatnonzero(axes.length <= limits(rules, robot).d_r)
    reasons = ["too_long"] * len(gaps)
    if len(short) == 0:
        return reasons
    ends = np.stack([start[short], end[short]], axis=1)  # (S, START or END, 2)
    neighbours = _within(gaps.polygons, ends, clearance)
    own = neighbours[np.arange(len(short)), short]
    others = neighbours.copy()
    others[np.arange(len(short)), short] = False
    obstacles = _within(_obstacles_near(surface, ends, clearance), ends, clearance)
    applies = {
        "gap": np.asarray(others.any(axis=1)),
        "obstacle": np.asarray(obstacles.any(axis=1)),
        "own_gap": own,
    }
    if rules.rules == "all":  # what the paper leaves out
        applies["clipped"] = _clipped(surface, gaps, axes, robot)[short]
        applies["unobserved"] = _observed_share(surface, ends, robot).min(axis=1) < rules.min_observed
    for place, index in enumerate(short.tolist()):
        reasons[index] = next((name for name, hit in applies.items() if hit[place]), "")
    return reasons


def _within(polygons: NDArray[np.object_], ends: FloatArray, clearance: float) -> NDArray[np.bool_]:
    """Whether START or END (S, 2, 2) lies within the clearance of each polygon; (S, number of polygons)."""
    near = np.zeros((len(ends), len(polygons)), dtype=np.bool_)
    if near.size:
        spots = np.asarray(shapely.points(ends.reshape(-1, 2)))
        spot, polygon = shapely.STRtree(polygons).query(spots, predicate="dwithin", distance=clearance)
        near[spot // 2, polygon] = True
    return near


def _obstacles_near(surface: Surface, ends: FloatArray, clearance: float) -> NDArray[np.object_]:
    """Polygons of the obstacle cells that may lie within the clearance of START or END (S, 2, 2)."""
    grid = surface.grid
    row, column = np.nonzero(surface.obstacle)
    middle, corner = midpoints(grid)[row, column], corners(grid)[row + 1, column]
    radius = np.hypot(*(corner - middle).T)  # the outer corners are the farthest from the middle
    spots = ends.reshape(-1, 1, 2)
    near = (np.hypot(*(middle - spots).transpose(2, 0, 1)) <= clearance + radius).any(axis=0)
    mask = np.zeros_like(surface.obstacle)
    mask[row[near], column[near]] = True
    return cell_polygons(grid, mask)


def _clipped(surface: Surface, gaps: Gaps, axes: Axes, robot: Robot) -> NDArray[np.bool_]:
    """Whether each gap borders on the unknown within the robot's width of the way over it, (N_g,).

    Its length is then only a lower bound: it may go on in a shadow, in the blind zone or outside the box.
    """
    border, owner = _borders_on_unknown(surface, gaps)
    sideways = np.stack([-axes.e_opt[:, 1], axes.e_opt[:, 0]], axis=1)[owner]
    offset = ((border - axes.centre[owner][:, None]) * sideways[:, None]).sum(axis=2)
    astride = (offset[:, 0] < 0) != (offset[:, 1] < 0)
    on_the_way = astride | (np.abs(offset).min(axis=1) <= robot.width / 2)
    clipped = np.zeros(len(gaps), dtype=np.bool_)
    clipped[owner[on_the_way]] = True
    return clipped


def _borders_on_unknown(surface: Surface, gaps: Gaps) -> tuple[FloatArray, NDArray[np.int32]]:
    """Cell edges (M, 2 ends, 2) between gaps and cells of which nothing is known, and whose they are (M,)."""
    places = corners(surface.grid)
    label = np.pad(gaps.labels, 1)
    unknown = np.pad(surface.unknown, 1, constant_values=True)
    arc = (label[:-1] * unknown[1:] + unknown[:-1] * label[1:])[:, 1:-1]  # between rows
    ray = (label[:, :-1] * unknown[:, 1:] + unknown[:, :-1] * label[:, 1:])[1:-1]  # between columns
    (row, column), (row_, column_) = np.nonzero(arc), np.nonzero(ray)
    arcs = np.stack([places[row, column], places[row, column + 1]], axis=1)
    rays = np.stack([places[row_, column_], places[row_ + 1, column_]], axis=1)
    return np.concatenate([arcs, rays]), np.concatenate([arc[row, column], ray[row_, column_]]) - 1


def _observed_share(surface: Surface, ends: FloatArray, robot: Robot) -> FloatArray:
    """Share of the robot's footprint at START and END (S, 2, 2) that lies on observed ground, (S, 2).

    The robot stands on its own footprint now, so that counts as observed.
    """
    way = ends[:, 1] - ends[:, 0]
    yaw = np.arctan2(way[:, 1], way[:, 0])[:, None, None]
    along, across = np.meshgrid(
        np.linspace(-robot.length / 2, robot.length / 2, FOOTPRINT[0]),
        np.linspace(-robot.width / 2, robot.width / 2, FOOTPRINT[1]),
    )
    x = ends[:, :, :1] + np.cos(yaw) * along.ravel() - np.sin(yaw) * across.ravel()
    y = ends[:, :, 1:] + np.sin(yaw) * along.ravel() + np.cos(yaw) * across.ravel()
    grid = surface.grid
    row, column = cells(grid, x - grid.origin[0], y - grid.origin[1])
    inside = (row < grid.rows) & (column < grid.width)
    ground = surface.ground & ~surface.gap.cells
    observed = inside & ground[np.where(inside, row, 0), np.where(inside, column, 0)]
    observed |= (np.abs(x) <= robot.length / 2) & (np.abs(y) <= robot.width / 2)
    share: FloatArray = observed.mean(axis=2)
    return share


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


def _sums(values: FloatArray, owner: NDArray[np.intp], count: int) -> FloatArray:
    total = np.zeros((count, *values.shape[1:]))
    np.add.at(total, owner, values)
    return total


def _on_plane(plane: Plane, places: FloatArray) -> list[tuple[float, float, float]]:
    return [(x, y, z) for (x, y), z in zip(places.tolist(), plane.height(places).tolist(), strict=True)]
