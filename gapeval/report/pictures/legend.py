"""The legend of the picture from above."""

from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.legend_handler import HandlerPatch
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Patch

from gapeval.report.pictures.colours import (
    ABOVE,
    BELOW,
    BOX,
    FILLS,
    GAP_EDGE,
    GRID,
    LABEL_EDGE,
    NO,
    ON_PLANE,
    ROBOT,
    SENSOR,
    YES,
)
from gapeval.report.pictures.crossings import BEYOND
from gapeval.report.pictures.found import CELL_NAMES, Findings


def draw_legend(figure: Figure, axes: Axes, found: Findings) -> None:
    """What the colours mean: four columns of four."""
    columns: list[list[Artist]] = [
        [
            _dot(ON_PLANE, "point on the plane"),
            _dot(ABOVE, "point above it: obstacle"),
            _dot(BELOW, "point below it"),
        ],
        [Patch(fc=fill, ec=GRID, lw=0.5, label=f"cell: {CELL_NAMES[kind]}") for kind, fill in FILLS.items()],
        [
            Patch(fc="#cadbff", ec=GAP_EDGE, lw=1.1, label="gap, with its number"),
            _arrow(YES, "crossing by npca: traversable"),
            _arrow(NO, "not traversable, and why"),
        ],
        [
            Patch(fc="white", ec=ROBOT, lw=1.3, label="robot"),
            Line2D([], [], marker="o", ls="", ms=6, mfc=SENSOR, mec=ROBOT, mew=1.1, label="sensor"),
            Line2D([], [], color=BOX, lw=1.1, label="r_max"),
            Line2D([], [], color=BOX, lw=1.1, ls=(0, (5, 3)), label="x_min"),
        ],
    ]
    if any(not axes.viewLim.contains(y, x) for c in found.crossings for x, y, *_ in (c.start, c.end)):
        columns[1].append(
            Line2D([], [], color=NO, lw=1.6, ls=BEYOND, label="crossing goes on behind the border")
        )
    kinds = {placed.label.kind for placed in found.labels or ()}
    if found.labels is not None:
        columns[2].append(_outline("-", "label" if kinds else "label (none holds here)"))
    if "ignore" in kinds:
        columns[0].append(_outline((0, (2, 1.5)), "label to ignore"))
    blank = Patch(fc="none", ec="none", label=" ")
    figure.legend(
        handles=[handle for column in columns for handle in (*column, *[blank] * (4 - len(column)))],
        loc="lower center",
        ncols=4,
        frameon=False,
        fontsize=8.5,
        columnspacing=2.2,
        handler_map={FancyArrowPatch: HandlerPatch(patch_func=_arrow_in_legend)},
    )


def _dot(colour: str, label: str) -> Artist:
    return Line2D([], [], marker="o", ls="", ms=4, mew=0, color=colour, label=label)


def _outline(style: Any, label: str) -> Artist:
    return Patch(fc="none", ec=LABEL_EDGE, lw=1.8, ls=style, label=label)


def _arrow(colour: str, label: str) -> Artist:
    return FancyArrowPatch((0, 0), (1, 0), arrowstyle="-|>", color=colour, lw=1.6, label=label)


def _arrow_in_legend(
    legend: Legend,
    orig_handle: Any,
    *,
    xdescent: float,
    ydescent: float,
    width: float,
    height: float,
    **_: Any,
) -> Patch:
    """A crossing as the legend shows it."""
    middle = (height - ydescent) / 2
    return FancyArrowPatch(
        (-xdescent, middle), (width - xdescent, middle), arrowstyle="-|>", mutation_scale=9
    )
