"""Small worlds for the scoring tests: labels, a view and outlines, without any log or detector."""

import math
from pathlib import Path

import numpy as np
import shapely

from gapeval.config import Scoring
from gapeval.detections import Crossing
from gapeval.frame import robot_plane
from gapeval.labels import Label, Labels
from gapeval.scoring.match import score
from gapeval.scoring.scene import View, scene

ROBOT = "base_link"
STAMP = 5
NOTHING = shapely.MultiPolygon()


def outlines(polygons):
    """Detected gaps: nothing but their outlines."""
    array = np.empty(len(polygons), dtype=object)
    array[:] = list(polygons)
    return array


def box(x0, y0, x1, y1):
    return shapely.box(x0, y0, x1, y1)


def label(name, polygon, kind="gap", **known):
    """A label in the robot frame that holds at STAMP, from a shapely (Multi)Polygon."""
    parts = tuple(
        tuple(
            np.column_stack([ring.coords, np.full(len(ring.coords), math.nan)])
            for ring in (part.exterior, *part.interiors)
        )
        for part in shapely.get_parts(polygon)
    )
    return Label(name, kind, ROBOT, parts, **({"start": STAMP, "end": STAMP} | known))


def ignore(name, polygon):
    return label(name, polygon, kind="ignore")


def label_file(*labels, stamps=None):
    return Labels(Path("labels.geojson"), "0" * 64, tuple(labels), stamps)


def placed(domain, labels, shadow=NOTHING, rules=None, origin=(0.0, 0.0)):
    """The scene of these labels, seen at STAMP."""
    view = View(robot_plane(0.0), domain, shadow, origin)
    return scene(STAMP, None, view, label_file(*labels), ROBOT, rules or Scoring())


def scored(domain, labels, gaps, shadow=NOTHING, rules=None, crossings=None, origin=(0.0, 0.0)):
    """The FrameScore of gaps, given as polygons."""
    rules = rules or Scoring()
    known = [{} for _ in gaps] if crossings is None else crossings
    return score(placed(domain, labels, shadow, rules, origin), outlines(gaps), known, rules)


def crossing(gap=0, method="npca", traversable=True, length=1.0, yaw=0.0):
    spot = (1.0, 2.0, 3.0)
    reason = "" if traversable else "too_long"
    return Crossing(gap, method, traversable, reason, length, yaw, spot, spot, spot, False)
