"""Configurations between two aims, the third by their markers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gapeval.frame import FloatArray
from gapeval.report.curves.callouts import call_out
from gapeval.report.curves.style import COLOURS, INK, MARKERS, RULE, SOFT


@dataclass(frozen=True, slots=True)
class Dot:
    """kind: which marker; None for one that others beat. name: words at it, or none."""

    x: float
    y: float
    kind: int | None
    name: str = ""


@dataclass(frozen=True, slots=True)
class Scatter:
    """kinds: how many kinds of dots. edge: places (x, y) along which the best lie. mark: one to point out."""

    title: str
    x_label: str
    y_label: str
    dots: tuple[Dot, ...]
    kinds: int
    edge: tuple[tuple[float, float], ...]
    mark: tuple[float, float]
    alt: str
    width: float = 460.0
    height: float = 320.0


def draw_scatter(axes: Axes, scatter: Scatter) -> None:
    axes.grid(color=RULE, lw=0.7)
    axes.set_xlabel(scatter.x_label)
    axes.set_ylabel(scatter.y_label)
    behind = sorted({(dot.x, dot.y) for dot in scatter.dots if dot.kind is None})
    if behind:
        axes.plot(*zip(*behind, strict=True), ls="", marker=".", ms=5, mew=0, color=SOFT, alpha=0.5)
    if scatter.edge:
        axes.plot(*zip(*scatter.edge, strict=True), color=SOFT, lw=1.0, drawstyle="steps-post", zorder=2.5)
    sizes = (7.0, 7.5, 8.5)
    for kind in reversed(range(scatter.kinds)):  # the quickest above
        places = [(dot.x, dot.y) for dot in scatter.dots if dot.kind == kind]
        if places:
            style: dict[str, Any] = {"marker": MARKERS[kind], "ms": sizes[kind % 3], "color": COLOURS[kind]}
            axes.plot(*zip(*places, strict=True), ls="", mew=0, zorder=4, alpha=0.9, **style)
    x, y = scatter.mark
    axes.plot([x], [y], ls="", marker="o", ms=15, mfc="none", mec=INK, mew=1.8, zorder=6)
    _scale(axes, max(dot.x for dot in scatter.dots))
    named = [dot for dot in scatter.dots if dot.name]
    if named:
        call_out(
            axes,
            [(dot.x, dot.y) for dot in named],
            [dot.name for dot in named],
            [*behind, *_along(scatter.edge)],
        )


def _scale(axes: Axes, most: float) -> None:
    """By its root, so that zero has a place, few are told apart, and very many fit too."""
    axes.set_ylim(-0.03, 1.09)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0", "0.25", "0.5", "0.75", "1"])
    axes.set_xscale("function", functions=(_root, _square))
    axes.set_xlim(-0.0006 * most, 1.06 * most or 1.0)
    power = 10.0 ** math.floor(math.log10(most or 1.0))
    ticks = [0.0, *(power * part for part in (0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 4, 6, 8))]
    shown = [tick for tick in ticks if tick <= 1.06 * most or tick == 0]
    axes.set_xticks(shown, [f"{tick:g}" for tick in shown])


def _along(edge: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Places along its steps."""
    corners = [corner for (x, y), (next_x, _) in pairwise(edge) for corner in ((x, y), (next_x, y))]
    steps = np.linspace(0, 1, 20)[:, None]
    found: list[tuple[float, float]] = []
    for one, other in pairwise([*corners, *edge[-1:]]):
        found += map(tuple, (np.array(one) + steps * (np.array(other) - np.array(one))).tolist())
    return found


def _root(x: FloatArray) -> FloatArray:
    return np.sign(x) * np.sqrt(np.abs(x))


def _square(x: FloatArray) -> FloatArray:
    return np.sign(x) * np.square(x)
