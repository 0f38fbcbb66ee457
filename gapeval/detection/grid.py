"""The polar grid of Eqs. (2)-(5): which cell a point falls in, and where a cell lies on the ground."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray

CACHED_GRIDS = 64  # most sweeps have fewer resolutions than that
FAR = 1e9  # m; with extreme delta_r the rows beyond the box go on for ever


@dataclass(frozen=True, slots=True)
class PolarGrid:
    """I_height x I_width cells over the half disk in front of an origin; rows grow by delta_r.

    origin: (x, y) of the grid's pole, robot frame [m].
    height, width: the paper's I_height, I_width. The row that Eq. (3) reaches only at r = R (row
        height - 1) lies outside the box, so the image has height - 1 rows.
    log_r_d: logarithm of Eq. (5); r_d itself underflows for large heights and delta_r.
    """

    origin: tuple[float, float]
    height: int
    width: int
    delta_r: float
    r_max: float
    log_r_d: float

    @property
    def rows(self) -> int:
        return self.height - 1

    @property
    def theta_int(self) -> float:
        """Step between columns [rad]: pi / I_width."""
        return float(np.pi / self.width)


def polar_grid(
    height: int, width: int, delta_r: float, r_max: float, origin: tuple[float, float]
) -> PolarGrid:
    """Eq. (5), formed in logarithms: log r_d = log R - log(delta_r**(I_height - 1) - 1)."""
    exponent = (height - 1) * np.log(delta_r)
    log_r_d = np.log(r_max) - (exponent + np.log1p(-np.exp(-exponent)))
    return PolarGrid(origin, height, width, delta_r, r_max, float(log_r_d))


def cells(grid: PolarGrid, x: FloatArray, y: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Eqs. (2)-(4): row l and column k of points relative to the grid's origin [m], each (N,).

    Rows go on outside the box. Columns go on around the full circle: 0 ... width - 1 lie in front,
    width ... 2 width - 1 behind.
    """
    r, theta = polar(x, y)
    return rows_of(grid, r, 2**31), columns_of(grid, theta)


def polar(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eq. (2): radius [m] and azimuth from the right-hand side, 0 ... 2 pi [rad]."""
    theta: FloatArray = np.arctan2(y, x)
    theta += np.pi / 2
    np.add(theta, 2 * np.pi, out=theta, where=theta < 0)
    return np.sqrt(x * x + y * y), theta


def rows_of(grid: PolarGrid, r: FloatArray, most: int) -> IndexArray:
    """Eq. (3), at most `most`."""
    with np.errstate(divide="ignore"):  # r = 0 where r_d underflows to 0
        growth = np.log(r + np.exp(grid.log_r_d))
    growth -= grid.log_r_d
    growth /= np.log(grid.delta_r)
    rows: IndexArray = np.clip(growth, 0, most, out=growth).astype(np.intp)
    return rows


def columns_of(grid: PolarGrid, theta: FloatArray) -> IndexArray:
    """Eq. (4), around the full circle."""
    columns: IndexArray = (theta / grid.theta_int).astype(np.intp)
    columns[columns >= 2 * grid.width] = 0  # by rounding
    return columns


def row_edges(grid: PolarGrid, rows: int) -> FloatArray:
    """Radii [m] of the first `rows` rows' edges, (rows + 1,): Eq. (3) inverted, r_d (delta_r**l - 1)."""
    growth = np.arange(1, rows + 1) * np.log(grid.delta_r)
    radii = np.exp(grid.log_r_d + growth + np.log1p(-np.exp(-growth)))
    return np.concatenate([[0.0], radii])


def column_edges(grid: PolarGrid) -> FloatArray:
    """Azimuths [rad] of the edges of the columns in front, (width + 1,), from -pi/2 to pi/2."""
    return np.linspace(-np.pi / 2, np.pi / 2, grid.width + 1)


@lru_cache(maxsize=CACHED_GRIDS)
def corners(grid: PolarGrid) -> FloatArray:
    """Corners of the cells in the box, robot frame [m], (height, width + 1, 2); read only."""
    return _places(grid, row_edges(grid, grid.rows), column_edges(grid))


@lru_cache(maxsize=CACHED_GRIDS)
def midpoints(grid: PolarGrid) -> FloatArray:
    """Midpoints (in r and theta) of the box's cells, robot frame [m], (height - 1, width, 2), read only."""
    r, theta = row_edges(grid, grid.rows), column_edges(grid)
    return _places(grid, (r[:-1] + r[1:]) / 2, (theta[:-1] + theta[1:]) / 2)


def cell_polygons(grid: PolarGrid, row: IndexArray, column: IndexArray) -> NDArray[np.object_]:
    """One quadrilateral for each of these cells (N,)."""
    places = corners(grid)
    ring = [
        places[row, column],
        places[row + 1, column],
        places[row + 1, column + 1],
        places[row, column + 1],
    ]
    return np.asarray(shapely.polygons(np.stack(ring, axis=1)), dtype=object)


def _places(grid: PolarGrid, r: FloatArray, theta: FloatArray) -> FloatArray:
    direction = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    places: FloatArray = np.asarray(grid.origin) + r[:, None, None] * direction[None, :, :]
    places.flags.writeable = False  # it is shared
    return places
