"""Section 3.2.3 and our own rules: why a gap may not be crossed."""

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.config import CrossingRules, Robot, limits
from gapeval.detection import Detection
from gapeval.detection.contours import Shapes
from gapeval.detection.grid import cell_polygons, cells, corners, midpoints
from gapeval.detection.surface import BoolArray
from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray, spans
from gapeval.traversability.axes import ROUNDING, Axes
from gapeval.traversability.crossings import Candidates, Ways

FOOTPRINT = 9, 7  # samples of a footprint along and across


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
