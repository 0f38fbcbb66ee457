"""Section 3.2 of the paper (Algorithm 2): may the robot cross a gap, and from where to where?"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.config import CrossingRules, Robot, limits
from gapeval.detection import Detection
from gapeval.detection.contours import Gap, Gaps, Shapes, shapes_of
from gapeval.detection.grid import (
    PolarGrid,
    cell_polygons,
    cells,
    corners,
    midpoints,
    row_edges,
)
from gapeval.detections import METHODS, Crossing, Method
from gapeval.frame import FloatArray, Plane
from gapeval.ragged import IndexArray, spans, sums
from gapeval.share import Share

BoolArray = NDArray[np.bool_]

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


Asked = tuple[Detection, Robot, CrossingRules]


def assess(
    detection: Detection, robot: Robot | None = None, rules: CrossingRules | None = None
) -> list[Crossing]:
    """Algorithm 2 for all gaps of a detection, in both feature spaces: npca and pca of gap 0, of gap 1 ..."""
    found = assess_each([(detection, robot or Robot(), rules or CrossingRules())], Share())
    return found.of(0)


def assess_each(asked: Sequence[Asked], share: Share) -> "Crossings":
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


def reasons_against(
    detections: Sequence[Detection],
    candidates: Candidates,
    shapes: Shapes,
    axes: Axes,
    ways: Ways,
    robot: Robot,
    rules: CrossingRules,
) -> NDArray[np.object_]:
    """The first of too_long, gap, obstacle, own_gap, clipped, unobserved that applies, or empty, (N,).

    detections: of one grid; one of each image.
    """
    d_r, clearance = limits(rules, robot).d_r, limits(rules, robot).clearance
    tests: dict[str, Callable[[Candidates], BoolArray]] = {
        "too_long": lambda asked: axes.length[asked.way] > d_r,
        "gap": lambda asked: _near_gaps(candidates, asked, shapes, ways, clearance),
        "obstacle": lambda asked: _near_obstacles(detections, asked, ways, clearance),
        "own_gap": lambda asked: _near_itself(asked, shapes, ways, clearance),
    }
    if rules.rules == "all":  # what the paper leaves out
        tests |= {
            "clipped": lambda asked: _clipped(detections, asked, axes, robot),
            "unobserved": lambda asked: _observed_share(detections, asked, ways, robot) < rules.min_observed,
        }
    reasons = np.full(len(candidates.way), "", dtype=object)
    undecided = np.arange(len(reasons))
    for reason, applies in tests.items():
        if len(undecided):
            hit = applies(candidates[undecided])
            reasons[undecided[hit]] = reason
            undecided = undecided[~hit]
    return reasons


def _near_gaps(
    candidates: Candidates, asked: Candidates, shapes: Shapes, ways: Ways, clearance: float
) -> BoolArray:
    """Whether START or END of each asked way lies within the clearance of another gap of its image."""
    present, local = np.unique(candidates.shape, return_inverse=True)
    way, first, place = np.unique(asked.way, return_index=True, return_inverse=True)
    own = np.searchsorted(present, asked.shape[first])
    held = np.zeros((candidates.image[-1] + 1, len(present)), dtype=np.float32)  # which image holds which
    held[candidates.image, local] = 1.0
    beside = held[:, own].T @ held > 0  # whether any image holds both
    beside[np.arange(len(way)), own] = False
    polygons = shapes.polygons[present]
    shapely.prepare(polygons)
    tree = shapely.STRtree(polygons)
    near = np.zeros(beside.shape, dtype=np.float32)
    for ends in (ways.start[way], ways.end[way]):
        x, y = ends.T
        spot, neighbour = tree.query(shapely.box(x - clearance, y - clearance, x + clearance, y + clearance))
        wanted = beside[spot, neighbour]
        spot, neighbour = spot[wanted], neighbour[wanted]
        within = shapely.dwithin(polygons[neighbour], shapely.points(ends[spot]), clearance)
        near[spot[within], neighbour[within]] = 1.0
    neighbours = held @ near.T  # of each way in each image, how many; exact
    return np.asarray(neighbours[asked.image, place] > 0, dtype=np.bool_)


def _near_itself(asked: Candidates, shapes: Shapes, ways: Ways, clearance: float) -> BoolArray:
    """Whether START or END of each way lies within the clearance of the gap itself."""
    way, first, place = np.unique(asked.way, return_index=True, return_inverse=True)
    polygons = shapes.polygons[asked.shape[first]]
    near = [
        shapely.dwithin(polygons, shapely.points(ends[way]), clearance) for ends in (ways.start, ways.end)
    ]
    return np.asarray(near[0] | near[1], dtype=np.bool_)[place]


def _near_obstacles(
    detections: Sequence[Detection], asked: Candidates, ways: Ways, clearance: float
) -> BoolArray:
    """Whether START or END of each way lies within the clearance of an obstacle cell of its image."""
    grid = detections[0].surface.grid
    obstacles, of_image = _stacked([detection.surface.obstacle for detection in detections])
    way, place = np.unique(asked.way, return_inverse=True)
    cell = np.flatnonzero(obstacles.any(axis=0))
    row, column = cell // grid.width, cell % grid.width
    middle, corner = midpoints(grid)[row, column], corners(grid)[row + 1, column]
    reach = clearance + np.hypot(*(corner - middle).T)  # the outer corners are the farthest from the middle
    ends = np.concatenate([ways.start[way], ways.end[way]])
    spot, near = np.nonzero(
        (ends[:, :1] - middle[:, 0]) ** 2 + (ends[:, 1:] - middle[:, 1]) ** 2 <= reach**2 * (1 + ROUNDING)
    )
    used, quad = np.unique(near, return_inverse=True)
    quads = cell_polygons(grid, row[used], column[used])
    within = np.asarray(shapely.dwithin(quads[quad], shapely.points(ends[spot]), clearance), dtype=np.bool_)
    hit = np.zeros((len(obstacles), len(way)), dtype=np.bool_)
    for image, held in enumerate(obstacles):
        hit[image, spot[within & held[cell[near]]] % len(way)] = True
    return hit[of_image[asked.image], place]


def _clipped(detections: Sequence[Detection], asked: Candidates, axes: Axes, robot: Robot) -> BoolArray:
    """Whether each gap borders on the unknown within the robot's width of the way over it.

    Its length is then only a lower bound: it may go on in a shadow, in the blind zone or outside the box.
    """
    most = int(asked.gap.max()) + 1
    key, place = np.unique(asked.image * most + asked.gap, return_inverse=True)
    border, owner = _borders_on_unknown(detections, key // most, key % most)
    first = np.searchsorted(owner, np.arange(len(key) + 1))
    where, candidate = spans(first[place], np.diff(first)[place])
    way = asked.way[candidate]
    sideways = np.stack([-axes.e_opt[:, 1], axes.e_opt[:, 0]], axis=1)[way]
    offset = ((border[where] - axes.centre[way][:, None]) * sideways[:, None]).sum(axis=2)
    astride = (offset[:, 0] < 0) != (offset[:, 1] < 0)
    on_the_way = astride | (np.abs(offset).min(axis=1) <= robot.width / 2)
    clipped = np.zeros(len(place), dtype=np.bool_)
    clipped[candidate[on_the_way]] = True
    return clipped


def _borders_on_unknown(
    detections: Sequence[Detection], image: IndexArray, gap: IndexArray
) -> tuple[FloatArray, IndexArray]:
    """Cell edges (M, 2 ends, 2) between gaps and cells of which nothing is known, and whose, (M,) ascending.

    image, gap: (N,) which gap of which image.
    """
    grid = detections[0].surface.grid
    places = corners(grid)
    wanted, local = np.unique(image, return_inverse=True)
    unknown = np.ones((len(wanted), grid.rows + 2, grid.width + 2), dtype=np.bool_)  # also all around
    labels = np.empty((len(wanted), grid.rows, grid.width), dtype=np.int32)
    for index, detection in enumerate(detections[i] for i in wanted):
        unknown[index, 1:-1, 1:-1] = detection.surface.unknown
        labels[index] = detection.gaps.labels
    number = np.full((len(wanted), int(labels.max()) + 1), -1)  # of each image and label
    number[local, gap + 1] = np.arange(len(gap))
    of_image, row, column = np.unravel_index(np.flatnonzero(labels), labels.shape)
    of_gap = number[of_image, labels[of_image, row, column]]
    kept = of_gap >= 0
    of_image, row, column, of_gap = of_image[kept], row[kept], column[kept], of_gap[kept]
    edges, owners = [], []
    for beside, one, other in (
        ((0, 1), (0, 0), (0, 1)),  # the inner arc
        ((2, 1), (1, 0), (1, 1)),  # the outer arc
        ((1, 0), (0, 0), (1, 0)),  # the ray to the right
        ((1, 2), (0, 1), (1, 1)),  # the ray to the left
    ):
        at = unknown[of_image, row + beside[0], column + beside[1]]
        ends = [places[row[at] + down, column[at] + across] for down, across in (one, other)]
        edges.append(np.stack(ends, axis=1))
        owners.append(of_gap[at])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(edges)[order], owner[order]


def _stacked(images: Sequence[BoolArray]) -> tuple[BoolArray, IndexArray]:
    """The distinct images as rows (I, cells), and which of them each image is."""
    once = {id(image): image for image in images}
    place = {name: index for index, name in enumerate(once)}
    rows = np.stack([image.ravel() for image in once.values()])
    return rows, np.array([place[id(image)] for image in images])


def _observed_share(
    detections: Sequence[Detection], asked: Candidates, ways: Ways, robot: Robot
) -> FloatArray:
    """Share of the robot's footprint on observed ground, the lesser of START and END, (N,).

    The robot stands on its own footprint now, so that counts as observed.
    """
    grid = detections[0].surface.grid
    way, place = np.unique(asked.way, return_inverse=True)
    yaw = ways.yaw[way, None, None]
    along, across = np.meshgrid(
        np.linspace(-robot.length / 2, robot.length / 2, FOOTPRINT[0]),
        np.linspace(-robot.width / 2, robot.width / 2, FOOTPRINT[1]),
    )
    ends = np.stack([ways.start[way], ways.end[way]], axis=1)
    x = ends[:, :, :1] + np.cos(yaw) * along.ravel() - np.sin(yaw) * across.ravel()
    y = ends[:, :, 1:] + np.sin(yaw) * along.ravel() + np.cos(yaw) * across.ravel()
    row, column = cells(grid, x - grid.origin[0], y - grid.origin[1])
    inside = (row < grid.rows) & (column < grid.width)
    cell = np.where(inside, row * grid.width + column, 0)
    here = (np.abs(x) <= robot.length / 2) & (np.abs(y) <= robot.width / 2)
    ground, of_image = _stacked([detection.surface.ground for detection in detections])
    gap, of_gap = _stacked([detection.surface.gap.cells for detection in detections])
    image, cell = asked.image[:, None, None], cell[place]
    seen = inside[place] & ground[of_image[image], cell] & ~gap[of_gap[image], cell]
    share: FloatArray = (seen | here[place]).mean(axis=2).min(axis=1)
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
