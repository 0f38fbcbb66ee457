"""Numbers beside crowded places, each with a line to its own, so that it can be taken for no other's."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gapeval.frame import FloatArray
from gapeval.report.curves.style import INK, SOFT

SIZE = 8.5  # points, of letters
LETTER, LINE = 0.68 * SIZE, 1.3 * SIZE  # points, that a letter takes
AWAY = (8.0, 16.0, 26.0, 38.0, 52.0, 68.0, 86.0)  # points, from a place to the words
WAYS = 16
CLEAR = 7.0  # points around a place, that are its marker's


Place = tuple[float, float]


def call_out(axes: Axes, places: Sequence[Place], words: Sequence[str], behind: Sequence[Place]) -> None:
    """Write words beside places, as the axes have them; all of them, the longest first.

    behind: over which they should not lie either, if there is a choice.
    """
    soft = axes.transData.transform(np.array(behind, dtype=np.float64).reshape(-1, 2))
    soft = soft * 72 / axes.figure.dpi
    points = axes.transData.transform(np.array(places, dtype=np.float64)) * 72 / axes.figure.dpi
    view = np.reshape(axes.bbox.extents, (2, 2)) * 72 / axes.figure.dpi
    boxes: list[FloatArray] = []
    lines: list[FloatArray] = []
    style: dict[str, Any] = {"arrowstyle": "-", "color": SOFT, "lw": 0.8, "shrinkA": 0, "shrinkB": 4}
    for index in sorted(range(len(words)), key=lambda one: -len(words[one])):
        others = np.delete(points, index, axis=0)
        middle, box = _spot(points[index], words[index], others, soft, view, boxes, lines)
        boxes.append(box)
        lines.append(_along(points[index], np.clip(points[index], box[0], box[1])))
        axes.annotate(
            words[index],
            places[index],
            tuple((middle - points[index]).tolist()),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=SIZE,
            color=INK,
            arrowprops=style,
            zorder=7,
            gid=f"callout {words[index]}",
        )


def _spot(
    place: FloatArray,
    word: str,
    others: FloatArray,
    soft: FloatArray,
    view: FloatArray,
    boxes: Sequence[FloatArray],
    lines: Sequence[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """The middle of a word and its box (2, 2) [points]: the nearest that touches nothing, else the least."""
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for middle, box in _spots(place, word):
        line = _along(place, np.clip(place, box[0], box[1]))
        touched = 10.0 * bool((box[0] < view[0]).any() or (box[1] > view[1]).any())
        touched += sum(bool((box[0] < two[1] + 2).all() and (two[0] - 2 < box[1]).all()) for two in boxes)
        touched += float((_distance(others, np.clip(others, box[0], box[1])) < CLEAR).sum())
        touched += float(
            (_distance(others[:, None], line[None]).min(axis=1, initial=np.inf) < CLEAR - 2).sum()
        )
        touched += sum(bool(_distance(line[:, None], other[None]).min() < 3) for other in lines)
        touched += sum(bool(((two[0] - 1 < line) & (line < two[1] + 1)).all(axis=1).any()) for two in boxes)
        touched += sum(
            bool(((box[0] - 1 < other) & (other < box[1] + 1)).all(axis=1).any()) for other in lines
        )
        over = float(((box[0] - 1 < soft) & (soft < box[1] + 1)).all(axis=1).sum())
        found.append((touched + 0.15 * min(over, 4.0) + 0.01 * float(_distance(place, middle)), middle, box))
    _, middle, box = min(found, key=lambda one: one[0])
    return middle, box


def _spots(place: FloatArray, word: str) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Middles and boxes of a word around its place, near ones first; to the upper right before others."""
    half = np.array([LETTER * len(word), LINE]) / 2
    for away in AWAY:
        for turn in range(WAYS):
            angle = np.pi / 4 + (1, -1)[turn % 2] * 2 * np.pi / WAYS * ((turn + 1) // 2)
            way = np.array([np.cos(angle), np.sin(angle)])
            middle = place + way * (away + 1 / np.max(np.abs(way) / half))
            yield middle, np.array([middle - half, middle + half])


def _along(start: FloatArray, end: FloatArray) -> FloatArray:
    """Places along a line, every two points or so; without its first, which are the marker's."""
    steps = 2 + int(_distance(start, end) / 2)
    return np.linspace(start, end, steps)[steps // 4 :]


def _distance(one: FloatArray, other: FloatArray) -> FloatArray:
    distance: FloatArray = np.hypot(*np.moveaxis(one - other, -1, 0))
    return distance
