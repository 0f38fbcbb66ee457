"""What is shown beside a log in RViz or Foxglove: markers and coloured clouds, and the MCAP file of them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from gapeval.errors import GapevalError
from gapeval.files import whole_stream
from gapeval.frame import FloatArray
from gapeval.logs.write.message import FLOAT32, POINT_CLOUD, UINT32, header_of, ros2_types

MARKERS, MARKER = "visualization_msgs/msg/MarkerArray", "visualization_msgs/msg/Marker"
ARROW, LINES, TEXT, TRIANGLES = 0, 5, 9, 11  # of visualization_msgs/Marker
ADD, DELETE_ALL = 0, 3
UINT8 = 2  # of sensor_msgs/PointField
PROFILE, LIBRARY = "ros2", "gapeval detect"

Colour = tuple[float, float, float, float]  # red, green, blue, alpha, 0 to 1


@dataclass(frozen=True, slots=True, eq=False)
class Marker:
    """kind: ARROW, LINES, TEXT or TRIANGLES. points: (N, 3) [m], of its own frame; one, where a text stands.

    size: as RViz has it [m]: of lines the width; of an arrow shaft, head and its length; of a text z.
    """

    group: str
    number: int
    kind: int
    frame_id: str
    points: FloatArray
    colour: Colour
    size: tuple[float, float, float]
    text: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Markers:
    """All markers of a topic at a stamp [ns]: those of the stamp before go. frame_id: of none of them."""

    stamp: int
    topic: str
    frame_id: str
    markers: Sequence[Marker]

    type: ClassVar[str] = MARKERS


@dataclass(frozen=True, slots=True, eq=False)
class ColouredCloud:
    """points: (N, 3) float32 in frame_id [m]; rgb: (N,) 0x00rrggbb; kinds: (N,), the field `class`."""

    stamp: int
    topic: str
    frame_id: str
    points: NDArray[np.float32]
    rgb: NDArray[np.uint32]
    kinds: NDArray[np.uint8]

    type: ClassVar[str] = POINT_CLOUD


Shown = Markers | ColouredCloud


def require_display(path: Path) -> None:
    """Raises GapevalError rather than replace a log, or anything else that `display` did not write."""
    if path.is_dir():
        raise GapevalError(f"{path}: is a folder; name a file with --mcap")
    if path.exists():
        with path.open("rb") as file:
            if not file.read(len(_OPENING)) == _OPENING:
                raise GapevalError(
                    f"{path}: exists and is not what detect --mcap writes; name another with --mcap"
                )


@contextmanager
def display(path: Path) -> Iterator[Callable[[Shown], None]]:
    """An MCAP file, whole or not there; what is yielded adds a message, in the order of stamps."""
    store = ros2_types()
    with whole_stream(path) as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile=PROFILE, library=LIBRARY)
        channels: dict[str, int] = {}

        def add(shown: Shown) -> None:
            if shown.topic not in channels:
                definition, _ = store.generate_msgdef(shown.type, ros_version=2)
                schema = writer.register_schema(shown.type, "ros2msg", definition.encode())
                # Without it, `ros2 bag play` does not know how to offer the topic.
                about = {"offered_qos_profiles": ""}
                channels[shown.topic] = writer.register_channel(shown.topic, "cdr", schema, about)
            message = _markers(store, shown) if isinstance(shown, Markers) else _cloud(store, shown)
            raw = bytes(store.serialize_cdr(message, shown.type))
            writer.add_message(channels[shown.topic], shown.stamp, raw, shown.stamp)

        yield add
        writer.finish()  # type: ignore[no-untyped-call]


def _text(text: str) -> bytes:
    return len(text).to_bytes(4, "little") + text.encode()


# Magic, and the header record: opcode, length, profile, library.
_HEADER = _text(PROFILE) + _text(LIBRARY)
_OPENING = b"\x89MCAP0\r\n\x01" + len(_HEADER).to_bytes(8, "little") + _HEADER


def _markers(store: Typestore, shown: Markers) -> Any:
    point = np.zeros((1, 3))
    clear = Marker("", 0, ARROW, shown.frame_id, point[:0], (0, 0, 0, 0), (0, 0, 0))
    found = [_marker(store, shown.stamp, clear, DELETE_ALL)]
    found += [_marker(store, shown.stamp, marker, ADD) for marker in shown.markers]
    return store.types[MARKERS](markers=found)


def _marker(store: Typestore, stamp: int, marker: Marker, action: int) -> Any:
    make = store.types
    point, vector = make["geometry_msgs/msg/Point"], make["geometry_msgs/msg/Vector3"]
    places = marker.points.tolist()
    x, y, z = places.pop() if marker.kind == TEXT else (0.0, 0.0, 0.0)
    # Of fields that these kinds of markers do not have.
    none = make["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    no_header = make["std_msgs/msg/Header"](stamp=none, frame_id="")
    no_bytes = np.empty(0, dtype=np.uint8)
    red, green, blue, alpha = map(float, marker.colour)
    return make[MARKER](
        header=header_of(store, stamp, marker.frame_id),
        ns=marker.group,
        id=marker.number,
        type=marker.kind,
        action=action,
        pose=make["geometry_msgs/msg/Pose"](
            position=point(x=x, y=y, z=z),
            orientation=make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        ),
        scale=vector(**dict(zip("xyz", map(float, marker.size), strict=True))),
        color=make["std_msgs/msg/ColorRGBA"](r=red, g=green, b=blue, a=alpha),
        lifetime=make["builtin_interfaces/msg/Duration"](sec=0, nanosec=0),
        frame_locked=False,
        points=[point(x=x, y=y, z=z) for x, y, z in places],
        colors=[],
        texture_resource="",
        texture=make["sensor_msgs/msg/CompressedImage"](header=no_header, format="", data=no_bytes),
        uv_coordinates=[],
        text=marker.text,
        mesh_resource="",
        mesh_file=make["visualization_msgs/msg/MeshFile"](filename="", data=no_bytes),
        mesh_use_embedded_materials=False,
    )


def _cloud(store: Typestore, cloud: ColouredCloud) -> Any:
    field = store.types["sensor_msgs/msg/PointField"]
    layout = [(name, 4 * i, FLOAT32) for i, name in enumerate("xyz")]
    layout += [("rgb", 12, UINT32), ("class", 16, UINT8)]
    rows = np.empty(len(cloud.points), dtype=[("xyz", "<f4", 3), ("rgb", "<u4"), ("class", "u1")])
    rows["xyz"], rows["rgb"], rows["class"] = cloud.points, cloud.rgb, cloud.kinds
    step = rows.dtype.itemsize
    return store.types[POINT_CLOUD](
        header=header_of(store, cloud.stamp, cloud.frame_id),
        height=1,
        width=len(rows),
        fields=[field(name=name, offset=offset, datatype=kind, count=1) for name, offset, kind in layout],
        is_bigendian=False,
        point_step=step,
        row_step=step * len(rows),
        data=rows.view(np.uint8),
        is_dense=True,
    )
