"""What each point of a cloud is to the detector."""

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Configuration
from gapeval.detection import Detection
from gapeval.frame import Frame, Plane, of_body
from gapeval.visibility import in_box

GROUND, OBSTACLE, BELOW, OUTSIDE = range(4)
CLASS_NAMES = ("ground", "obstacle", "below the plane", "outside the box")

Classes = NDArray[np.uint8]


def against_plane(frame: Frame, plane: Plane, configuration: Configuration) -> Classes:
    """|t| <= Pl_th, t > Pl_th or t < -Pl_th, Eq. (1), of each point (N,).

    OUTSIDE what is of robot.body, or cut by the box in z.
    """
    params, points = configuration.detector, frame.points.astype(np.float64)
    t = plane.distance(points)
    found = np.full(len(points), GROUND, dtype=np.uint8)
    found[t > params.pl_th] = OBSTACLE
    found[t < -params.pl_th] = BELOW
    cut = (points[:, 2] < -params.z_min) | (points[:, 2] > params.z_max)
    found[cut | of_body(frame.points, configuration.robot.body)] = OUTSIDE
    return found


def point_classes(frame: Frame, detection: Detection, configuration: Configuration) -> Classes:
    """What each point (N,) of a frame is; OUTSIDE also what the box cuts in x and r."""
    params, xy = configuration.detector, frame.points[:, :2].astype(np.float64)
    inside = in_box(xy, params.x_min, detection.surface.grid.origin, params.r_max)
    return np.where(inside, against_plane(frame, detection.plane, configuration), np.uint8(OUTSIDE))
