"""Lines over a parameter or a condition, with their intervals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from gapeval.frame import FloatArray
from gapeval.report.curves.style import RULE, Look

LONG = 9  # letters that fit under a tick where there are few
TICKS = 16  # different numbers, from which on round ones are under the axis
NEAREST = 0.11  # of the axis, at least, from one to the next
LETTER, BETWEEN = 0.029, 0.03  # of the axis: a letter under it, and what is free between two numbers


@dataclass(frozen=True, slots=True)
class Point:
    """x: a number, or a category's place in Panel.categories. low, high: of its interval, if it has one."""

    x: float
    y: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class Line:
    """points: in the order of x, those that are defined."""

    name: str
    points: tuple[Point, ...]
    look: Look


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes.

    categories: what stands under the axis, evenly spaced, instead of numbers. joined: draw lines from point
    to point, and bands; else points with bars. share: y is from 0 to 1. mark: an x to point out.
    """

    title: str
    x_label: str
    lines: tuple[Line, ...]
    alt: str
    categories: tuple[str, ...] | None = None
    joined: bool = True
    log_x: bool = False
    share: bool = False
    mark: float | None = None
    width: float = 270.0
    height: float = 190.0


def draw_panel(axes: Axes, panel: Panel) -> None:
    axes.grid(axis="y", color=RULE, lw=0.7)
    axes.set_title(panel.title, fontsize=10.5, fontweight="bold", loc="left", pad=7)
    axes.set_xlabel(panel.x_label)
    count = len(panel.lines)
    for index, line in enumerate(panel.lines):
        # Side by side where they would lie over each other.
        aside = 0.0 if panel.joined or panel.categories is None else 0.5 * ((index + 0.5) / count - 0.5)
        _draw_line(axes, line, panel.joined, aside)
    if panel.mark is not None:
        axes.axvline(panel.mark, color=RULE, lw=7, zorder=0.5, alpha=0.55)
    _scale(axes, panel)


def _draw_line(axes: Axes, line: Line, joined: bool, aside: float) -> None:
    x, y = [point.x + aside for point in line.points], [point.y for point in line.points]
    artist = line.look.artist() | ({} if joined else {"ls": ""})
    axes.plot(x, y, **artist)
    known = [point for point in line.points if point.low is not None and point.high is not None]
    if not known or line.look.faint:
        return
    x = [point.x + aside for point in known]
    low, high = [point.low or 0.0 for point in known], [point.high or 0.0 for point in known]
    if joined:
        axes.fill_between(x, low, high, color=line.look.colour, alpha=0.16, lw=0, zorder=2)
        for edge in (low, high):
            axes.plot(x, edge, color=line.look.colour, lw=0.5, alpha=0.6, zorder=2)
    else:
        axes.vlines(x, low, high, color=line.look.colour, lw=1.2, zorder=2)
        for edge in (low, high):
            axes.plot(x, edge, ls="", marker="_", ms=7, mew=1.2, color=line.look.colour, zorder=2)


def _scale(axes: Axes, panel: Panel) -> None:
    values = [
        value
        for line in panel.lines
        for point in line.points
        for value in (point.y, point.low, point.high)
        if value is not None
    ]
    if panel.share:
        axes.set_ylim(-0.03, 1.05)
        axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0", "0.25", "0.5", "0.75", "1"])
    elif values and min(values) >= 0:
        top = 1.08 * max(values) or 1.0
        axes.set_ylim(-0.035 * top, top)  # so that a marker at zero is whole
        axes.yaxis.set_major_locator(MaxNLocator(5))
    if panel.categories is not None:
        _name_categories(axes, panel.categories)
    else:
        _number_axis(axes, panel)


def _number_axis(axes: Axes, panel: Panel) -> None:
    """The numbers that there are, where there is room for them; else round ones."""
    if panel.log_x:
        axes.set_xscale("log")
    there = np.unique([point.x for line in panel.lines for point in line.points])
    if len(there) <= TICKS:
        axes.xaxis.set_major_locator(FixedLocator(apart(np.log(there) if panel.log_x else there, there)))
    else:
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)) if panel.log_x else MaxNLocator(6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}".replace("-", "\N{MINUS SIGN}")))


def apart(places: FloatArray, values: FloatArray) -> list[float]:
    """Of values, which rise, those whose places are far enough from each other to be named."""
    kept: list[int] = []
    wide = [LETTER * len(f"{value:g}") for value in values.tolist()]
    for index in range(len(places)):
        room = max(NEAREST, BETWEEN + (wide[kept[-1]] + wide[index]) / 2) if kept else 0.0
        if not kept or places[index] - places[kept[-1]] >= room * (places[-1] - places[0]):
            kept.append(index)
    return [float(values[index]) for index in kept]


def _name_categories(axes: Axes, names: Sequence[str]) -> None:
    """Under the axis, slanted where they are long; of very many, every second or third."""
    every = math.ceil(len(names) / 12)
    shown = range(0, len(names), every)
    axes.set_xlim(-0.5, len(names) - 0.5)
    slanted = max(map(len, names)) * len(shown) > 4.5 * LONG
    axes.set_xticks(
        list(shown),
        [names[index] for index in shown],
        rotation=30 if slanted else 0,
        ha="right" if slanted else "center",
        rotation_mode="anchor",
    )
