"""A figure over two parameters, its values written into the cells."""

from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from gapeval.report.curves.style import INK, RULE, SOFT

WRITTEN = 12  # columns, at most, of cells that a value can be read in
LIGHT = 0.5  # of a cell's colour, from which on words in it are dark
MAP = "cividis"  # the same to all kinds of colour vision, brighter is more


@dataclass(frozen=True, slots=True)
class Heat:
    """values: by row (y) and column (x), None where nothing is known. scale: values of the darkest and the
    brightest colour. mark: column and row of the cell to point out."""

    title: str
    x_label: str
    y_label: str
    x: tuple[str, ...]
    y: tuple[str, ...]
    values: tuple[tuple[float | None, ...], ...]
    scale: tuple[float, float]
    mark: tuple[int, int]
    alt: str
    width: float = 270.0
    height: float = 200.0


def draw_heat(axes: Axes, heat: Heat) -> None:
    low, high = heat.scale
    colours = matplotlib.colormaps[MAP]
    for row, values in enumerate(heat.values):
        for column, value in enumerate(values):
            corner = (column - 0.5, row - 0.5)
            if value is None:
                axes.add_patch(Rectangle(corner, 1, 1, fc="none", ec=RULE, lw=0.6))
                _write(axes, column, row, "–", SOFT, heat)  # noqa: RUF001
                continue
            red, green, blue, _ = colours((value - low) / ((high - low) or 1.0))
            axes.add_patch(Rectangle(corner, 1, 1, fc=to_hex((red, green, blue)), ec="none"))
            bright = 0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2
            # Black and white are equally far from a brightness of 0.18.
            _write(axes, column, row, f"{value:.2f}", "#000000" if bright > 0.18 else "#ffffff", heat)
    column, row = heat.mark
    axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fc="none", ec="#ffffff", lw=3.4, zorder=4))
    axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fc="none", ec=INK, lw=1.8, zorder=5))
    axes.set_xlim(-0.5, len(heat.x) - 0.5)
    axes.set_ylim(-0.5, len(heat.y) - 0.5)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.tick_params(length=0)
    axes.set_xlabel(heat.x_label)
    axes.set_ylabel(heat.y_label)
    every = -(-len(heat.x) // WRITTEN)
    axes.set_xticks(range(0, len(heat.x), every), list(heat.x[::every]))
    axes.set_yticks(np.arange(len(heat.y)), list(heat.y))


def _write(axes: Axes, column: int, row: int, text: str, colour: str, heat: Heat) -> None:
    if len(heat.x) <= WRITTEN:
        cell = (heat.width - 45) / len(heat.x), (heat.height - 50) / len(heat.y)
        size = min(10.0, 0.36 * cell[0], 0.62 * cell[1])  # four signs
        axes.text(column, row, text, ha="center", va="center", fontsize=max(size, 5.0), color=colour)
