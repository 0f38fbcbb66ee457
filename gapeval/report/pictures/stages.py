"""The stages of the polar image. Rows go upwards, as r does; columns are turned, so that left is left."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from gapeval.detection import Gaps, PolarGrid
from gapeval.detection.grid import row_edges
from gapeval.frame import FloatArray
from gapeval.report.pictures.colours import CONTOUR, STAGES, gap_colours
from gapeval.report.pictures.figure import own_style, titled_figure
from gapeval.report.pictures.found import CELL_NAMES, Findings, binary_cells, opened_cells
from gapeval.report.pictures.words import AROUND, CROWD, Word, write, write_always

PADDING = 3  # rows shown below the first that is seen


@own_style()
def draw_stages(found: Findings) -> Figure:
    """The paper's Fig. 4: the binary image, the image after erosion and dilation, and the contours in it."""
    surface, gaps = found.detection.surface, found.detection.gaps
    n_o = found.configuration.detector.n_o
    times = "1 erosion and 1 dilation" if n_o == 1 else f"{n_o} erosions and {n_o} dilations"
    figure = titled_figure(found, 14.0, 6.0)
    known = np.flatnonzero(surface.seen.cells.any(axis=1))
    first = max(0, int(known[0]) - PADDING) if len(known) else 0  # near the pole there is nothing to see
    stages: tuple[tuple[str, str, NDArray[Any], Sequence[Any]], ...] = (
        ("binary", "1  binary image (Algorithm 1)", binary_cells(surface), STAGES),
        ("opened", f"2  filtered image: {times}", opened_cells(surface), STAGES),
        (
            "contours",
            f"3  detected contours: {len(gaps)} gap{'' if len(gaps) == 1 else 's'}",
            gaps.labels,
            ("#ffffff", *gap_colours(len(gaps))),
        ),
    )
    for number, (name, title, codes, colours) in enumerate(stages):
        axes = figure.add_axes((0.05 + 0.325 * number, 0.19, 0.28, 0.64))
        axes.set_gid(name)
        axes.set_title(title, fontsize=10, pad=7)
        _show(axes, codes, colours)
        _polar_ticks(axes, surface.grid, first)
    figure.axes[0].set_ylabel("r [m] from the pole of the grid", fontsize=9)
    _draw_contours(figure.axes[2], gaps)
    handles = [
        Patch(fc=colour, ec="#8d949e", lw=0.5, label=name)
        for colour, name in zip(STAGES, CELL_NAMES, strict=True)
    ]
    figure.legend(handles=handles, loc="lower center", ncols=6, frameon=False, fontsize=9)
    return figure


def _show(axes: Axes, codes: NDArray[Any], colours: Sequence[Any]) -> None:
    """An image of whole numbers, one colour for each number."""
    rows, columns = codes.shape
    axes.imshow(
        codes,
        cmap=ListedColormap(list(colours)),
        norm=BoundaryNorm(np.arange(len(colours) + 1) - 0.5, len(colours)),
        origin="lower",
        extent=(0, columns, 0, rows),
        aspect="auto",
        interpolation="nearest",
        interpolation_stage="rgba",
    )
    axes.set_xlim(columns, 0)
    axes.set_ylim(0, rows)


def _polar_ticks(axes: Axes, grid: PolarGrid, first: int) -> None:
    """Round metres along the rows from the first that is shown, degrees along the columns."""
    axes.set_ylim(first, grid.rows)
    edges = row_edges(grid, grid.rows)
    evenly = np.interp(np.linspace(first, grid.rows, 9), np.arange(grid.rows + 1), edges)
    step = 10.0 ** np.floor(np.log10(grid.r_max / 4))
    radii = np.unique(np.append(np.round(evenly[:-1] / step) * step, edges[-1]))
    radii = radii[radii >= edges[first] - step / 2]
    axes.set_yticks(np.interp(radii, edges, np.arange(grid.rows + 1)), [f"{radius:g}" for radius in radii])
    degrees = (-90, -45, 0, 45, 90)
    axes.set_xticks(
        [(angle + 90) / 180 * grid.width for angle in degrees],
        [f"{angle}°".replace("-", "\N{MINUS SIGN}") for angle in degrees],
    )
    axes.set_xlabel("theta, to the left positive", fontsize=9)
    axes.tick_params(labelsize=8.5)


def _draw_contours(axes: Axes, gaps: Gaps) -> None:
    """The edges between each gap's cells and all others, and their numbers; of a crowd, those that fit."""
    axes.add_collection(
        LineCollection(
            list(contour_lines(gaps.labels)),
            colors=CONTOUR,
            linewidths=0.9 if len(gaps) <= CROWD else 0.4,
            gid="contour lines",
        )
    )
    taken: list[Bbox] = []
    size = np.bincount(gaps.labels.ravel(), minlength=len(gaps) + 1)[1:]
    style = {"fontsize": 9, "fontweight": "bold", "color": CONTOUR}
    for index in np.argsort(-size, kind="stable")[:CROWD].tolist():
        places = np.argwhere(gaps.labels == index + 1) + 0.5
        nearest = np.argmin(((places - places.mean(axis=0)) ** 2).sum(axis=1))
        word = Word(str(index), places[nearest, ::-1].tolist(), AROUND, style)
        if len(gaps) <= CROWD:
            write_always(axes, taken, word)
        else:
            write(axes, taken, [word])


def contour_lines(labels: NDArray[np.int32]) -> FloatArray:
    """Edges (M, 2, 2) between cells of different gaps, or of a gap and none; column, row of their ends."""
    padded = np.pad(labels, 1)
    row, column = np.nonzero((padded[:-1] != padded[1:])[:, 1:-1])
    row_, column_ = np.nonzero((padded[:, :-1] != padded[:, 1:])[1:-1])
    along = np.stack([np.column_stack([column, row]), np.column_stack([column + 1, row])], axis=1)
    across = np.stack([np.column_stack([column_, row_]), np.column_stack([column_, row_ + 1])], axis=1)
    return np.concatenate([along, across]).astype(np.float64)
