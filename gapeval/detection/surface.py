"""Algorithm 1 up to the filtered binary image: what is known of each polar cell."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from gapeval.config import BodyBox
from gapeval.detection.grid import FAR, PolarGrid, columns_of, polar, row_edges, rows_of
from gapeval.detection.viewpoints import Around, Elsewhere, hidden_from_all
from gapeval.frame import FloatArray, Frame, Plane
from gapeval.ragged import IndexArray
from gapeval.visibility import without_body

BoolArray = NDArray[np.bool_]

KERNELS = {
    "rect": cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3)),
    "cross": cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)),
}


@dataclass(frozen=True, slots=True, eq=False)
class PolarPoints:
    """The points that may fall in a grid and its margin, as Eqs. (1) and (2) see them; (N,) of each.

    r [m], theta [rad]: from the grid's origin, see `polar`. t: signed distance from the plane [m];
    distance: without its sign.
    """

    r: FloatArray
    theta: FloatArray
    t: FloatArray
    distance: FloatArray


@dataclass(frozen=True, slots=True)
class Reach:
    """How far from a grid's origin points are looked at: to the front and the sides, and to the back [m]."""

    front: float
    back: float


def reach_of(grids: Iterable[PolarGrid], margin: int) -> Reach:
    """What covers grids and `margin` cells beyond the box, on all sides but the inner one."""
    front = back = 0.0
    for grid in grids:
        outermost = float(row_edges(grid, grid.rows + margin)[-1])
        front = max(front, outermost)
        back = max(back, outermost * float(np.sin(min(margin * grid.theta_int, np.pi / 2))))
    return Reach(min(front, FAR), min(back, FAR))


def all_around(reach: Reach, far: float) -> Reach:
    """What covers a circle around the origin too [m]: what stands behind the grid hides from elsewhere."""
    return Reach(max(reach.front, far), max(reach.back, far))


def polar_points(
    frame: Frame,
    origin: tuple[float, float],
    plane: Plane,
    z_min: float,
    z_max: float,
    body: BodyBox | None,
    reach: Reach,
) -> PolarPoints:
    """Eqs. (1) and (2) for the points within reach, box in z, robot body left out.

    The box in x and r is a matter of cells, not of points: an obstacle nearer than x_min shades too.
    """
    columns = np.ascontiguousarray(frame.points.T)  # whole columns are much quicker to work at
    x, y, z = columns[0] - np.float32(origin[0]), columns[1] - np.float32(origin[1]), columns[2]
    with np.errstate(over="ignore", under="ignore"):  # of points that are out of all reach
        kept = x * x + y * y <= np.float32(reach.front * (1 + 1e-4) + 1e-3) ** 2  # a coarse, cheap cut
    kept &= x >= np.float32(-reach.back * (1 + 1e-4) - 1e-3)
    kept &= (z >= -_rounded_down(z_min)) & (z <= _rounded_down(z_max))
    points = without_body(np.compress(kept, columns, axis=1).T, body).astype(np.float64)
    r, theta = polar(points[:, 0] - origin[0], points[:, 1] - origin[1])
    t = plane.distance(points)
    return PolarPoints(r, theta, t, np.abs(t))


def _rounded_down(limit: float) -> np.float32:
    """The largest float32 that is no more than a limit: as good for float32, and cheaper to compare."""
    nearest = np.float32(min(limit, float(np.finfo(np.float32).max)))
    return nearest if float(nearest) <= limit else np.nextafter(nearest, np.float32(-np.inf))


@dataclass(frozen=True, slots=True, eq=False)
class CellTable:
    """All that Algorithm 1 needs of the points: two numbers per cell, for any threshold.

    A cell is on the plane iff least <= pl_th, and holds an obstacle iff highest > pl_th.

    least: smallest |t| of Eq. (1) [m], inf where no point fell; (height - 1 + margin, width + 2 margin): the
    box, and `margin` cells beyond it on each side but the inner one.
    highest: largest t [m], -inf where no point fell; same shape.
    """

    grid: PolarGrid
    margin: int
    least: FloatArray
    highest: FloatArray


def cell_table(points: PolarPoints, grid: PolarGrid, margin: int) -> CellTable:
    """Bin the points once: Eqs. (3) and (4), `margin` rows beyond the box."""
    rows, columns = grid.rows + margin, 2 * grid.width
    cell = _cells(points, grid, rows)
    least, highest = np.full((rows + 1) * columns, np.inf), np.full((rows + 1) * columns, -np.inf)
    np.minimum.at(least, cell, points.distance)
    np.maximum.at(highest, cell, points.t)
    wanted = np.arange(-margin, grid.width + margin) % columns  # of the full circle
    return CellTable(
        grid,
        margin,
        least.reshape(rows + 1, columns)[:rows, wanted],
        highest.reshape(rows + 1, columns)[:rows, wanted],
    )


