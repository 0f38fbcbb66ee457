"""Crossings from above: arrows from START to END, and the words at them."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch
from matplotlib.transforms import Bbox

from gapeval.detections import Crossing
from gapeval.frame import FloatArray
from gapeval.report.pictures.colours import GAP_EDGE, NO, YES
from gapeval.report.pictures.found import Findings
from gapeval.report.pictures.words import CROWD, Word, write, write_always

WORDED = 6  # gaps, at most, at which START and END are written
BEYOND = (0, (4, 2))  # dashes of an arrow that goes on behind the border


def draw_crossings(axes: Axes, found: Findings, robot: Bbox) -> None:
    """An arrow for each gap, and the words that fit; dashed to the border where it goes on behind it.

    Words are written at large gaps first, and only where they lie over no other word, the robot [pixels] or
    an arrow of the CROWD largest: first numbers, with the reason against crossing, at no more than CROWD
    gaps; then START and END (where they lie in the picture) at no more than WORDED, and there both or none.
    Of no more than CROWD gaps each has its number, be it over something else.
    """
    order = np.argsort(-shapely.area(found.detection.gaps.polygons), kind="stable").tolist()
    crossings = [found.crossings[index] for index in order]
    all_numbered = len(crossings) <= CROWD
    taken = [robot, *_along_arrows(axes, crossings[:CROWD])]
    thin = {"lw": 0.9, "alpha": 1.0} if len(crossings) <= CROWD else {"lw": 0.5, "alpha": 0.5}
    for crossing in crossings[:CROWD]:
        with_reason, alone = _number(crossing), _number(crossing, reason=False)
        if not write(axes, taken, [with_reason]) and not write(axes, taken, [alone]) and all_numbered:
            write_always(axes, taken, alone)
    worded = 0
    for rank, crossing in enumerate(crossings):
        colour = YES if crossing.traversable else NO
        words = rank < CROWD and worded < WORDED and write(axes, taken, _poses(axes, crossing, colour))
        worded += words
        line: dict[str, Any] = {"lw": 1.6, "alpha": 1.0} if words else thin
        line |= {"color": colour, "zorder": 8.5 if words else 8.0}
        start, end = crossing.start[1::-1], crossing.end[1::-1]
        first, last = inside(axes, start, end)
        whole = axes.viewLim.contains(*start) and axes.viewLim.contains(*end)
        ends_here = axes.viewLim.contains(*end)
        line["ls"] = "-" if whole else BEYOND
        head = "-|>" if ends_here else "-"
        arrow = FancyArrowPatch(first, last, arrowstyle=head, shrinkA=0, shrinkB=0, **line)
        arrow.set_mutation_scale(11 if words else 7)
        arrow.set_gid(f"crossing {crossing.gap}")
        axes.add_patch(arrow)
        axes.plot(*start, "o", ms=4 if words else 2.2, mew=0, **line)


def inside(axes: Axes, start: Sequence[float], end: Sequence[float]) -> tuple[Any, Any]:
    """The ends of what is in the picture of a line; of one that is nowhere in it, its own."""
    view = shapely.box(*axes.viewLim.extents)
    line = shapely.LineString([start, end])
    places = shapely.get_coordinates(shapely.intersection(line, view))
    if len(places) < 2:
        places = shapely.get_coordinates(line)
    along = np.argsort([line.project(shapely.Point(place)) for place in places], kind="stable")
    return places[along[0]], places[along[-1]]


def _along_arrows(axes: Axes, crossings: Iterable[Crossing]) -> list[Bbox]:
    """Small boxes along all arrows [pixels]: no word may lie there."""
    boxes = []
    for crossing in crossings:
        ends = axes.transData.transform([crossing.start[1::-1], crossing.end[1::-1]])
        steps = 2 + int(np.hypot(*(ends[1] - ends[0])) / 8)
        boxes += [Bbox([spot - 2, spot + 2]) for spot in np.linspace(ends[0], ends[1], min(steps, 500))]
    return boxes


def _number(crossing: Crossing, reason: bool = True) -> Word:
    """The gap's number beside the middle of its arrow, and why it may not be crossed."""
    ahead, aside = _ways(crossing)
    style = {"fontsize": 9, "fontweight": "bold", "color": GAP_EDGE}
    text = f"{crossing.gap} {crossing.reason if reason else ''}".rstrip()
    slanted = [(one + other) / 2**0.5 for one in (ahead, -ahead) for other in (aside, -aside)]
    return Word(text, crossing.centre[1::-1], (aside, -aside, ahead, -ahead, *slanted), style)


def _poses(axes: Axes, crossing: Crossing, colour: str) -> list[Word]:
    """START behind the arrow and END ahead of it, where they lie in the picture."""
    ahead, aside = _ways(crossing)
    style = {"fontsize": 8, "color": colour}
    return [
        Word(
            text,
            at[1::-1],
            (way, aside, -aside, (aside - way) / 2**0.5, (-aside - way) / 2**0.5),
            style | {"fontweight": "bold"},
        )
        for text, at, way in (("START", crossing.start, -ahead), ("END", crossing.end, ahead))
        if axes.viewLim.contains(at[1], at[0])
    ]


def _ways(crossing: Crossing) -> tuple[FloatArray, FloatArray]:
    """Unit vectors on the paper: along the arrow, and to the left of it."""
    ahead = np.array([-np.sin(crossing.yaw), np.cos(crossing.yaw)])
    return ahead, np.array([-ahead[1], ahead[0]])
