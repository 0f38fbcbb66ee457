"""One frame from above. x of the robot frame is up and y to the left: artists get (y, x), y is turned."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon, Rectangle
from matplotlib.path import Path
from matplotlib.ticker import MultipleLocator
from shapely.geometry.base import BaseGeometry

from gapeval.report.pictures.colours import (
    ABOVE,
    BELOW,
    GAP_EDGE,
    GAP_FILL,
    LABEL_EDGE,
    ON_PLANE,
    ROBOT,
    SENSOR,
)
from gapeval.report.pictures.crossings import draw_crossings
from gapeval.report.pictures.figure import own_style, titled_figure
from gapeval.report.pictures.found import Findings, PointClasses, classify
from gapeval.report.pictures.legend import draw_legend
from gapeval.report.pictures.polar import draw_box, draw_cells, draw_grid
from gapeval.report.pictures.words import CROWD

WIDE, TALL = 10.0, 9.0  # inches, at most, of the ground that is shown


@own_style()
def draw_frame(found: Findings) -> Figure:
    """One frame from above, robot frame [m]: points, cells, labels, gaps and their crossings by npca."""
    figure, axes = _ground(found)
    surface = found.detection.surface
    draw_cells(axes, surface)
    draw_grid(axes, surface.grid)
    _draw_points(axes, classify(found.frame, found.detection, found.configuration))
    draw_box(axes, surface.grid, found.configuration.detector.x_min)
    _draw_outlines(axes, found)
    robot = _draw_robot(axes, found)
    draw_crossings(axes, found, robot.get_window_extent())
    draw_legend(figure, axes, found)
    return figure


def _ground(found: Findings) -> tuple[Figure, Axes]:
    """Axes of the box and the robot with a small margin, every metre equally long, and the figure around."""
    grid, robot = found.detection.surface.grid, found.configuration.robot
    x, y = grid.origin
    margin = 0.04 * grid.r_max
    behind = min(robot.length / 2, grid.r_max / 2)
    low = np.array([min(y - grid.r_max, -robot.width / 2), min(x, -behind)]) - margin
    high = np.array([max(y + grid.r_max, robot.width / 2), max(x + grid.r_max, behind)]) + margin
    span = high - low
    width, height = (span * min(WIDE / span[0], TALL / span[1])).tolist()
    left, right, bottom, top = 0.75, 0.3, 1.6, 0.85
    whole = max(width, WIDE) + left + right, height + bottom + top
    figure = titled_figure(found, *whole)
    first = left + (whole[0] - left - right - width) / 2
    axes = figure.add_axes((first / whole[0], bottom / whole[1], width / whole[0], height / whole[1]))
    axes.set_aspect("equal")
    axes.set_xlim(high[0], low[0])
    axes.set_ylim(low[1], high[1])
    axes.autoscale(False)
    axes.set_xlabel("y [m], to the left of the robot", fontsize=9)
    axes.set_ylabel("x [m], ahead of the robot", fontsize=9)
    axes.tick_params(labelsize=8.5)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(_round_step(grid.r_max / 4)))
    return figure, axes


def _round_step(length: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not longer."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(factor for factor in (1, 2, 5) if factor * power <= length * (1 + 1e-9)))


def _draw_points(axes: Axes, classes: PointClasses) -> None:
    """Those on the plane lie lowest: there are many, and others count more."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for name, places, colour, size, order in (
        ("on_plane", classes.on_plane, ON_PLANE, 1.1, 2.0),
        ("below", classes.below, BELOW, 1.6, 2.1),
        ("above", classes.above, ABOVE, 1.6, 2.2),
    ):
        x, y = places.T
        near = (y <= left) & (y >= right) & (x >= low) & (x <= high)
        axes.plot(y[near], x[near], "o", ms=size, mew=0, color=colour, zorder=order, gid=name)


def _draw_outlines(axes: Axes, found: Findings) -> None:
    """Gaps under the points, their edges and the labels above."""
    polygons = found.detection.gaps.polygons
    width = 1.1 if len(polygons) <= CROWD else 0.6
    for index, polygon in enumerate(polygons):
        path = outline(polygon)
        axes.add_patch(PathPatch(path, fc=GAP_FILL, ec="none", alpha=0.55, zorder=1.5))
        axes.add_patch(PathPatch(path, fc="none", ec=GAP_EDGE, lw=width, zorder=4, gid=f"gap {index}"))
    for placed in found.labels or ():
        style = "-" if placed.label.kind == "gap" else (0, (2, 1.5))
        patch = PathPatch(outline(placed.polygon), fc="none", ec=LABEL_EDGE, lw=1.8, ls=style, zorder=5)
        patch.set_gid(f"label {placed.label.id}")
        axes.add_patch(patch)


def outline(polygon: BaseGeometry) -> Path:
    """A (Multi)Polygon as artists take it, (y, x) [m]; holes are wound the other way, and stay empty."""
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(polygon)))
    return Path.make_compound_path(
        *(Path(shapely.get_coordinates(ring)[:, ::-1], closed=True) for ring in rings)
    )


def _draw_robot(axes: Axes, found: Findings) -> Rectangle:
    """The robot, its heading, and the place of its sensor [m]."""
    length, width = found.configuration.robot.length, found.configuration.robot.width
    body = Rectangle((-width / 2, -length / 2), width, length, fc="#ffffffcc", ec=ROBOT, lw=1.3, zorder=6)
    body.set_gid("robot")
    axes.add_patch(body)
    nose = [(-0.32 * width, 0.14 * length), (0.0, 0.42 * length), (0.32 * width, 0.14 * length)]
    axes.add_patch(Polygon(nose, closed=True, fc=ROBOT, ec="none", zorder=6))
    x, y, _ = found.frame.sensor.translation.tolist()
    axes.plot([y], [x], "o", ms=6, mfc=SENSOR, mec=ROBOT, mew=1.1, zorder=7, gid="sensor")
    return body
