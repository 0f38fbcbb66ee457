"""Detections as what RViz and Foxglove show: gaps, crossings, labels and points, by topic."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from gapeval.config import Configuration
from gapeval.detection import Detection
from gapeval.detection.classes import BELOW, GROUND, OBSTACLE, OUTSIDE, point_classes
from gapeval.detections import Crossing, DetectedFrame
from gapeval.frame import FloatArray, Frame, Plane, Transform
from gapeval.labels import Label, Labels
from gapeval.logs.write.display import ARROW, LINES, TEXT, TRIANGLES, Colour, ColouredCloud, Marker, Markers
from gapeval.scoring.label_score import LabelScore

GAPS, CROSSINGS, LABELS, POINTS = "/gapeval/gaps", "/gapeval/crossings", "/gapeval/labels", "/gapeval/points"

# As in the pictures: green may be crossed, red not; violet is drawn by hand.
YES, NO, UNKNOWN = (0.03, 0.5, 0.18, 1.0), (0.82, 0.07, 0.17, 1.0), (0.0, 0.24, 1.0, 1.0)
DRAWN, NOT_ASKED = (0.71, 0.0, 0.71, 1.0), (0.55, 0.55, 0.55, 1.0)
FILL = 0.35  # opacity
RGB = {GROUND: 0x858D98, OBSTACLE: 0xC2570C, BELOW: 0x0A7D8C, OUTSIDE: 0x3A3F47}
LINE, LETTERS, ABOVE = 0.03, 0.12, 0.08  # m; texts stand so far above the plane


def classified_points(
    frame: Frame, detection: Detection, configuration: Configuration, frame_id: str
) -> ColouredCloud:
    """All points of a frame, and what each is to the detector."""
    kinds = point_classes(frame, detection, configuration)
    rgb = np.array([RGB[kind] for kind in range(len(RGB))], dtype=np.uint32)[kinds]
    return ColouredCloud(frame.stamp, POINTS, frame_id, frame.points, rgb, kinds)


def gap_markers(frame: DetectedFrame, frame_id: str) -> Markers:
    """Of each gap its outline, holes too, its area, and a text; on the plane that it lies on."""
    return Markers(frame.stamp, GAPS, frame_id, list(_gaps(frame, frame_id)))


def _gaps(frame: DetectedFrame, frame_id: str) -> Iterator[Marker]:
    plane = frame.gap_plane
    for index, (polygon, crossings) in enumerate(zip(frame.polygons, frame.crossings, strict=True)):
        npca = crossings.get("npca")
        colour = _verdict(npca)
        outline, area = on_plane(edges(polygon), plane), on_plane(triangles(polygon), plane)
        yield Marker("outline", index, LINES, frame_id, outline, colour, (LINE, 0, 0))
        yield Marker("area", index, TRIANGLES, frame_id, area, (*colour[:3], FILL), (1, 1, 1))
        spot = shapely.get_coordinates(shapely.point_on_surface(polygon))
        words = _words(index, polygon, npca)
        yield _text(index, frame_id, on_plane(spot, plane), colour, words)


def _text(number: int, frame_id: str, place: FloatArray, colour: Colour, words: str) -> Marker:
    """place: (1, 3), which it stands above."""
    spot = place + np.array([0, 0, ABOVE])
    return Marker("text", number, TEXT, frame_id, spot, colour, (0, 0, LETTERS), words)


def _words(index: int, polygon: BaseGeometry, crossing: Crossing | None) -> str:
    text = f"{index}: {polygon.area:.2f} m2"
    if crossing is None:
        return text
    return f"{text}, {crossing.length:.2f} m" + (f", {crossing.reason}" if crossing.reason else "")


def crossing_markers(frame: DetectedFrame, frame_id: str) -> Markers:
    """Of each gap and method an arrow from START to END."""
    arrows = [
        Marker(
            method,
            crossing.gap,
            ARROW,
            frame_id,
            np.array([crossing.start, crossing.end]),
            _verdict(crossing),
            (0.03, 0.08, 0.12),
        )
        for crossings in frame.crossings
        for method, crossing in crossings.items()
    ]
    return Markers(frame.stamp, CROSSINGS, frame_id, arrows)


def _verdict(crossing: Crossing | None) -> Colour:
    if crossing is None:
        return UNKNOWN
    return YES if crossing.traversable else NO


def label_markers(
    frame: DetectedFrame, labels: Labels, scores: Sequence[LabelScore], frame_id: str
) -> Markers:
    """Of each label that holds its outline, in its own frame, and its id.

    scores: what is known of them at this stamp: hit is green, missed red, not asked for grey.
    """
    known = {score.label: score for score in scores}
    found = []
    for number, label in enumerate(label for label in labels.labels if label.holds_at(frame.stamp)):
        where = Transform.identity() if label.frame_id == frame_id else frame.pose
        if where is None:
            continue
        colour = _label_colour(label, known.get(label.id))
        rings = [_with_height(ring, where, frame.plane) for rings in label.parts for ring in rings]
        lines = np.concatenate([_pairs(ring) for ring in rings])
        found.append(Marker("outline", number, LINES, label.frame_id, lines, colour, (LINE, 0, 0)))
        middle = rings[0][:-1].mean(axis=0, keepdims=True)
        found.append(_text(number, label.frame_id, middle, colour, label.id))
    return Markers(frame.stamp, LABELS, frame_id, found)


def _label_colour(label: Label, score: LabelScore | None) -> Colour:
    if label.kind == "ignore":
        return NOT_ASKED
    if score is None:
        return DRAWN
    if score.hit is None:
        return NOT_ASKED
    return YES if score.hit else NO


def _with_height(ring: FloatArray, where: Transform, plane: Plane) -> FloatArray:
    """Vertices (N, 3) of a label's own frame; those without z on the plane, along that frame's z.

    where: of the robot in that frame.
    """
    flat = np.isnan(ring[:, 2])
    found = np.where(np.isnan(ring), 0.0, ring)
    rise = where.matrix[2] @ np.array([plane.a, plane.b, plane.c])
    found[flat, 2] = -plane.distance(where.apply_inverse(found[flat])) / rise
    return found


def edges(polygon: BaseGeometry) -> FloatArray:
    """Both ends of each edge of all rings of a (Multi)Polygon, one after the other, (2 N, 2)."""
    rings = shapely.get_rings(shapely.get_parts(polygon))
    return np.concatenate([_pairs(shapely.get_coordinates(ring)) for ring in rings])


def _pairs(ring: FloatArray) -> FloatArray:
    return np.stack([ring[:-1], ring[1:]], axis=1).reshape(-1, ring.shape[1])


def triangles(polygon: BaseGeometry) -> FloatArray:
    """Corners of triangles that make up a (Multi)Polygon, without its holes, (3 N, 2), counter-clockwise."""
    found = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    corners = shapely.get_coordinates(found).reshape(-1, 4, 2)[:, :3]
    along, aside = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = along[:, 0] * aside[:, 1] < along[:, 1] * aside[:, 0]
    corners[clockwise] = corners[clockwise][:, ::-1]
    return corners.reshape(-1, 2)


def on_plane(places: FloatArray, plane: Plane) -> FloatArray:
    return np.column_stack([places, plane.height(places)])
