"""Section 3.1 of the paper: gap detection in a polar binary image."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ParamSpec, Protocol, TypeVar

import numpy as np

from gapeval.config import Configuration, FieldOfView
from gapeval.detection.contours import Gap, Gaps, find_contours
from gapeval.detection.grid import PolarGrid, midpoints, polar_grid, row_edges
from gapeval.detection.plane import supporting_plane
from gapeval.detection.surface import Mask, Surface, binary_image, cell_table, morphology, surface
from gapeval.frame import Frame, Plane
from gapeval.visibility import in_box, looked_at, lowest_ray

__all__ = ["Detection", "Gap", "Gaps", "PolarGrid", "Share", "Surface", "alone", "detect"]

SMALLEST_ROW = 1e-6  # m; extreme heights and delta_r have rows at the pole that geometry cannot measure

P = ParamSpec("P")
T = TypeVar("T")


class Share(Protocol):
    """How to do a step of the algorithm."""

    def __call__(self, step: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T: ...


def alone(step: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Do the step. A sweep passes something that remembers: equal step and arguments, same result."""
    return step(*args, **kwargs)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """The gaps of one frame under one configuration, and the surface that they were found in."""

    stamp: int
    plane: Plane
    fallback: str  # why the plane is not the one that was asked for; empty if it is
    surface: Surface
    gaps: Gaps


def detect(
    frame: Frame, configuration: Configuration | None = None, share: Share = alone, margin: int = 0
) -> Detection:
    """Algorithm 1: from the points of one frame to its gaps.

    share: how to do a step; see `alone`. margin: bin this many cells beyond the box, where others that
    share the table need more than the 2 n_o of this configuration.
    """
    configuration = configuration or Configuration()
    params, robot, sensor = configuration.detector, configuration.robot, configuration.sensor
    reach = 2 * params.n_o  # an opened cell depends on cells this far away
    lowest = lowest_ray(sensor, frame)
    grid = share(
        polar_grid, params.height, params.width, params.delta_r, params.r_max, pole(frame, params.origin)
    )
    fit = share(supporting_plane, frame, params.plane, params.patch, params.x_min, robot.ground_z, robot.body)
    table = share(
        cell_table, frame, grid, fit.plane, params.z_min, params.z_max, robot.body, max(margin, reach)
    )
    seen = share(cells_seen, frame, grid, fit.plane, params.x_min, lowest, sensor.fov)
    image = share(binary_image, table, params.pl_th, reach)
    gap = share(morphology, image, seen, params.n_o, params.edge, params.kernel)
    gaps = share(find_contours, grid, gap)
    known = share(surface, grid, image, seen, gap)
    return Detection(frame.stamp, fit.plane, fit.fallback, known, gaps)


def pole(frame: Frame, origin: str) -> tuple[float, float]:
    """Where the polar grid is centred.

    `origin: sensor`: under the laser, so that a column is a ray; `origin: robot`: as Algorithm 1 is printed.
    """
    if origin == "robot":
        return (0.0, 0.0)
    x, y, _ = frame.sensor.translation.tolist()
    return (x, y)


def cells_seen(
    frame: Frame, grid: PolarGrid, plane: Plane, x_min: float, lowest: float, fov: FieldOfView | None
) -> Mask:
    """Cells (height - 1, width) of the box whose midpoint the sensor looks at; the rest can be no gap."""
    places = midpoints(grid)
    in_view = looked_at(places, plane, frame.sensor, lowest, fov)
    measurable = np.diff(row_edges(grid, grid.rows))[:, None] >= SMALLEST_ROW
    return Mask(in_box(places, x_min, grid.origin, grid.r_max) & in_view & measurable)
