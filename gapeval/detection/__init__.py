"""Section 3.1 of the paper: gap detection in a polar binary image."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gapeval.config import Configuration, Detector, FieldOfView, Patch, Robot, Sensor
from gapeval.detection.contours import Gap, Gaps, find_contours
from gapeval.detection.grid import CACHED_GRIDS, PolarGrid, midpoints, polar_grid, row_edges
from gapeval.detection.plane import PlaneFit, supporting_plane
from gapeval.detection.surface import (
    BoolArray,
    CellTable,
    Mask,
    Reach,
    Surface,
    all_around,
    binary_image,
    cell_table,
    highest_around,
    morphology,
    polar_points,
    reach_of,
    surface,
    within_box,
)
from gapeval.detection.viewpoints import Elsewhere, Sight, circle, elsewhere, rows_around
from gapeval.frame import Frame, Plane, Transform
from gapeval.share import Share
from gapeval.visibility import in_box, looked_at, lowest_ray, other_viewpoints

__all__ = ["Detection", "Gap", "Gaps", "PolarGrid", "Surface", "detect", "detect_each"]

SMALLEST_ROW = 1e-6  # m; extreme heights and delta_r have rows at the pole that geometry cannot measure


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """The gaps of one frame under one configuration, and the surface that they were found in."""

    stamp: int
    plane: Plane
    fallback: str  # why the plane is not the one that was asked for; empty if it is
    surface: Surface
    gaps: Gaps


@dataclass(frozen=True, slots=True)
class Box:
    """What decides which points and cells are looked at, and the plane they are measured from."""

    plane: str
    patch: Patch
    x_min: float
    z_min: float
    z_max: float


@dataclass(frozen=True, slots=True, eq=False)
class Binned:
    """The points of a frame in the cells of a grid, before any threshold."""

    fit: PlaneFit
    table: CellTable
    elsewhere: Elsewhere | None
    seen: Mask


def detect(frame: Frame, configuration: Configuration | None = None) -> Detection:
    """Algorithm 1: from the points of one frame to its gaps."""
    (detection,) = detect_each(frame, [configuration or Configuration()], Share())
    return detection


def detect_each(frame: Frame, configurations: Sequence[Configuration], share: Share) -> list[Detection]:
    """Algorithm 1 under each configuration; what is equal is done once."""
    # An opened cell depends on cells 2 n_o away. More of them change nothing, so all share the widest table.
    margin = max(2 * configuration.detector.n_o for configuration in configurations)
    grids = [share(polar_grid, *shape(frame, configuration.detector)) for configuration in configurations]
    reach = reach_of(dict.fromkeys(grids), margin)
    if frame.others:
        reach = all_around(reach, max(circle(grid, frame.others) for grid in grids))
    binned: dict[tuple[PolarGrid, Box, Robot, Sensor], Binned] = {}
    marked = []
    for configuration, grid in zip(configurations, grids, strict=True):
        of = grid, box_of(configuration.detector), configuration.robot, configuration.sensor
        points = binned.get(of) or bin_points(frame, *of, margin, reach, share)
        binned[of] = points
        marked.append((points.fit, mark(points, configuration.detector, share)))
    gaps = share.together(find_contours, [(known.grid, known.gap) for _, known in marked])
    return [
        Detection(frame.stamp, fit.plane, fit.fallback, known, found)
        for (fit, known), found in zip(marked, gaps, strict=True)
    ]


def bin_points(
    frame: Frame,
    grid: PolarGrid,
    box: Box,
    robot: Robot,
    sensor: Sensor,
    margin: int,
    reach: Reach,
    share: Share,
) -> Binned:
    """Section 3.1.1 before any threshold: from points to cells."""
    lowest = lowest_ray(sensor, frame)
    fit = share(supporting_plane, frame, box.plane, box.patch, box.x_min, robot.ground_z, robot.body)
    points = share(polar_points, frame, grid.origin, fit.plane, box.z_min, box.z_max, robot.body, reach)
    table = share(cell_table, points, grid, margin)
    seen = share(cells_seen, grid, fit.plane, frame.sensor, box.x_min, lowest, sensor.fov)
    sight = Sight(fit.plane, frame.sensor, lowest, other_viewpoints(sensor, frame, fit.plane), sensor.fov)
    if not sight.others:
        return Binned(fit, table, None, seen)
    around = share(highest_around, points, grid, rows_around(grid, sight.others))
    beside = share(elsewhere, around, margin, sight)
    return Binned(fit, table, beside, share(also_seen, grid, seen, box.x_min, beside))


def mark(binned: Binned, params: Detector, share: Share) -> Surface:
    """Sections 3.1.1 and 3.1.2: from cells to the filtered image."""
    image = share(binary_image, binned.table, binned.elsewhere, params.pl_th)
    gap = share(morphology, image, binned.seen, params.n_o, params.edge, params.kernel)
    return surface(binned.table.grid, image, binned.seen, gap)


def box_of(params: Detector) -> Box:
    return Box(params.plane, params.patch, params.x_min, params.z_min, params.z_max)


def shape(frame: Frame, params: Detector) -> tuple[int, int, float, float, tuple[float, float]]:
    """What decides the polar grid of Eqs. (2)-(5)."""
    return params.height, params.width, params.delta_r, params.r_max, pole(frame, params.origin)


def pole(frame: Frame, origin: str) -> tuple[float, float]:
    """Where the polar grid is centred.

    `origin: sensor`: under the laser, so that a column is a ray; `origin: robot`: as Algorithm 1 is printed.
    """
    if origin == "robot":
        return (0.0, 0.0)
    x, y, _ = frame.sensor.translation.tolist()
    return (x, y)


@lru_cache(maxsize=CACHED_GRIDS)
def cells_seen(
    grid: PolarGrid, plane: Plane, mount: Transform, x_min: float, lowest: float, fov: FieldOfView | None
) -> Mask:
    """Cells (height - 1, width) of the box whose midpoint the sensor looks at; the rest can be no gap."""
    return Mask(cells_in_box(grid, x_min) & looked_at(midpoints(grid), plane, mount, lowest, fov))


def cells_in_box(grid: PolarGrid, x_min: float) -> BoolArray:
    """Cells (height - 1, width) whose midpoint lies in the box, of rows that can be measured."""
    measurable = np.diff(row_edges(grid, grid.rows))[:, None] >= SMALLEST_ROW
    return in_box(midpoints(grid), x_min, grid.origin, grid.r_max) & measurable


def also_seen(grid: PolarGrid, seen: Mask, x_min: float, elsewhere: Elsewhere) -> Mask:
    """Cells of the box that the sensor, or any other viewpoint, looks at."""
    looked = within_box(np.asarray(elsewhere.looked_at.any(axis=0)), elsewhere.margin)
    return Mask(seen.cells | looked & cells_in_box(grid, x_min))
