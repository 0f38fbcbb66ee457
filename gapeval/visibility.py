"""What can be seen: sensory box, field of view, blind zone, line-of-sight shadow.

Detection asks it of cells, scoring of polygons; both mean the same thing.
"""

from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.config import BlindBelow, BodyBox, FieldOfView, Sensor
from gapeval.frame import (
    FloatArray,
    Frame,
    Plane,
    Transform,
    Viewpoint,
    of_body,
    sensor_angles,
    sensor_elevation,
    upright,
)

AZIMUTH_STEP = np.deg2rad(0.5)  # of shadows, and of the outline of what a sensor sees
BINS = 720  # around
ARC_STEPS = 360  # vertices of the half circle that bounds the domain


def without_body(points: NDArray[np.float32], body: BodyBox | None) -> NDArray[np.float32]:
    """The points (N, 3), robot frame [m], that are not of the robot itself."""
    if body is None:
        return points
    others: NDArray[np.float32] = points[~of_body(points, body)]
    return others


def lowest_ray(sensor: Sensor, source: Frame | Viewpoint) -> float:
    """Elevation [rad, sensor frame] below which the sensor of a frame, or another viewpoint, sees nothing."""
    if isinstance(sensor.blind_zone, BlindBelow):
        return sensor.blind_zone.below
    return source.lowest_elevation if sensor.blind_zone == "auto" else -np.pi / 2


def other_viewpoints(sensor: Sensor, frame: Frame, plane: Plane) -> tuple[Viewpoint, ...]:
    """Those of a frame beside its sensor, with the lowest rays that count; from below, none sees a plane."""
    return tuple(
        Viewpoint(view.mount, lowest_ray(sensor, view))
        for view in frame.others
        if plane.distance(view.mount.translation) > 0
    )


def in_box(places: FloatArray, x_min: float, origin: tuple[float, float], r_max: float) -> NDArray[np.bool_]:
    """Whether places (..., 2), robot frame [m], lie in the sensory box of Section 3.1.1."""
    r = np.hypot(places[..., 0] - origin[0], places[..., 1] - origin[1])
    return (places[..., 0] >= x_min) & (r < r_max)


def looked_at(
    places: FloatArray, plane: Plane, mount: Transform, lowest: float, fov: FieldOfView | None
) -> NDArray[np.bool_]:
    """Whether the sensor would see the plane at places (..., 2), robot frame [m], were nothing in the way."""
    ground = np.concatenate([places, plane.height(places)[..., None]], axis=-1)
    seen: NDArray[np.bool_] = sensor_elevation(mount, ground) >= lowest
    if fov is not None:
        azimuth, elevation = sensor_angles(mount, ground)
        seen &= (elevation >= fov.elevation[0]) & (elevation <= fov.elevation[1])
        seen &= (azimuth >= fov.azimuth[0]) & (azimuth <= fov.azimuth[1])
    return seen


@lru_cache(maxsize=64)  # more than viewpoints of a frame, so that the sensor's own stays
def domain(
    x_min: float,
    r_max: float,
    origin: tuple[float, float],
    plane: Plane,
    mount: Transform,
    lowest: float,
    fov: FieldOfView | None,
) -> BaseGeometry:
    """The box as a polygon in the robot frame [m], without what the sensor cannot see."""
    theta = np.linspace(-np.pi / 2, np.pi / 2, ARC_STEPS + 1)
    # Drawn around the circle, so that it holds the cells of the last row.
    r = r_max / np.cos(np.pi / ARC_STEPS / 2)
    arc = np.column_stack([origin[0] + r * np.cos(theta), origin[1] + r * np.sin(theta)])
    box: BaseGeometry = shapely.intersection(shapely.Polygon(arc), shapely.box(x_min, -1e6, 1e6, 1e6))
    around = (-np.pi, np.pi)
    low = max(lowest, fov.elevation[0]) if fov else lowest
    if low > -np.pi / 2:
        box = shapely.difference(box, ground_below(low, around, plane, mount, 10 * r_max))
    if fov:
        box = shapely.intersection(box, ground_below(fov.elevation[1], fov.azimuth, plane, mount, 10 * r_max))
    return areas_only(box)


def shadow(
    points: NDArray[np.float32], plane: Plane, mount: Transform, lowest: float, highest: float, reach: float
) -> BaseGeometry:
    """Ground that the sensor cannot see because something stands before it; robot frame [m].

    In azimuth bins of 0.5 degrees around the sensor: behind a point between `lowest` and `highest` above
    the plane, up to where the line from the sensor over it meets the plane again; at most to `reach`.
    """
    origin = mount.translation
    sensor_height = float(plane.distance(origin[None, :])[0])
    p = points.astype(np.float64)
    height = plane.distance(p)
    stands = (height > lowest) & (height <= highest)
    p, height = np.compress(stands, p, axis=0), height[stands]
    east, north = p[:, 0] - origin[0], p[:, 1] - origin[1]
    start = np.hypot(east, north)
    with np.errstate(divide="ignore"):
        end = np.where(height < sensor_height, start * sensor_height / (sensor_height - height), np.inf)
    # Chords stay outside the domain's arc, so that it is covered too.
    end = np.minimum(end, reach / np.cos(AZIMUTH_STEP))
    near = (start < reach) & (start > 0)
    bins = np.floor(np.arctan2(north, east) / AZIMUTH_STEP).astype(np.int64)
    bins, start, end = bins[near], start[near], end[near]
    kept = _before_the_last(bins, start, end)
    strips = _strips(*_merged_intervals(bins[kept], start[kept], end[kept]))
    return areas_only(shapely.union_all([shapely.Polygon(strip + origin[:2]) for strip in strips]))


