"""Algorithm 1 up to the filtered binary image: what is known of each polar cell."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gapeval.config import BodyBox
from gapeval.detection.grid import PolarGrid, cells, row_edges
from gapeval.frame import FloatArray, Frame, Plane
from gapeval.visibility import without_body

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class CellTable:
    """All that Algorithm 1 needs of the points: two numbers per cell, for any threshold.

    A cell is on the plane iff least <= pl_th, and holds an obstacle iff highest > pl_th.

    least: smallest |t| of Eq. (1) [m], inf where no point fell; (height - 1 + margin, 2 width).
    highest: largest t [m], -inf where no point fell; same shape.
    """

    grid: PolarGrid
    margin: int
    least: FloatArray
    highest: FloatArray


def cell_table(
    frame: Frame,
    grid: PolarGrid,
    plane: Plane,
    z_min: float,
    z_max: float,
    body: BodyBox | None,
    margin: int,
) -> CellTable:
    """Bin the points once: Eqs. (1)-(4), box in z, robot body left out; `margin` rows beyond the box.

    The box in x and r is a matter of cells, not of points: an obstacle nearer than x_min shades too.
    """
    rows, columns = grid.rows + margin, 2 * grid.width
    points = without_body(_near(frame.points, grid, z_min, z_max, margin), body).astype(np.float64)
    t = plane.distance(points)
    row, column = cells(grid, points[:, 0] - grid.origin[0], points[:, 1] - grid.origin[1])
    inside = row < rows
    cell = (row * columns + column)[inside]
    t = t[inside]
    least, highest = np.full(rows * columns, np.inf), np.full(rows * columns, -np.inf)
    np.minimum.at(least, cell, np.abs(t))
    np.maximum.at(highest, cell, t)
    return CellTable(grid, margin, least.reshape(rows, columns), highest.reshape(rows, columns))


@dataclass(frozen=True, slots=True, eq=False)
class BinaryImage:
    """Algorithm 1's marks, `margin` cells larger than the box on each side but the inner one.

    ground: a point on the supporting plane fell here.
    obstacle: a point above it did.
    shaded: at or behind an obstacle along the ray.
    All (height - 1 + margin, width + 2 margin).
    """

    margin: int
    ground: BoolArray
    obstacle: BoolArray
    shaded: BoolArray


def binary_image(table: CellTable, pl_th: float, margin: int) -> BinaryImage:
    """Section 3.1.1: threshold the cells, then shade each column from its first obstacle outwards."""
    width = table.grid.width
    columns = np.arange(-margin, width + margin) % (2 * width)
    rows = table.grid.rows + margin
    ground = table.least[:rows, columns] <= pl_th
    obstacle = table.highest[:rows, columns] > pl_th
    shaded = np.logical_or.accumulate(obstacle, axis=0)
    return BinaryImage(margin, ground, obstacle, shaded)


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """Cells of the box that are set, (height - 1, width); equal masks compare and hash equal."""

    cells: BoolArray

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mask) and np.array_equal(self.cells, other.cells)

    def __hash__(self) -> int:
        return hash((self.cells.shape, self.cells.tobytes()))


def morphology(image: BinaryImage, seen: Mask, n_o: int, edge: str, kernel: str) -> Mask:
    """Section 3.1.2: n_o erosions, then n_o dilations of the gap cells, within the cells that are seen.

    `edge: data` opens the larger image and masks it then, so that opening does not eat a gap that the
    edge of the box cuts; with a margin of 2 n_o the result is that of an image without bounds.
    `edge: zero` masks first: everything outside counts as no gap.
    """
    margin = image.margin
    gap = ~(image.ground | image.shaded)
    if edge == "zero":
        gap &= np.pad(seen.cells, ((0, margin), (margin, margin)))
    if n_o > 0:
        shape = cv2.MORPH_RECT if kernel == "rect" else cv2.MORPH_CROSS
        element = cv2.getStructuringElement(shape, (3, 3))
        opened = cv2.morphologyEx(gap.astype(np.uint8), cv2.MORPH_OPEN, element, iterations=n_o)
        gap = opened.astype(np.bool_)
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
    ground, obstacle, shaded = (
        within_box(marks, image.margin) for marks in (image.ground, image.obstacle, image.shaded)
    )
    return Surface(grid, ground, obstacle, shaded, seen, gap)


def _near(
    points: NDArray[np.float32], grid: PolarGrid, z_min: float, z_max: float, margin: int
) -> NDArray[np.float32]:
    """The points (M, 3) that can fall in the grid and its margin; a coarse, cheap cut."""
    reach = row_edges(grid, grid.rows + margin)[-1] * (1 + 1e-6)
    behind = -reach * np.sin(min(margin * grid.theta_int, np.pi / 2)) - 1e-6
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    kept = (x >= grid.origin[0] + behind) & (x <= grid.origin[0] + reach)
    kept &= np.abs(y - np.float32(grid.origin[1])) <= reach + 1e-3
    kept &= (z >= np.float64(-z_min)) & (z <= np.float64(z_max))  # not rounded to float32
    near: NDArray[np.float32] = points[kept]
    return near
