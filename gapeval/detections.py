"""The detections format: GeoJSON of gaps and crossings, from `gapeval detect` or any other program."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.errors import ShapelyError
from shapely.geometry.base import BaseGeometry

from gapeval import __version__
from gapeval.errors import DetectionsError
from gapeval.frame import Plane, PoseQuality, Transform, robot_plane

OPENING = '{"type": "FeatureCollection",\n"frames": ['  # how our own files begin

Method = Literal["npca", "pca"]
METHODS: tuple[Method, Method] = ("npca", "pca")  # Sections 3.2.1 and 3.2.2


@dataclass(frozen=True, slots=True)
class Crossing:
    """The paper's t_j for one gap and one feature space; positions in the robot frame [m], on the plane.

    reason: why it is not traversable; empty if it is. length: extent of the gap along the way [m].
    yaw: from START to END [rad]. tie: the shape has no direction, so the way leads away from the robot.
    """

    gap: int
    method: Method
    traversable: bool
    reason: str
    length: float
    yaw: float
    centre: tuple[float, float, float]
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    tie: bool

    @property
    def t_j(self) -> tuple[float, ...]:
        """Algorithm 2's ten numbers: t, p_center, p_start, p_end; zeros if the gap is not traversable."""
        if not self.traversable:
            return (0.0,) * 10
        return (1.0, *self.centre, *self.start, *self.end)


@dataclass(frozen=True, slots=True, eq=False)
class DetectedFrame:
    """The gaps of one frame; robot frame [m].

    pose: fixed<-robot. plane: what labels are put on. gap_plane: what the gaps lie on. domain, shadow:
    where detections count; None where the file does not say. origin: foot of the sensor.
    polygons: (N,) of (Multi)Polygon, xy. crossings: of each gap, what is known of crossing it.
    fallback: why the gaps' plane is not the one that was asked for; empty if it is. quality: of the pose.
    weights: how sure each gap is, see certainty; empty where that is not known.
    """

    stamp: int
    pose: Transform | None
    plane: Plane
    gap_plane: Plane
    domain: BaseGeometry | None
    shadow: BaseGeometry | None
    origin: tuple[float, float]
    polygons: NDArray[np.object_]
    crossings: Sequence[Mapping[Method, Crossing]]
    fallback: str = ""
    quality: PoseQuality | None = None
    weights: Sequence[float | None] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """A detections file. repaired: gaps whose polygon was invalid and was made valid."""

    path: Path
    robot_frame: str
    fixed_frame: str | None
    log: str
    log_sha256: str
    configuration: Any
    frames: tuple[DetectedFrame, ...]
    repaired: int


def write_detections(
    file: IO[str],
    header: Mapping[str, Any],
    frames: Iterable[DetectedFrame],
) -> int:
    """Write frame by frame, so that memory holds only the gaps; returns the number of gaps.

    header: frame_id, fixed_frame and configuration. The log's hash is known only when all of it was read,
    so `header` is asked for `log` last.
    """
    features: list[str] = []
    file.write(OPENING)
    for number, frame in enumerate(frames):
        file.write((",\n" if number else "\n") + json.dumps(_frame_json(frame)))
        features += [json.dumps(feature) for feature in _features(frame)]
    file.write("\n],\n")
    for key in ("frame_id", "fixed_frame", "log", "configuration"):
        file.write(f"{json.dumps(key)}: {json.dumps(header[key])},\n")
    file.write(f'"gapeval": {json.dumps(__version__)},\n"features": [\n')
    file.write(",\n".join(features) + "\n]}\n")
    return len(features)


