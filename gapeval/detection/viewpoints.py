"""What is hidden from wherever a cloud was seen from: scans gathered on the way, several lasers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.config import FieldOfView
from gapeval.detection.grid import FAR, PolarGrid, row_edges, rows_of
from gapeval.frame import FloatArray, Plane, Transform, Viewpoint
from gapeval.ragged import IndexArray, spans
from gapeval.visibility import BINS, looked_at

BoolArray = NDArray[np.bool_]

FARTHEST = 4.0  # times r_max; small rows out to a viewpoint that is far away would be too many
TOUCHES = 1e-9  # m; a corner where the viewpoint is lies in no direction


@dataclass(frozen=True, slots=True)
class Sight:
    """All that looks at a plane: a sensor, robot<-sensor, with its lowest ray [rad]; and the others."""

    plane: Plane
    mount: Transform
    lowest: float
    others: tuple[Viewpoint, ...]
    fov: FieldOfView | None


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """highest: largest t [m] in each cell of the full circle, (rows, 2 width); -inf where no point fell."""

    grid: PolarGrid
    highest: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Elsewhere:
    """What the other viewpoints need to know of a grid with `margin`, and of what stands around it.

    looked_at: whether the sensor, and each of the others, looks there, (1 + V, height - 1 + margin,
    width + 2 margin).
    """

    around: Around
    margin: int
    sight: Sight
    looked_at: BoolArray


def circle(grid: PolarGrid, others: Sequence[Viewpoint]) -> float:
    """How far around the grid's origin obstacles are known to other viewpoints [m]: the box and them.

    Not by the table's margin, which is that of a whole sweep.
    """
    away = [float(np.hypot(*(view.mount.translation[:2] - grid.origin))) for view in others]
    return min(max(grid.r_max, *away), FARTHEST * grid.r_max)


def rows_around(grid: PolarGrid, others: Sequence[Viewpoint]) -> int:
    return int(rows_of(grid, np.array([circle(grid, others)]), 2**31)[0]) + 1


def elsewhere(around: Around, margin: int, sight: Sight) -> Elsewhere:
    """For a sight that has others."""
    grid = around.grid
    rows, columns = grid.rows + margin, np.arange(-margin, grid.width + margin)
    places = _midpoints(grid, rows, np.arange(rows)[:, None], columns[None, :])
    looking = [Viewpoint(sight.mount, sight.lowest), *sight.others]
    looked = [
        looked_at(places, sight.plane, view.mount, view.lowest_elevation, sight.fov) for view in looking
    ]
    return Elsewhere(around, margin, sight, np.stack(looked))


def hidden_from_all(
    elsewhere: Elsewhere, pl_th: float, ground: BoolArray, obstacle: BoolArray, shaded: BoolArray
) -> BoolArray:
    """Cells that hold an obstacle, or before which one stands for each viewpoint that looks at them.

    ground, obstacle, shaded: as the sensor alone has them, (height - 1 + margin, width + 2 margin). What
    nobody looks at, and ground, stays as it is.
    """
    grid, sight = elsewhere.around.grid, elsewhere.sight
    by_sensor, *by_others = elsewhere.looked_at
    asked = ~(ground | obstacle) & (shaded | ~by_sensor)
    row, column = np.nonzero(asked)
    places = _midpoints(grid, len(asked), row, column - elsewhere.margin)
    standing = Standing.of(grid, elsewhere.around.highest > pl_th)
    free, left = np.zeros(len(row), dtype=np.bool_), np.arange(len(row))
    for view, looked in zip(sight.others, by_others, strict=True):
        here = looked[asked]
        looking = left[here[left]]
        before = standing.before(places[looking], view.mount.translation[:2], bins(grid))
        free[looking[~before]] = True
        left = left[~free[left]]
    hidden = shaded.copy()
    by_any = np.asarray(elsewhere.looked_at.any(axis=0))
    hidden[asked] = np.where(by_any[asked], ~free, shaded[asked])
    return hidden


def bins(grid: PolarGrid) -> int:
    """Directions around a viewpoint: half a degree, or half a column of the grid if that is less."""
    return max(BINS, 4 * grid.width)


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Cells that hold an obstacle: corners (N, 4, 2), in order, and midpoints (N, 2), robot frame [m]."""

    corners: FloatArray
    middle: FloatArray

    @classmethod
    def of(cls, grid: PolarGrid, obstacle: BoolArray) -> "Standing":
        """obstacle: of the full circle, (rows, 2 width)."""
        row, column = np.nonzero(obstacle)
        edges = _edges(grid, len(obstacle))
        corners = [
            _places(grid, edges[row + far], column + float(left))
            for far, left in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        return cls(np.stack(corners, axis=1), _midpoints(grid, len(obstacle), row, column))

    def before(self, places: FloatArray, origin: FloatArray, count: int) -> BoolArray:
        """Whether a place (M, 2) lies at or behind one of the cells, as seen from an origin; (M,).

        Around the origin are `count` bins. A cell stands in each bin in which a part of it lies, from its
        nearest point on. One that holds the origin itself hides nothing.
        """
        nearest = np.full(count, np.inf)
        step = 2 * np.pi / count
        corners, middle = self.corners - origin, self.middle - origin
        towards = np.arctan2(middle[:, 1], middle[:, 0])
        # Counted from the direction of the middle, so that no span is cut where angles begin.
        off = np.arctan2(corners[..., 1], corners[..., 0]) - towards[:, None]
        off -= 2 * np.pi * np.rint(off / (2 * np.pi))
        off[np.hypot(*np.moveaxis(corners, 2, 0)) < TOUCHES] = 0.0
        right, left = off.min(axis=1), off.max(axis=1)
        outside = left - right < np.pi
        towards, right, left = towards[outside], right[outside], left[outside]
        first = np.floor((towards + right) / step).astype(np.intp)
        last = np.floor((towards + left) / step).astype(np.intp)
        bin_, cell = spans(first, last - first + 1)
        np.minimum.at(nearest, bin_ % count, _distances(corners[outside])[cell])
        x, y = (places - origin).T
        own = np.floor(np.arctan2(y, x) / step).astype(np.intp) % count
        behind: BoolArray = np.hypot(x, y) >= nearest[own]
        return behind


def _distances(corners: FloatArray) -> FloatArray:
    """From the origin to the nearest point of each outline (N, 4, 2), (N,)."""
    along = np.roll(corners, -1, axis=1) - corners
    length = (along**2).sum(axis=2)
    share = -(corners * along).sum(axis=2) / np.where(length > 0, length, 1.0)
    foot = corners + np.clip(share, 0.0, 1.0)[..., None] * along
    distance: FloatArray = np.hypot(foot[..., 0], foot[..., 1]).min(axis=1)
    return distance


def _midpoints(grid: PolarGrid, rows: int, row: IndexArray, column: IndexArray) -> FloatArray:
    """Of these cells of a grid with so many rows, robot frame [m], (..., 2); columns go on around."""
    edges = _edges(grid, rows)
    return _places(grid, ((edges[:-1] + edges[1:]) / 2)[row], column + 0.5)


def _edges(grid: PolarGrid, rows: int) -> FloatArray:
    with np.errstate(over="ignore"):
        return np.minimum(row_edges(grid, rows), FAR)


def _places(grid: PolarGrid, r: FloatArray, column: NDArray[np.floating]) -> FloatArray:
    theta = column * grid.theta_int - np.pi / 2
    return np.stack([grid.origin[0] + r * np.cos(theta), grid.origin[1] + r * np.sin(theta)], axis=-1)
