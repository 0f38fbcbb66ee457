"""Hand-labelled gap polygons: the GeoJSON format, its checks, and its way into the robot frame."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from gapeval.errors import LabelError
from gapeval.frame import FloatArray, Plane, Transform

OVERLAP = 1e-9  # m2 that two gap labels may share by rounding

T = TypeVar("T")
Rings = tuple[FloatArray, ...]  # exterior first; each (N, 3) [m], closed, z NaN where a vertex has none


@dataclass(frozen=True, slots=True, eq=False)
class Label:
    """One feature of a label file.

    parts: its polygons, in the frame frame_id. start, end: first and last stamp at which it holds [ns].
    traversable, length [m] and crossing_yaw [rad, axial, in frame_id]: what is known of crossing it.
    """

    id: str
    kind: Literal["gap", "ignore"]
    frame_id: str
    parts: tuple[Rings, ...]
    start: int | None = None
    end: int | None = None
    traversable: bool | None = None
    length: float | None = None
    crossing_yaw: float | None = None

    def holds_at(self, stamp: int) -> bool:
        return (self.start is None or stamp >= self.start) and (self.end is None or stamp <= self.end)


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """A label file. sha256: of what it says. stamps: the frames that were labelled [ns]; None means all."""

    path: Path
    sha256: str
    labels: tuple[Label, ...]
    stamps: frozenset[int] | None = None

    def cover(self, stamp: int) -> bool:
        """Whether the frame at this stamp was labelled, so that what is found there counts."""
        return self.stamps is None or stamp in self.stamps


class Problem(NamedTuple):
    """What is wrong with a label file, and where: `feature 3 (trench)` or `file`."""

    where: str
    reason: str

    def __str__(self) -> str:
        return f"{self.where}: {self.reason}"


def read_labels(path: Path) -> Labels:
    """Raises LabelError with the first problem, and how many more there are."""
    labels, problems = check_labels(path)
    if problems:
        more = f" (and {len(problems) - 1} more; see `gapeval labels check`)" if len(problems) > 1 else ""
        raise LabelError(f"{path}: {problems[0]}{more}")
    return labels


def check_labels(path: Path) -> tuple[Labels, list[Problem]]:
    """The labels that can be used, and every problem by feature. Raises LabelError if it is no GeoJSON."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LabelError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        document = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise LabelError(f"{path}: not JSON: {error}; labels are a GeoJSON FeatureCollection") from error
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        raise LabelError(f"{path}: expected a GeoJSON FeatureCollection")
    features = document.get("features")
    if not isinstance(features, list):
        raise LabelError(f"{path}: a FeatureCollection needs `features`, a list")
    problems: list[Problem] = []
    labels: list[Label] = []
    seen: set[str] = set()
    for index, feature in enumerate(features):
        label, reasons = _label(feature, document.get("frame_id"))
        name = _given_id(feature)
        if name and name in seen:
            reasons.append(f"the id {name} is used before")
        seen.add(name)
        if label is not None and not reasons:
            labels.append(label)
        where = f"feature {index} ({name})" if name else f"feature {index}"
        problems += [Problem(where, reason) for reason in reasons]
    problems += _overlaps(labels)
    stamps, wrong = _stamps(document.get("stamps"))
    problems += wrong
    # Of what it says, not of its bytes: neither line ends nor indents make other labels.
    said = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return Labels(path, hashlib.sha256(said.encode()).hexdigest(), tuple(labels), stamps), problems


def labels_text(labels: Iterable[Label], frame_id: str, **about: Any) -> str:
    """A label file, as text. about: what else to say at its top; readers leave it alone."""
    features = ",\n".join(json.dumps(_feature(label)) for label in labels)
    top = json.dumps({"type": "FeatureCollection", "frame_id": frame_id} | about)
    return f'{top[:-1]}, "features": [\n{features}\n]}}\n'


def require_frames(
    labels: Labels,
    robot_frame: str,
    fixed_frame: str | None,
    where: str = "the log is read in",
    remedy: str = "use --fixed-frame or --robot-frame, or redraw it",
) -> None:
    """Raises LabelError unless every label is in one of these frames, with times if it is the robot's."""
    known = [frame for frame in (fixed_frame, robot_frame) if frame]
    for label in labels.labels:
        if label.frame_id not in known:
            raise LabelError(
                f"{labels.path}: label {label.id} is in the frame {label.frame_id!r}, but {where} "
                f"{' and '.join(map(repr, known))}; {remedy}"
            )
        if label.frame_id == robot_frame and (label.start is None or label.end is None):
            raise LabelError(
                f"{labels.path}: label {label.id} moves with the robot frame {robot_frame!r}; "
                "give it `start` and `end` stamps"
            )