def read_detections(path: Path) -> Detections:
    """Raises DetectionsError that names what is wrong where."""
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise DetectionsError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise DetectionsError(f"{path}: not JSON: {error}; detections are GeoJSON") from error
    if not isinstance(document, dict) or document.get("type") != "FeatureCollection":
        raise DetectionsError(f"{path}: expected a GeoJSON FeatureCollection")
    if not isinstance(document.get("frames"), list):
        raise DetectionsError(f"{path}: no `frames`: a list of {{stamp, pose}}; gapeval detect writes it")
    if not isinstance(document.get("frame_id"), str):
        raise DetectionsError(f"{path}: no `frame_id`: the robot frame that the coordinates are in")
    features: dict[int, list[Any]] = {}
    place = "features"
    try:
        for index, feature in enumerate(document.get("features", [])):
            place = f"feature {index}"
            features.setdefault(int(feature["properties"]["stamp"]), []).append(feature)
        frames, repaired = [], 0
        seen: set[int] = set()
        for index, entry in enumerate(document["frames"]):
            place = f"frame {index}"
            stamp = int(entry["stamp"])
            if stamp in seen:
                raise ValueError(f"stamp {stamp} is there before")
            seen.add(stamp)
            frame, mended = _frame(entry, features.pop(stamp, []))
            frames.append(frame)
            repaired += mended
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError, ShapelyError) as error:
        what = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise DetectionsError(f"{path}: {place}: {what}") from error
    if features:
        raise DetectionsError(f"{path}: gaps at stamp {min(features)}, which is not among its `frames`")
    log: Any = document.get("log")
    if not isinstance(log, dict):
        log = {}
    return Detections(
        path=path,
        robot_frame=document["frame_id"].removeprefix("/"),
        fixed_frame=str(document["fixed_frame"]).removeprefix("/") if document.get("fixed_frame") else None,
        log=str(log.get("name", path.stem)),
        log_sha256=str(log.get("sha256", "")),
        configuration=document.get("configuration"),
        frames=tuple(sorted(frames, key=lambda frame: frame.stamp)),
        repaired=repaired,
    )


def _frame_json(frame: DetectedFrame) -> dict[str, Any]:
    pose = None
    if frame.pose is not None:
        translation, rotation = frame.pose.translation.tolist(), frame.pose.quaternion.tolist()
        pose = {"translation": translation, "rotation": rotation}
    plane = [frame.plane.a, frame.plane.b, frame.plane.c, frame.plane.d]
    quality = None
    if frame.quality is not None:
        values = asdict(frame.quality).items()
        quality = {name: value if math.isfinite(value) else None for name, value in values}
    return {
        "stamp": str(frame.stamp),
        "pose": pose,
        "pose_quality": quality,
        "plane": plane,
        "sensor": list(frame.origin),
        "plane_fallback": frame.fallback,
        "domain": None if frame.domain is None else geometry_json(frame.domain),
        "shadow": None if frame.shadow is None else geometry_json(frame.shadow),
    }


def _features(frame: DetectedFrame) -> Iterator[dict[str, Any]]:
    weights = frame.weights or [None] * len(frame.polygons)
    for index, (polygon, weight) in enumerate(zip(frame.polygons, weights, strict=True)):
        properties: dict[str, Any] = {"stamp": str(frame.stamp), "gap": index, "area": polygon.area}
        properties["weight"] = weight
        for method, crossing in frame.crossings[index].items():
            properties |= crossing_properties(method, crossing)
        yield {
            "type": "Feature",
            "properties": properties,
            "geometry": geometry_json(polygon, frame.gap_plane),
        }


def crossing_properties(method: Method, crossing: Crossing) -> dict[str, Any]:
    """A crossing as the properties of a feature, and as columns of gaps.csv."""
    values = {
        "traversable": crossing.traversable,
        "reason": crossing.reason,
        "length": crossing.length,
        "yaw": crossing.yaw,
        "centre": list(crossing.centre),
        "start": list(crossing.start),
        "end": list(crossing.end),
        "tie": crossing.tie,
    }
    return {f"{method}_{name}": value for name, value in values.items()}


def geometry_json(geometry: BaseGeometry, plane: Plane | None = None) -> dict[str, Any]:
    """A (Multi)Polygon as GeoJSON; on a plane, each vertex gets its z."""

    def ring(outline: BaseGeometry) -> list[list[float]]:
        places = shapely.get_coordinates(outline)
        rows = places if plane is None else np.column_stack([places, plane.height(places)])
        positions: list[list[float]] = rows.tolist()
        return positions

    polygons = [
        [ring(outline) for outline in shapely.get_rings(part)]
        for part in shapely.get_parts(geometry).tolist()
    ]
    if geometry.geom_type == "Polygon":
        return {"type": "Polygon", "coordinates": polygons[0]}
    return {"type": "MultiPolygon", "coordinates": polygons}


def _geometry(value: Any) -> BaseGeometry:
    if value.get("type") not in ("Polygon", "MultiPolygon"):
        raise ValueError(f"geometry is {value.get('type')}; expected Polygon or MultiPolygon")
    if not _all_finite(value["coordinates"]):
        raise ValueError("coordinates that are not finite numbers")
    geometry: BaseGeometry = shapely.force_2d(shapely.geometry.shape(value))
    return geometry


