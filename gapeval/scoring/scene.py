"""What can be asked of a detector in one frame: domain, shadow and visible labels. No configuration in it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.config import Configuration, Domain, Robot, Scoring
from gapeval.detection.plane import gravity_plane
from gapeval.frame import Frame, Plane, Transform, robot_plane
from gapeval.labels import Label, Labels, crossing_yaw, place
from gapeval.visibility import (
    areas_only,
    domain,
    lowest_ray,
    other_viewpoints,
    shadow,
    without_body,
)

VISIBLE, PARTLY, SHADOWED, OUT_OF_VIEW = "visible", "partly", "shadowed", "out_of_view"
SLIVER = 1e-9  # m2; less is rounding
WHOLLY = 0.99  # share of a label from which on it is called visible, not partly

Polygons = NDArray[np.object_]  # (N,) of (Multi)Polygon


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Where a frame's detections count; robot frame xy [m].

    plane: the plane that labels are put on. domain: the box, as far as the sensor or another viewpoint looks
    there. shadow: what is hidden in it, from all that look there. origin: foot of the sensor.
    """

    plane: Plane
    domain: BaseGeometry
    shadow: BaseGeometry
    origin: tuple[float, float]

    @property
    def visible(self) -> BaseGeometry:
        return areas_only(shapely.difference(self.domain, self.shadow))