def place(label: Label, pose: Transform | None, plane: Plane, robot_frame: str) -> BaseGeometry:
    """The label as a (Multi)Polygon on the plane, robot frame xy [m], of a robot at this pose (fixed<-robot).

    A vertex with z is projected along the plane's normal, one without is put on the plane along its
    frame's z. Raises LabelError if that leaves no valid polygon.
    """
    if label.frame_id == robot_frame:
        origin = Transform.identity()
    elif pose is not None:
        origin = pose
    else:
        raise LabelError(f"label {label.id} is in {label.frame_id!r}, but the frame has no pose in it")
    polygons = [
        shapely.Polygon(
            on_plane(rings[0], origin, plane), [on_plane(hole, origin, plane) for hole in rings[1:]]
        )
        for rings in label.parts
    ]
    placed = polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
    if not placed.is_valid:
        raise LabelError(
            f"label {label.id}: not a valid polygon when seen in the robot's plane; check its z values"
        )
    return placed


def on_plane(vertices: FloatArray, origin: Transform, plane: Plane) -> FloatArray:
    """Places (N, 2) on the plane, robot frame [m], of vertices (N, 3) of another frame; z may be NaN."""
    flat = np.isnan(vertices[:, 2])
    points = origin.apply_inverse(np.where(np.isnan(vertices), 0.0, vertices))
    normal = np.array([plane.a, plane.b, plane.c])
    fall = np.where(
        flat[:, None], origin.matrix[2], normal
    )  # the direction in which a vertex moves to the plane
    places: FloatArray = (points - fall * (plane.distance(points) / (fall @ normal))[:, None])[:, :2]
    return places


def crossing_yaw(label: Label, pose: Transform | None, robot_frame: str) -> float | None:
    """The label's crossing_yaw in the robot frame [rad]."""
    if label.crossing_yaw is None or label.frame_id == robot_frame or pose is None:
        return label.crossing_yaw
    heading = np.array([math.cos(label.crossing_yaw), math.sin(label.crossing_yaw), 0.0]) @ pose.matrix
    return math.atan2(heading[1], heading[0])


def _feature(label: Label) -> dict[str, Any]:
    known = {
        "id": label.id,
        "kind": label.kind,
        "frame_id": label.frame_id,
        "start": None if label.start is None else str(label.start),
        "end": None if label.end is None else str(label.end),
        "traversable": label.traversable,
        "length": label.length,
        "crossing_yaw": label.crossing_yaw,
    }
    polygons = [
        [[[value for value in place if not math.isnan(value)] for place in ring.tolist()] for ring in rings]
        for rings in label.parts
    ]
    one = len(polygons) == 1
    return {
        "type": "Feature",
        "properties": {name: value for name, value in known.items() if value is not None},
        "geometry": {
            "type": "Polygon" if one else "MultiPolygon",
            "coordinates": polygons[0] if one else polygons,
        },
    }


class _FeatureError(Exception):
    """Why a feature cannot be used."""


def _given_id(feature: Any) -> str:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    return str(properties["id"]) if isinstance(properties, dict) and properties.get("id") is not None else ""


def _label(feature: Any, default_frame: Any) -> tuple[Label | None, list[str]]:
    """The label of a feature, and every reason why it cannot be used."""
    properties = feature.get("properties") if isinstance(feature, dict) else None
    if not isinstance(properties, dict):
        return None, ["no `properties`; a label needs at least an `id`"]
    reasons: list[str] = []

    def tried(read: Callable[[], T]) -> T | None:
        try:
            return read()
        except _FeatureError as error:
            reasons.append(str(error))
            return None

    start, end = tried(lambda: _span(properties)) or (None, None)
    label = Label(
        id=tried(lambda: _id(properties)) or "",
        kind=tried(lambda: _kind(properties)) or "gap",
        frame_id=tried(lambda: _frame_id(properties, default_frame)) or "",
        parts=tried(lambda: _parts(feature.get("geometry"))) or (),
        start=start,
        end=end,
        traversable=tried(lambda: _typed(properties, "traversable", bool)),
        length=tried(lambda: _typed(properties, "length", float)),
        crossing_yaw=tried(lambda: _typed(properties, "crossing_yaw", float)),
    )
    return label, reasons


def _id(properties: dict[str, Any]) -> str:
    name = properties.get("id")
    if not isinstance(name, str | int) or isinstance(name, bool) or name == "":
        raise _FeatureError("no `id` among its properties")
    return str(name)


def _kind(properties: dict[str, Any]) -> Literal["gap", "ignore"]:
    kind = properties.get("kind") or "gap"
    if kind == "gap" or kind == "ignore":
        return "gap" if kind == "gap" else "ignore"
    raise _FeatureError(f"kind is {kind!r}; use `gap` or `ignore`")