def _before_the_last(bins: NDArray[np.int64], start: FloatArray, end: FloatArray) -> NDArray[np.bool_]:
    """Intervals that are not in the first one of their bin that has the farthest end: most, behind a wall."""
    lasting = end == end.max(initial=0.0)
    first = np.full(BINS, np.inf)
    np.minimum.at(first, bins[lasting] % BINS, start[lasting])
    kept: NDArray[np.bool_] = start <= first[bins % BINS]
    return kept


def _strips(bins: NDArray[np.int64], start: FloatArray, end: FloatArray) -> list[FloatArray]:
    """Rings (M, 2) that cover the intervals: those of neighbouring bins that overlap share one.

    A union of a few strips is much cheaper than that of every bin.
    """
    strips: list[list[int]] = []
    open_: list[list[int]] = []  # strips that end in the bin before
    for index, (bin_, low, high) in enumerate(zip(bins.tolist(), start.tolist(), end.tolist(), strict=True)):
        open_ = [strip for strip in open_ if bins[strip[-1]] >= bin_ - 1]
        for strip in open_:
            last = strip[-1]
            if bins[last] == bin_ - 1 and start[last] < high and low < end[last]:
                strip.append(index)
                break
        else:
            strips.append([index])
            open_.append(strips[-1])
    rings = []
    for strip in strips:
        sides = np.repeat(bins[strip] * AZIMUTH_STEP, 2)
        sides[1::2] = (bins[strip] + 1) * AZIMUTH_STEP
        angle = np.concatenate([sides, sides[::-1]])
        radius = np.concatenate([np.repeat(start[strip], 2), np.repeat(end[strip], 2)[::-1]])
        rings.append(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    return rings


def areas_only(geometry: BaseGeometry) -> BaseGeometry:
    """A (Multi)Polygon, without the points and lines that set operations leave behind."""
    parts = shapely.get_parts(geometry)
    if shapely.get_type_id(geometry) == shapely.GeometryType.GEOMETRYCOLLECTION:
        parts = shapely.get_parts(parts)
    parts = parts[shapely.get_dimensions(parts) == 2]
    return shapely.Polygon(parts[0]) if len(parts) == 1 else shapely.MultiPolygon(list(parts))


def _merged_intervals(
    bins: NDArray[np.int64], start: FloatArray, end: FloatArray
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """The union of intervals [start, end] within each bin."""
    if len(bins) == 0:
        return bins, start, end
    order = np.lexsort((start, bins))
    bins, start, end = bins[order], start[order], end[order]
    apart = (bins - bins[0]) * (2 * float(end.max()))  # so that one running maximum serves all bins
    covered = np.maximum.accumulate(end + apart)
    first = np.flatnonzero(np.concatenate([[True], (start + apart)[1:] > covered[:-1]]))
    return bins[first], start[first], np.maximum.reduceat(end, first)


def ground_below(
    elevation: float, azimuth: tuple[float, float], plane: Plane, mount: Transform, far: float
) -> BaseGeometry:
    """The ground that a sensor sees at no more than an elevation, between two azimuths [rad]; xy [m].

    All ground of one azimuth lies on a line that begins where the sensor's z axis meets the plane, and
    leads away parallel to the ray at the horizon. Cut `far` away.
    """
    steps = int(np.ceil((azimuth[1] - azimuth[0]) / AZIMUTH_STEP)) + 1
    theta = np.linspace(*azimuth, steps)
    level = np.column_stack([np.cos(theta), np.sin(theta), np.zeros(steps)]) @ mount.matrix.T
    up = upright(mount) * mount.matrix[:, 2]
    normal = np.array([plane.a, plane.b, plane.c])
    rise = max(float(up @ normal), 1e-6)  # a sensor on its side never quite is
    horizon = np.arctan2(-(level @ normal), rise)
    height = float(plane.distance(mount.translation[None, :])[0])
    foot = mount.translation - up * height / rise
    away = level * np.cos(horizon)[:, None] + up * np.sin(horizon)[:, None]
    # By the sine rule in the triangle of sensor, foot and ground; at the horizon it has no end.
    angle = np.minimum(elevation, np.pi / 2) + np.pi / 2
    below = np.sin(horizon - (angle - np.pi / 2))
    reach = far + float(np.hypot(*(foot - mount.translation)[:2]))
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(below > 0, height / rise * np.sin(angle) / below, np.inf)
    rim = foot + away * np.minimum(distance, reach)[:, None]
    if azimuth[1] - azimuth[0] < 2 * np.pi - 1e-9:
        rim = np.vstack([rim, foot])
    return shapely.make_valid(shapely.Polygon(rim[:, :2]))