def _all_finite(values: Any) -> bool:
    """Whether nested lists hold nothing but finite numbers."""
    if isinstance(values, list):
        return all(_all_finite(value) for value in values)
    return isinstance(values, int | float) and math.isfinite(values)


def _region(value: Any) -> BaseGeometry | None:
    """A domain or shadow, made valid; None where there is none."""
    if not value:
        return None
    geometry = _geometry(value)
    if geometry.is_valid:
        return geometry
    return shapely.make_valid(geometry, method="structure", keep_collapsed=False)


def _plane(values: Any) -> Plane:
    """ax + by + cz + d = 0, brought to unit length and upright."""
    if values is None:
        return robot_plane(0.0)
    a, b, c, d = (float(value) for value in values)
    length = math.sqrt(a * a + b * b + c * c)
    if not math.isfinite(length + d) or abs(c) < 1e-6 * length or length == 0:
        raise ValueError(f"plane {values} is no ground: [a, b, c, d] with finite numbers, and c other than 0")
    if c > 0 and abs(length - 1) < 1e-12:  # as it was written, to the last bit
        return Plane(a, b, c, d)
    scale = math.copysign(1 / length, c)
    return Plane(a * scale, b * scale, c * scale, d * scale)


def _frame(entry: Any, features: list[Any]) -> tuple[DetectedFrame, int]:
    features = sorted(features, key=lambda feature: feature["properties"].get("gap", 0))
    polygons = np.array([None, *(_geometry(feature["geometry"]) for feature in features)], dtype=object)[1:]
    broken = ~shapely.is_valid(polygons)
    polygons[broken] = shapely.make_valid(polygons[broken], method="structure", keep_collapsed=False)
    pose = entry.get("pose")
    plane = _plane(entry.get("plane"))
    x, y = (float(value) for value in entry.get("sensor") or (0.0, 0.0))
    if not math.isfinite(x + y):
        raise ValueError("sensor at no finite place")
    return DetectedFrame(
        stamp=int(entry["stamp"]),
        pose=Transform.of(pose["translation"], pose["rotation"]) if pose else None,
        plane=plane,
        gap_plane=plane,
        domain=_region(entry.get("domain")),
        shadow=_region(entry.get("shadow")),
        origin=(x, y),
        polygons=polygons,
        crossings=[_crossings(index, feature["properties"]) for index, feature in enumerate(features)],
        fallback=str(entry.get("plane_fallback") or ""),
        quality=_quality(entry.get("pose_quality")),
        weights=[_weight(feature["properties"].get("weight")) for feature in features],
    ), int(broken.sum())


def _quality(values: Any) -> PoseQuality | None:
    """What a file says of a pose; NaN where it says nothing."""
    if values is None:
        return None
    known = {field.name: values.get(field.name) for field in fields(PoseQuality)}
    if not all(value is None or 0 <= float(value) < math.inf for value in known.values()):
        raise ValueError(f"pose_quality {values}: expected numbers of 0 or more")
    return PoseQuality(**{name: math.nan if value is None else float(value) for name, value in known.items()})


def _weight(value: Any) -> float | None:
    if value is not None and not 0 <= float(value) <= 1:
        raise ValueError(f"weight {value} is no probability")
    return None if value is None else float(value)


def _crossings(gap: int, properties: Mapping[str, Any]) -> dict[Method, Crossing]:
    """What a file says of crossing a gap; a method of which it does not say enough is left out."""
    found: dict[Method, Crossing] = {}
    for method in METHODS:
        values = {name: properties.get(f"{method}_{name}") for name in ("traversable", "length", "yaw")}
        if any(value is None for value in values.values()):
            continue
        spots = [properties.get(f"{method}_{name}") or (np.nan,) * 3 for name in ("centre", "start", "end")]
        (cx, cy, cz), (sx, sy, sz), (ex, ey, ez) = spots
        found[method] = Crossing(
            gap=gap,
            method=method,
            traversable=bool(values["traversable"]),
            reason=str(properties.get(f"{method}_reason") or ""),
            length=float(values["length"] or 0.0),
            yaw=float(values["yaw"] or 0.0),
            centre=(cx, cy, cz),
            start=(sx, sy, sz),
            end=(ex, ey, ez),
            tie=bool(properties.get(f"{method}_tie")),
        )
    return found
