"""Sections 3.1.2 and 3.1.3: regions of the filtered image, their outlines and their point clouds."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.detection.grid import PolarGrid, corners, midpoints
from gapeval.detection.surface import Mask
from gapeval.frame import FloatArray
from gapeval.ragged import distinct, spans


@dataclass(frozen=True, slots=True, eq=False)
class Gap:
    """One region of the polar image.

    index: its place in the detection, near gaps first.
    polygon: outline of its cells' edges, with holes, robot frame xy [m].
    cells: which cells of the box belong to it, (height - 1, width).
    """

    index: int
    polygon: BaseGeometry
    cells: NDArray[np.bool_]
    grid: PolarGrid

    def point_cloud(self, interior: bool) -> FloatArray:
        """The paper's G_j (3.1.3): centres of its cells (K true) or of its contour's cells, (N, 2) [m]."""
        mask = self.cells
        if not interior:
            inner = cv2.erode(
                np.pad(mask, 1).astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
            )
            mask = mask & ~inner[1:-1, 1:-1].astype(np.bool_)
        return midpoints(self.grid)[mask]


@dataclass(frozen=True, eq=False)
class Gaps(Sequence[Gap]):
    """All gaps of one image, kept as arrays.

    polygons: (N_g,) of (Multi)Polygon. image: their cells. seeds: (N_g, 2), row and column of a cell of each.
    """

    grid: PolarGrid
    polygons: NDArray[np.object_]
    image: Mask
    seeds: NDArray[np.intp]

    @cached_property
    def labels(self) -> NDArray[np.int32]:
        """Whose each cell is, (height - 1, width): 0 for no gap, else index + 1. Few are asked for it."""
        count, components = cv2.connectedComponents(self.image.cells.astype(np.uint8), connectivity=8)
        number = np.zeros(count, dtype=np.int32)
        number[components[self.seeds[:, 0], self.seeds[:, 1]]] = np.arange(1, len(self) + 1)
        labels: NDArray[np.int32] = number[components]
        return labels

    @property
    def pieces(self) -> NDArray[np.object_]:
        """The polygons again: gaps of one image never overlap."""
        return self.polygons

    def __len__(self) -> int:
        return len(self.polygons)

    @overload
    def __getitem__(self, index: int) -> Gap: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Gap]: ...
    def __getitem__(self, index: int | slice) -> Gap | Sequence[Gap]:
        if isinstance(index, slice):
            return [self[i] for i in range(len(self))[index]]
        index = range(len(self))[index]
        return Gap(index, self.polygons[index], self.labels == index + 1, self.grid)

    def __iter__(self) -> Iterator[Gap]:
        return (self[i] for i in range(len(self)))


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """The distinct polygons of many images, (M,); `which`: those that the gaps of each image have."""

    polygons: NDArray[np.object_]
    images: tuple[Gaps, ...]
    which: tuple[NDArray[np.intp], ...]

    def __len__(self) -> int:
        return len(self.polygons)

    def __iter__(self) -> Iterator[Gap]:
        """A gap that has each."""
        found: dict[int, Gap] = {}
        for gaps, which in zip(self.images, self.which, strict=True):
            for index, shape in enumerate(which.tolist()):
                if shape not in found:
                    found[shape] = gaps[index]
        return (found[shape] for shape in range(len(self)))


def shapes_of(images: Sequence[Gaps]) -> Shapes:
    """Equal regions of a grid's images are one polygon already, see find_contours; here they are gathered."""
    once = list(dict.fromkeys(images))
    polygons, which = distinct([gaps.polygons for gaps in once])
    place = dict(zip(once, which, strict=True))
    return Shapes(polygons, tuple(images), tuple(place[gaps] for gaps in images))


def find_contours(images: Sequence[tuple[PolarGrid, Mask]]) -> list[Gaps]:
    """Border following (Suzuki & Abe) on filtered images; gaps in raster order, so near ones first.

    Equal regions of a grid's images are one polygon. Images of a grid are followed together, one below
    the other.
    """
    by_grid: dict[PolarGrid, list[int]] = {}
    for index, (grid, _) in enumerate(images):
        by_grid.setdefault(grid, []).append(index)
    found: dict[int, Gaps] = {}
    for grid, indices in by_grid.items():
        found |= zip(indices, _gaps_of_grid(grid, [images[index][1] for index in indices]), strict=True)
    return [found[index] for index in range(len(images))]


