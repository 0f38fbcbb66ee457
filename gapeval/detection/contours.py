"""Sections 3.1.2 and 3.1.3: regions of the filtered image, their outlines and their point clouds."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.detection.grid import PolarGrid, corners, midpoints
from gapeval.detection.surface import Mask
from gapeval.frame import FloatArray


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


@dataclass(frozen=True, slots=True, eq=False)
class Gaps(Sequence[Gap]):
    """All gaps of one image, kept as arrays.

    polygons: (N_g,) of (Multi)Polygon. labels: (height - 1, width), 0 for no gap, else index + 1.
    """

    grid: PolarGrid
    polygons: NDArray[np.object_]
    labels: NDArray[np.int32]

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


def find_contours(grid: PolarGrid, image: Mask) -> Gaps:
    """Border following (Suzuki & Abe) on the filtered image; gaps in raster order, so near ones first.

    A polygon runs along the edges of its cells, not through their centres: those would make every gap
    one cell too small. In an image repeated 2 x 2, the cell corner beside a border pixel is
    (pixel + 1) // 2. Cells that touch at a corner only are one region, and a MultiPolygon.
    """
    doubled = np.repeat(np.repeat(image.cells.astype(np.uint8), 2, axis=0), 2, axis=1)
    contours, hierarchy = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return Gaps(grid, np.empty(0, dtype=object), np.zeros(image.cells.shape, dtype=np.int32))
    sizes = np.array([len(contour) for contour in contours])
    pixels = np.concatenate(contours).reshape(-1, 2).astype(np.intp)
    starts = np.cumsum(sizes) - sizes
    rings = _corner_rings(grid, pixels, np.repeat(np.arange(len(sizes)), sizes), starts)
    parent = np.asarray(hierarchy)[0, :, 3]
    outer = np.flatnonzero(parent < 0)
    first_cell = np.minimum.reduceat(pixels[:, 1] * doubled.shape[1] + pixels[:, 0], starts)
    order = outer[np.argsort(first_cell[outer])]
    return Gaps(grid, _with_holes(rings, parent, order), _labels(image, pixels[starts[order]] // 2))


def _corner_rings(
    grid: PolarGrid, pixels: NDArray[np.intp], ring: NDArray[np.intp], starts: NDArray[np.intp]
) -> NDArray[np.object_]:
    """One closed ring of cell corners per contour."""
    corner = (pixels + 1) // 2
    before = np.roll(corner, 1, axis=0)
    before[starts] = corner[np.append(starts[1:], len(corner)) - 1]
    kept = (corner != before).any(axis=1)
    places = corners(grid)[corner[kept, 1], corner[kept, 0]]
    return np.asarray(shapely.linearrings(places, indices=ring[kept]), dtype=object)


def _with_holes(
    rings: NDArray[np.object_], parent: NDArray[Any], order: NDArray[np.intp]
) -> NDArray[np.object_]:
    """The polygons of the outer rings in this order, each with its holes; always valid."""
    place = np.full(len(rings), -1)
    place[order] = np.arange(len(order))
    polygons = np.asarray(shapely.polygons(rings[order]), dtype=object)
    holes = np.flatnonzero(parent >= 0)
    owner = place[parent[holes]]
    for index in np.unique(owner):
        polygons[index] = shapely.polygons(rings[order[index]], holes=rings[holes[owner == index]])
    broken = ~shapely.is_valid(polygons)
    polygons[broken] = shapely.make_valid(polygons[broken], method="structure", keep_collapsed=False)
    return polygons


def _labels(image: Mask, seeds: NDArray[np.intp]) -> NDArray[np.int32]:
    """Number the regions as the gaps are: the cell at seed i (column, row) belongs to gap i."""
    count, components = cv2.connectedComponents(image.cells.astype(np.uint8), connectivity=8)
    number = np.zeros(count, dtype=np.int32)
    number[components[seeds[:, 1], seeds[:, 0]]] = np.arange(1, len(seeds) + 1)
    labels: NDArray[np.int32] = number[components]
    return labels