def _frame_id(properties: dict[str, Any], default_frame: Any) -> str:
    frame_id = properties.get("frame_id") or default_frame
    if not isinstance(frame_id, str) or not frame_id:
        raise _FeatureError('no frame: add "frame_id": "map" (or another) at the top of the file')
    return frame_id.removeprefix("/")


def _span(properties: dict[str, Any]) -> tuple[int | None, int | None]:
    start, end = _stamp(properties.get("start"), "start"), _stamp(properties.get("end"), "end")
    if start is not None and end is not None and start > end:
        raise _FeatureError(f"start {start} is later than end {end}")
    return start, end


def _typed(properties: dict[str, Any], key: str, kind: type) -> Any:
    value = properties.get(key)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if value is not None and (
        not isinstance(value, kind) or (isinstance(value, float) and not math.isfinite(value))
    ):
        raise _FeatureError(
            f"{key} is {value!r}; expected {'a number' if kind is float else 'true or false'}"
        )
    return value


def _stamp(value: Any, key: str) -> int | None:
    if value is None:
        return None
    try:
        if isinstance(value, bool) or (isinstance(value, float) and value != int(value)):
            raise ValueError
        return int(value)
    except (TypeError, ValueError, OverflowError):
        raise _FeatureError(f"{key} is {value!r}; expected nanoseconds, as a string") from None


def _stamps(values: Any) -> tuple[frozenset[int] | None, list[Problem]]:
    if values is None:
        return None, []
    if not isinstance(values, list) or None in values:
        return None, [Problem("file", "`stamps` is no list of stamps")]
    try:
        return frozenset(stamp for value in values if (stamp := _stamp(value, "a stamp")) is not None), []
    except _FeatureError as refusal:
        return None, [Problem("file", f"`stamps`: {refusal}")]


def _parts(geometry: Any) -> tuple[Rings, ...]:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise _FeatureError(f"geometry is {kind or 'missing'}; expected Polygon or MultiPolygon")
    coordinates = geometry.get("coordinates")
    polygons = [coordinates] if kind == "Polygon" else coordinates
    if not isinstance(polygons, list) or not polygons:
        raise _FeatureError("no coordinates")
    parts = tuple(
        tuple(_ring(ring) for ring in _listed(polygon, "a polygon without rings")) for polygon in polygons
    )
    shape = _shape(parts)
    if not shape.is_valid:
        raise _FeatureError(f"not a valid polygon: {shapely.is_valid_reason(shape)}")
    return parts


def _shape(parts: tuple[Rings, ...]) -> BaseGeometry:
    """The polygons as drawn, in the xy of their frame."""
    polygons = [shapely.Polygon(rings[0][:, :2], [hole[:, :2] for hole in rings[1:]]) for rings in parts]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def _listed(values: Any, refusal: str) -> list[Any]:
    if not isinstance(values, list) or not values:
        raise _FeatureError(refusal)
    return values


def _position(values: Any) -> list[float]:
    if not isinstance(values, list) or len(values) not in (2, 3):
        raise _FeatureError("a vertex needs x, y and perhaps z")
    if any(not isinstance(value, int | float) or isinstance(value, bool) for value in values):
        raise _FeatureError("coordinates that are no numbers")
    if not all(math.isfinite(value) for value in values):
        raise _FeatureError("coordinates that are not finite")
    return [float(value) for value in values]


def _ring(positions: Any) -> FloatArray:
    rows = [_position(position) for position in _listed(positions, "a ring without positions")]
    ring = np.array([row if len(row) == 3 else [*row, math.nan] for row in rows], dtype=np.float64).reshape(
        -1, 3
    )
    if len(ring) < 4:
        raise _FeatureError(
            f"a ring of {len(ring)} positions; it takes at least 4, the last equal to the first"
        )
    if not np.array_equal(ring[0], ring[-1], equal_nan=True):
        raise _FeatureError("an open ring: repeat its first position at the end")
    return ring


def _overlaps(labels: Iterable[Label]) -> list[Problem]:
    """Pairs of gap labels that share ground at the same time: who found which could not be told."""
    gaps = [label for label in labels if label.kind == "gap"]
    outlines = [_shape(gap.parts) for gap in gaps]
    shapes = np.array(outlines, dtype=object)
    problems = []
    for one, other in zip(*shapely.STRtree(shapes).query(shapes, predicate="intersects"), strict=True):
        first, second = gaps[one], gaps[other]
        if one >= other or first.frame_id != second.frame_id:
            continue
        apart = (first.end is not None and second.start is not None and first.end < second.start) or (
            second.end is not None and first.start is not None and second.end < first.start
        )
        shared = shapely.intersection(outlines[one], outlines[other]).area
        if shared > OVERLAP and not apart:
            problems.append(
                Problem(
                    f"label {second.id}", f"overlaps label {first.id} by {shared:.3g} m2; gap labels may not"
                )
            )
    return problems