def _gaps_of_grid(grid: PolarGrid, images: Sequence[Mask]) -> list[Gaps]:
    """The gaps of images of one grid.

    A polygon runs along the edges of its cells, not through their centres: those would make every gap
    one cell too small. In an image repeated 2 x 2, the cell corner beside a border pixel is
    (pixel + 1) // 2. Cells that touch at a corner only are one region, and a MultiPolygon.
    """
    count, rows, width = len(images), grid.rows, grid.width
    apart = np.zeros((count, rows + 1, width), dtype=np.uint8)  # a row between images
    for place, image in zip(apart, images, strict=True):
        place[:rows] = image.cells
    pile = apart.reshape(-1, width)
    doubled = cv2.resize(pile, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST_EXACT)
    contours, hierarchy = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not contours:
        nothing = np.empty(0, dtype=object), np.empty((0, 2), dtype=np.intp)
        return [Gaps(grid, nothing[0], image, nothing[1]) for image in images]
    sizes = np.fromiter(map(len, contours), dtype=np.intp, count=len(contours))
    pixels = np.concatenate(contours).reshape(-1, 2).astype(np.int32, copy=False)
    starts = np.cumsum(sizes) - sizes
    corner, ends = _corners_along(pixels, starts, sizes)
    corner[:, 1] -= np.repeat(pixels[starts, 1] // (2 * (rows + 1)) * (rows + 1), np.diff(ends, prepend=0))
    parent = np.asarray(hierarchy, dtype=np.int32)[0, :, 3]
    outer = np.flatnonzero(parent < 0)
    first_cell = np.minimum.reduceat(pixels[:, 1] * np.intp(doubled.shape[1]) + pixels[:, 0], starts)
    order = outer[np.argsort(first_cell[outer])]
    polygons = _polygons(grid, corner, ends, parent, order)
    seeds = pixels[starts[order], ::-1].astype(np.intp) // 2
    owner = seeds[:, 0] // (rows + 1)
    seeds[:, 0] -= owner * (rows + 1)
    ends_of_images = np.searchsorted(owner, np.arange(count + 1))
    return [
        Gaps(grid, polygons[first:last], image, seeds[first:last])
        for image, (first, last) in zip(images, itertools.pairwise(ends_of_images), strict=True)
    ]


def _corners_along(
    pixels: NDArray[np.int32], starts: NDArray[np.intp], sizes: NDArray[np.intp]
) -> tuple[NDArray[np.int32], NDArray[np.intp]]:
    """Cell corners (column, row) along each contour, and where those of each contour end."""
    corner = (pixels + 1) >> 1
    before = np.empty_like(corner)
    before[1:] = corner[:-1]
    before[starts] = corner[starts + sizes - 1]
    kept = (corner[:, 0] != before[:, 0]) | (corner[:, 1] != before[:, 1])
    return corner[kept], np.add.reduceat(kept, starts, dtype=np.intp).cumsum()


def _polygons(
    grid: PolarGrid,
    corner: NDArray[np.int32],
    ends: NDArray[np.intp],
    parent: NDArray[np.int32],
    order: NDArray[np.intp],
) -> NDArray[np.object_]:
    """The polygons of the outer contours in this order, each with its holes; always valid."""
    path = [corner[first:last].tobytes() for first, last in itertools.pairwise((0, *ends.tolist()))]
    holes: dict[int, list[int]] = {}
    for hole in np.flatnonzero(parent >= 0).tolist():
        holes.setdefault(int(parent[hole]), []).append(hole)
    # Equal regions of several images are one shape.
    number: dict[tuple[bytes, ...], int] = {}
    shapes: list[int] = []  # an outer contour of each
    shape_of = []
    for outer in order.tolist():
        key = (path[outer], *(path[hole] for hole in holes.get(outer, ())))
        if key not in number:
            number[key] = len(shapes)
            shapes.append(outer)
        shape_of.append(number[key])
    wanted = [ring for outer in shapes for ring in (outer, *holes.get(outer, ()))]
    of_shape = np.repeat(np.arange(len(shapes)), [1 + len(holes.get(outer, ())) for outer in shapes])
    lengths = np.diff(ends, prepend=0)[wanted]
    where, ring = spans(ends[wanted] - lengths, lengths)
    column, row = corner[where].T
    rings = np.asarray(shapely.linearrings(corners(grid)[row, column], indices=ring), dtype=object)
    # A ring within the same shape goes to one polygon: the first is its outline, others are holes.
    polygons = np.asarray(shapely.polygons(rings, indices=of_shape), dtype=object)
    broken = _doubtful(of_shape[ring], row, column, grid, len(shapes))
    broken[broken] = ~shapely.is_valid(polygons[broken])
    polygons[broken] = shapely.make_valid(polygons[broken], method="structure", keep_collapsed=False)
    return polygons[shape_of]


def _doubtful(
    shape: NDArray[np.intp],
    row: NDArray[np.int32],
    column: NDArray[np.int32],
    grid: PolarGrid,
    count: int,
) -> NDArray[np.bool_]:
    """Shapes (count,) that may be invalid: they come to a corner twice, or to the pole, where all meet."""
    place = (shape * grid.height + row) * (grid.width + 1) + column
    order = np.argsort(place)
    again = order[1:][place[order[1:]] == place[order[:-1]]]
    doubtful = np.zeros(count, dtype=np.bool_)
    doubtful[shape[again]] = True
    doubtful[shape[row == 0]] = True
    return doubtful
