"""What was found in one frame: all that its pictures show."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.config import Configuration
from gapeval.detection import Detection, Surface, detect
from gapeval.detection.classes import BELOW, against_plane
from gapeval.detection.classes import GROUND as ON_PLANE
from gapeval.detection.classes import OBSTACLE as ABOVE
from gapeval.detections import Crossing
from gapeval.frame import FloatArray, Frame
from gapeval.labels import Label, Labels, place
from gapeval.scoring.scene import common_plane, plane_of
from gapeval.traversability import assess

# What is known of a cell.
GROUND, OBSTACLE, SHADED, UNSEEN, GAP, OPENED = range(6)
CELL_NAMES = (
    "ground",
    "obstacle",
    "shaded by an obstacle",
    "outside the box, or never looked at",
    "gap candidate",
    "taken away by erosion and dilation",
)


@dataclass(frozen=True, slots=True, eq=False)
class PlacedOutline:
    """A label that holds at a frame's stamp, and its polygon there; robot frame xy [m]."""

    label: Label
    polygon: BaseGeometry


@dataclass(frozen=True, slots=True, eq=False)
class Findings:
    """All that the pictures of one frame show.

    log: its name. number: the frame's place in it. crossings: by npca, one for each gap. labels: None if
    none were given.
    """

    log: str
    number: int
    frame: Frame
    configuration: Configuration
    detection: Detection
    crossings: tuple[Crossing, ...]
    labels: tuple[PlacedOutline, ...] | None


def findings(
    log: str,
    number: int,
    frame: Frame,
    configuration: Configuration,
    labels: Labels | None,
    robot_frame: str,
) -> Findings:
    """Algorithms 1 and 2 on one frame, and the labels on the plane that scoring puts them on."""
    detection = detect(frame, configuration)
    crossings = assess(detection, configuration.robot, configuration.crossing)
    plane = plane_of(frame, common_plane([configuration]), configuration.robot)
    placed = None
    if labels is not None:
        placed = tuple(
            PlacedOutline(label, place(label, frame.pose, plane, robot_frame))
            for label in labels.labels
            if label.holds_at(frame.stamp)
        )
    by_npca = tuple(crossing for crossing in crossings if crossing.method == "npca")
    return Findings(log, number, frame, configuration, detection, by_npca, placed)


@dataclass(frozen=True, slots=True, eq=False)
class PointClasses:
    """The points that the detector looks at, by their place against the plane; robot frame xy [m], (N, 2)."""

    on_plane: FloatArray
    above: FloatArray
    below: FloatArray


def classify(frame: Frame, detection: Detection, configuration: Configuration) -> PointClasses:
    """|t| <= Pl_th, t > Pl_th and t < -Pl_th, Eq. (1); without robot.body and what the box cuts in z."""
    classes = against_plane(frame, detection.plane, configuration)
    xy = frame.points[:, :2].astype(np.float64)
    return PointClasses(*(xy[classes == each] for each in (ON_PLANE, ABOVE, BELOW)))


def binary_cells(surface: Surface) -> NDArray[np.uint8]:
    """Section 3.1.1: what Algorithm 1 makes of each cell, (height - 1, width); GROUND ... GAP."""
    kinds = np.full(surface.ground.shape, GAP, dtype=np.uint8)
    kinds[surface.shaded] = SHADED
    kinds[surface.ground] = GROUND
    kinds[surface.obstacle] = OBSTACLE
    kinds[~surface.seen.cells] = UNSEEN
    return kinds


def opened_cells(surface: Surface) -> NDArray[np.uint8]:
    """Section 3.1.2: the same after erosion and dilation; what they took away is OPENED."""
    kinds = binary_cells(surface)
    kinds[(kinds == GAP) & ~surface.gap.cells] = OPENED
    return kinds
