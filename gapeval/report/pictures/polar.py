"""The polar grid from above: its cells, some of its lines, the ends of the box. Artists get (y, x) [m]."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb

from gapeval.detection import PolarGrid, Surface
from gapeval.detection.grid import cells, column_edges, row_edges
from gapeval.frame import FloatArray
from gapeval.report.pictures.colours import BOX, FILLS, GRID
from gapeval.report.pictures.found import GROUND, opened_cells

RAYS, ARCS = 24, 16  # lines of the polar grid that are shown, at most


def draw_cells(axes: Axes, surface: Surface) -> None:
    """Fill each pixel by the kind of the cell that it lies in, Eqs. (2)-(4); gaps are drawn as polygons."""
    grid = surface.grid
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    width, height = (round(length) for length in axes.bbox.size)
    y = left + (np.arange(width) + 0.5) / width * (right - left)
    x = low + (np.arange(height) + 0.5) / height * (high - low)
    ys, xs = np.meshgrid(y - grid.origin[1], x - grid.origin[0])
    row, column = cells(grid, xs, ys)
    inside = (row < grid.rows) & (column < grid.width)
    kinds = np.full(row.shape, GROUND, dtype=np.uint8)
    kinds[inside] = opened_cells(surface)[row[inside], column[inside]]
    pixels = np.ones((height, width, 3))
    for kind, colour in FILLS.items():
        pixels[kinds == kind] = to_rgb(colour)
    axes.imshow(
        pixels,
        extent=(left, right, low, high),
        origin="lower",
        interpolation="nearest",
        zorder=0,
        gid="cells",
    )


def draw_grid(axes: Axes, grid: PolarGrid) -> None:
    """Some of the grid's lines: rows at least r_max / ARCS apart, at most RAYS columns."""
    theta, radii = column_edges(grid), row_edges(grid, grid.rows)
    shown = [0.0]
    for radius in radii.tolist():
        if radius - shown[-1] >= grid.r_max / ARCS:
            shown.append(radius)
    around = np.linspace(-np.pi / 2, np.pi / 2, 181)
    rays = theta[:: -(-grid.width // RAYS)]
    lines = [_places(grid, np.full_like(around, radius), around) for radius in shown[1:]]
    lines += [_places(grid, np.array([shown[min(1, len(shown) - 1)], radii[-1]]), ray) for ray in rays]
    axes.add_collection(LineCollection(lines, colors=GRID, linewidths=0.4, alpha=0.7, zorder=1, gid="grid"))


def draw_box(axes: Axes, grid: PolarGrid, x_min: float) -> None:
    """The arc at r_max and the line at x_min [m]."""
    around = np.linspace(-np.pi / 2, np.pi / 2, 361)
    arc = _places(grid, np.full_like(around, grid.r_max), around)
    axes.plot(*arc.T, color=BOX, lw=1.1, zorder=3, gid="r_max")
    half = np.sqrt(max(grid.r_max**2 - (x_min - grid.origin[0]) ** 2, 0.0))
    ends = [grid.origin[1] + half, grid.origin[1] - half]
    axes.plot(ends, [x_min, x_min], color=BOX, lw=1.1, ls=(0, (5, 3)), zorder=3, gid="x_min")


def _places(grid: PolarGrid, r: FloatArray, theta: FloatArray) -> FloatArray:
    """(N, 2): y, x [m]."""
    return np.column_stack([grid.origin[1] + r * np.sin(theta), grid.origin[0] + r * np.cos(theta)])
