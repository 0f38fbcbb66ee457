"""Words beside places, none of which lies over another."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from gapeval.frame import FloatArray
from gapeval.report.pictures.figure import DPI

CROWD = 30  # gaps, of which no more get a number, and from which on lines are thin
BESIDE = 6.0  # points, from a place to a word
AROUND = [np.zeros(2), *np.column_stack([f(np.arange(8) * np.pi / 4) for f in (np.cos, np.sin)])]


@dataclass(frozen=True, slots=True, eq=False)
class Word:
    """A word that is to be written.

    at: its place, as the axes have it. ways: where it may lie from there, best first; unit vectors on the
    paper, or zero. style: of its letters, as matplotlib names it.
    """

    text: str
    at: Sequence[float]
    ways: Sequence[FloatArray]
    style: dict[str, Any]


def write(axes: Axes, taken: list[Bbox], words: Iterable[Word]) -> bool:
    """All words, or none if one does not fit.

    taken: where no word may lie [pixels]; what is written is added.
    """
    fitted: list[tuple[Word, FloatArray, Bbox]] = []
    for word in words:
        fit = _fit(axes, [*taken, *(box for _, _, box in fitted)], word)
        if fit is None:
            return False
        fitted.append((word, *fit))
    for word, offset, box in fitted:
        _annotate(axes, word, offset)
        taken.append(box)
    return True


def write_always(axes: Axes, taken: list[Bbox], word: Word) -> None:
    """A word in the picture, even where no place is free: then over as little as can be."""
    if write(axes, taken, [word]):
        return
    size = _size(axes, word)
    at = axes.transData.transform(word.at)
    half = size / 2
    low, high = np.array(axes.bbox.min) + half + 1, np.array(axes.bbox.max) - half - 1
    spots = [np.clip(at + way * (np.abs(way) @ half + BESIDE * DPI / 72), low, high) for way in AROUND]
    boxes = [Bbox([spot - half, spot + half]) for spot in spots]
    best = min(boxes, key=lambda box: sum(_shared(box, other) for other in taken))
    middle = np.array(best.corners()).mean(axis=0)
    _annotate(axes, word, (middle - at) * 72 / DPI)
    taken.append(best)


def _shared(one: Bbox, other: Bbox) -> float:
    """The area in common [pixels]."""
    both = Bbox.intersection(one, other)
    return 0.0 if both is None else float(both.width * both.height)


def _annotate(axes: Axes, word: Word, offset: FloatArray) -> None:
    """offset: of its middle [points]."""
    axes.annotate(
        word.text,
        (word.at[0], word.at[1]),
        (offset[0], offset[1]),
        textcoords="offset points",
        ha="center",
        va="center",
        zorder=9,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
        **word.style,
    )


def _size(axes: Axes, word: Word) -> FloatArray:
    """Its width and height [pixels]."""
    probe = axes.text(0, 0, word.text, **word.style)
    size = np.array(probe.get_window_extent().size)
    probe.remove()
    return size


def _fit(axes: Axes, taken: Sequence[Bbox], word: Word) -> tuple[FloatArray, Bbox] | None:
    """The offset of its middle [points] and what it covers [pixels], where it is free and in the picture."""
    size = _size(axes, word)
    for way in word.ways:
        offset = way * (np.abs(way) @ size / 2 + BESIDE * DPI / 72)
        middle = axes.transData.transform(word.at) + offset
        box = Bbox([middle - size / 2, middle + size / 2])
        inside = axes.bbox.contains(*box.min) and axes.bbox.contains(*box.max)
        if inside and not any(box.overlaps(other) for other in taken):
            return offset * 72 / DPI, box
    return None