def highest_around(points: PolarPoints, grid: PolarGrid, rows: int) -> Around:
    """So many rows of the full circle."""
    columns = 2 * grid.width
    highest = np.full((rows + 1) * columns, -np.inf)
    np.maximum.at(highest, _cells(points, grid, rows), points.t)
    return Around(grid, highest.reshape(rows + 1, columns)[:rows])


def _cells(points: PolarPoints, grid: PolarGrid, rows: int) -> IndexArray:
    """Where each point (N,) falls in a full circle; what lies beyond goes to one row more, to be left out."""
    cell = rows_of(grid, points.r, rows)
    cell *= 2 * grid.width
    cell += columns_of(grid, points.theta)
    return cell


@dataclass(frozen=True, slots=True, eq=False)
class BinaryImage:
    """Algorithm 1's marks.

    gap: neither ground nor shaded, `margin` cells larger than the box on each side but the inner one:
    (height - 1 + margin, width + 2 margin).
    ground: a point on the supporting plane fell here. obstacle: a point above it did. shaded: at or behind
    an obstacle along the ray, seen from wherever the cell is looked at. All (height - 1, width).
    """

    margin: int
    gap: BoolArray
    ground: BoolArray
    obstacle: BoolArray
    shaded: BoolArray


def binary_image(table: CellTable, elsewhere: Elsewhere | None, pl_th: float) -> BinaryImage:
    """Section 3.1.1: threshold the cells, then shade each column from its first obstacle outwards.

    elsewhere: what else looks at the cells, and may look behind an obstacle.
    """
    ground, obstacle = table.least <= pl_th, table.highest > pl_th
    shaded = np.logical_or.accumulate(obstacle, axis=0)
    if elsewhere is not None:
        shaded = hidden_from_all(elsewhere, pl_th, ground, obstacle, shaded)
    marks = (within_box(mark, table.margin).copy() for mark in (ground, obstacle, shaded))
    return BinaryImage(table.margin, ~(ground | shaded), *marks)


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """Cells of the box that are set, (height - 1, width); equal masks compare and hash equal."""

    cells: BoolArray
    packed: bytes = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "packed", np.packbits(self.cells).tobytes())

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Mask) and self.packed == other.packed and self.cells.shape == other.cells.shape
        )

    def __hash__(self) -> int:
        return hash(self.packed)


def morphology(image: BinaryImage, seen: Mask, n_o: int, edge: str, kernel: str) -> Mask:
    """Section 3.1.2: n_o erosions, then n_o dilations of the gap cells, within the cells that are seen.

    `edge: data` opens the larger image and masks it then, so that opening does not eat a gap that the
    edge of the box cuts; with a margin of 2 n_o or more the result is that of an image without bounds.
    `edge: zero` masks first: everything outside counts as no gap.
    """
    margin = image.margin
    gap = image.gap
    if edge == "zero":
        gap = gap & np.pad(seen.cells, ((0, margin), (margin, margin)))
    if n_o > 0:
        opened = cv2.morphologyEx(gap.view(np.uint8), cv2.MORPH_OPEN, KERNELS[kernel], iterations=n_o)
        gap = opened.view(np.bool_)
    return Mask(within_box(gap, margin) & seen.cells)


def within_box(cells_with_margin: BoolArray, margin: int) -> BoolArray:
    """The part of an image with margin that lies in the box, (height - 1, width)."""
    rows, columns = cells_with_margin.shape
    return cells_with_margin[: rows - margin, margin : columns - margin]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """What Algorithm 1 knows of each polar cell in the box; all (height - 1, width).

    ground: observed ground. obstacle: holds an obstacle. shaded: at or behind one. seen: in the box,
    and the sensor looks there. gap: the filtered image I_D.
    """

    grid: PolarGrid
    ground: BoolArray
    obstacle: BoolArray
    shaded: BoolArray
    seen: Mask
    gap: Mask

    @property
    def unknown(self) -> BoolArray:
        """Neither ground nor gap can be told here: outside the box, never looked at, or hidden."""
        return ~self.gap.cells & (~self.seen.cells | (self.shaded & ~self.ground))


def surface(grid: PolarGrid, image: BinaryImage, seen: Mask, gap: Mask) -> Surface:
    """The marks within the box, beside the filtered image."""
    return Surface(grid, image.ground, image.obstacle, image.shaded, seen, gap)