@dataclass(frozen=True, slots=True, eq=False)
class PlacedLabel:
    """A gap label in one frame; robot frame xy [m].

    whole: the label, area: of it [m2]. visible: its part in the domain and out of shadow. state: visible |
    partly | shadowed | out_of_view. asked: enough of it is visible. range, bearing: from the sensor's foot to
    its nearest visible point (to its nearest point, where none is visible) [m], and in which direction [rad],
    None at no distance. yaw: crossing_yaw in the robot frame [rad].
    """

    label: Label
    whole: BaseGeometry
    area: float
    visible: BaseGeometry
    visible_area: float
    state: str
    asked: bool
    range: float
    bearing: float | None
    yaw: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The view of one frame, and the labels in it.

    visible: what can be seen. ignore: the `ignore` polygons together; visible_ignore: their visible part.
    otherwise_labelled: what is visible of labels of any kind, but for those that are asked for.
    """

    stamp: int
    view: View
    visible: BaseGeometry
    labels: tuple[PlacedLabel, ...]
    ignore: BaseGeometry
    visible_ignore: BaseGeometry
    otherwise_labelled: BaseGeometry

    @property
    def asked(self) -> tuple[PlacedLabel, ...]:
        return tuple(label for label in self.labels if label.asked)


@dataclass(frozen=True, slots=True)
class AskedLabel:
    """A label that was asked for in a frame. range: to it, width: across it [m].

    judged: it says whether it can be crossed.
    """

    label: str
    range: float
    width: float
    judged: bool


def asked_labels(scene: Scene) -> tuple[AskedLabel, ...]:
    """What is remembered of a scene when its frame is done."""
    return tuple(
        AskedLabel(of.label.id, of.range, width(of.label), of.label.traversable is not None)
        for of in scene.asked
    )


def common_domain(configurations: Iterable[Configuration], scoring: Scoring) -> tuple[Domain, str]:
    """One domain for a whole sweep, and its origin: as given, or the largest box in the grid."""
    detectors = [configuration.detector for configuration in configurations]
    largest = Domain(x_min=min(d.x_min for d in detectors), r_max=max(d.r_max for d in detectors))
    origin = "sensor" if any(d.origin == "sensor" for d in detectors) else "robot"
    return scoring.domain or largest, origin


def common_plane(configurations: Iterable[Configuration]) -> str:
    """What labels are put on, shadows fall on: one plane for a whole sweep, by its kind.

    Level if that is what all detect on; else the robot's, never one that was fitted to points.
    """
    kinds = {configuration.detector.plane for configuration in configurations}
    return "gravity" if kinds == {"gravity"} else "robot"


def plane_of(frame: Frame, kind: str, robot: Robot) -> Plane:
    """The plane of a frame that is of this kind, see common_plane."""
    return gravity_plane(frame.up, robot.ground_z).plane if kind == "gravity" else robot_plane(robot.ground_z)


def view(
    frame: Frame,
    box: Domain,
    origin: str,
    configuration: Configuration,
    scoring: Scoring,
    kind: str = "robot",
) -> View:
    """The domain and shadow of a frame. Of the configuration only robot and sensor are used.

    kind: of the plane, see common_plane.
    """
    plane, sensor = plane_of(frame, kind, configuration.robot), configuration.sensor
    x, y, _ = frame.sensor.translation.tolist()
    centre = (x, y) if origin == "sensor" else (0.0, 0.0)
    points = without_body(frame.points, configuration.robot.body)

    def seen_from(mount: Transform, lowest: float) -> tuple[BaseGeometry, BaseGeometry]:
        reach = box.r_max + float(np.hypot(*(mount.translation[:2] - centre)))
        return (
            domain(box.x_min, box.r_max, centre, plane, mount, lowest, sensor.fov),
            shadow(points, plane, mount, scoring.obstacle_height, scoring.ceiling, reach),
        )

    own = seen_from(frame.sensor, lowest_ray(sensor, frame))
    others = other_viewpoints(sensor, frame, plane)
    if others:
        height = plane.distance(points.astype(np.float64))
        points = np.compress(height > scoring.obstacle_height, points, axis=0)  # all that throw any shadow
        own = seen_together([own, *(seen_from(view.mount, view.lowest_elevation) for view in others)])
    return View(plane, *own, (x, y))


def seen_together(
    each: Iterable[tuple[BaseGeometry, BaseGeometry]],
) -> tuple[BaseGeometry, BaseGeometry]:
    """Domain and shadow of all viewpoints, from those of each.

    What at least one looks at; and of that, what lies in shadow for each that looks there.
    """
    domains, seen = [], []
    for looked_at, hidden in each:
        domains.append(looked_at)
        seen.append(shapely.difference(looked_at, hidden))
    together = shapely.union_all(domains)
    return areas_only(together), areas_only(shapely.difference(together, shapely.union_all(seen)))


def scene(
    stamp: int, pose: Transform | None, view: View, labels: Labels, robot_frame: str, scoring: Scoring
) -> Scene:
    """The labels that hold at a stamp, placed in its view."""
    visible = view.visible
    placed: list[PlacedLabel] = []
    ignored: list[BaseGeometry] = []
    for label in labels.labels:
        if not label.holds_at(stamp):
            continue
        whole = place(label, pose, view.plane, robot_frame)
        if label.kind == "ignore":
            ignored.append(whole)
        else:
            placed.append(
                _seen_label(label, whole, view, visible, crossing_yaw(label, pose, robot_frame), scoring)
            )
    ignore = shapely.union_all(ignored)
    asked = shapely.union_all([label.visible for label in placed if label.asked])
    others = shapely.union_all([ignore, *(label.whole for label in placed if not label.asked)])
    return Scene(
        stamp,
        view,
        visible,
        tuple(placed),
        ignore,
        areas_only(shapely.intersection(ignore, visible)),
        areas_only(shapely.intersection(shapely.difference(others, asked), visible)),
    )


def _seen_label(
    label: Label,
    whole: BaseGeometry,
    view: View,
    visible: BaseGeometry,
    yaw: float | None,
    scoring: Scoring,
) -> PlacedLabel:
    seen = _without_slivers(areas_only(shapely.intersection(whole, visible)))
    in_domain = shapely.intersection(whole, view.domain)
    enough = min(scoring.min_visible.share * whole.area, scoring.min_visible.area)
    asked = seen.area > 0 and seen.area >= enough
    if asked:
        state = VISIBLE if seen.area >= WHOLLY * whole.area else PARTLY
    else:
        state = SHADOWED if in_domain.area > 0 and in_domain.area >= enough else OUT_OF_VIEW
    nearest = seen if seen.area > 0 else whole
    foot = shapely.Point(view.origin)
    distance = float(shapely.distance(foot, nearest))
    (x0, y0), (x1, y1) = shapely.get_coordinates(shapely.shortest_line(foot, nearest)).tolist()
    bearing = math.atan2(y1 - y0, x1 - x0) if distance > 0 else None
    return PlacedLabel(
        label, whole, float(whole.area), seen, float(seen.area), state, asked, distance, bearing, yaw
    )


@lru_cache(maxsize=4096)
def width(label: Label) -> float:
    """How far it is across a label [m]: its own `length`, or the least width of its convex hull as drawn.

    In micrometres, since it must not depend on rounding in which class of widths a label is.
    """
    if label.length is not None:
        return label.length
    outlines = np.concatenate([rings[0][:, :2] for rings in label.parts])
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(outlines)))
    along = np.diff(hull, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    places = hull @ across.T
    return round(float((places.max(axis=0) - places.min(axis=0)).min()), 6)


def _without_slivers(region: BaseGeometry) -> BaseGeometry:
    """Neighbouring bins of a shadow leave hairlines between them, through which nothing is seen."""
    parts = shapely.get_parts(region)
    return shapely.MultiPolygon(parts[shapely.area(parts) >= SLIVER].tolist())
