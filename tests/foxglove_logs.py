"""Foxglove's messages for tests: as protobuf by its own library, and the same as JSON and as ROS messages."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_protobuf.writer import Writer as ProtobufWriter

from gapeval.logs.read.container import Topic

HERE = (0, 0, 0, 1)
# Foxglove's numbers of types
CODES = {"u1": 1, "i1": 2, "u2": 3, "i2": 4, "u4": 5, "i4": 6, "f4": 7, "f8": 8}


def stamped(message: Any, stamp: int) -> Any:
    message.timestamp.FromNanoseconds(stamp)
    return message


def set_pose(target: Any, translation: Any, quaternion: Any) -> None:
    place, turn = target.position, target.orientation
    place.x, place.y, place.z = map(float, translation)
    turn.x, turn.y, turn.z, turn.w = map(float, quaternion)


def cloud(stamp: int, points: Any, frame: str = "lidar", pose: Any = None) -> Any:
    """A PointCloud of rows of a structured array, or of points (n, 3)."""
    rows = np.asarray(points)
    if rows.dtype.names is None:
        plain = np.zeros(len(rows), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
        for i, name in enumerate("xyz"):
            plain[name] = rows[:, i]
        rows = plain
    message = stamped(
        PointCloud(frame_id=frame, point_stride=rows.dtype.itemsize, data=rows.tobytes()), stamp
    )
    for name, (dtype, offset) in rows.dtype.fields.items():
        message.fields.append(PackedElementField(name=name, offset=offset, type=CODES[dtype.str[1:]]))
    if pose is not None:
        set_pose(message.pose, *pose)
    return message


def scan(stamp: int, ranges: Any, start: float, end: float, pose: Any = None, intensities: Any = ()) -> Any:
    message = LaserScan(
        frame_id="laser", ranges=ranges, intensities=intensities, start_angle=start, end_angle=end
    )
    if pose is not None:
        set_pose(message.pose, *pose)
    return stamped(message, stamp)


def transform(stamp: int, parent: str, child: str, translation: Any, quaternion: Any = HERE) -> Any:
    message = FrameTransform(parent_frame_id=parent, child_frame_id=child)
    message.translation.x, message.translation.y, message.translation.z = map(float, translation)
    turn = message.rotation
    turn.x, turn.y, turn.z, turn.w = map(float, quaternion)
    return stamped(message, stamp)


def transforms(*items: Any) -> Any:
    return FrameTransforms(transforms=items)


def pose(stamp: int, frame: str, translation: Any, quaternion: Any = HERE) -> Any:
    message = PoseInFrame(frame_id=frame)
    set_pose(message.pose, translation, quaternion)
    return stamped(message, stamp)


def as_json(message: Any) -> Any:
    """As Foxglove's JSON schemas have it: base64, {sec, nsec}, numbers of types."""
    return _plain(message)


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if not hasattr(value, "DESCRIPTOR"):
        return value if isinstance(value, (str, int, float)) else [_plain(item) for item in value]
    if value.DESCRIPTOR.name == "Timestamp":
        return {"sec": value.seconds, "nsec": value.nanos}
    return {
        found.name: _plain(getattr(value, found.name))
        for found in value.DESCRIPTOR.fields
        if found.message_type is None or found.is_repeated or value.HasField(found.name)
    }


def topic_of(message: Any, encoding: str) -> tuple[Topic, bytes]:
    """A message and its topic, as they come out of a log."""
    kind = message.DESCRIPTOR.full_name
    if encoding == "json":
        return Topic("/topic", kind, 1, "json"), json.dumps(as_json(message)).encode()
    schema = build_file_descriptor_set(type(message)).SerializeToString()
    return Topic("/topic", kind, 1, "protobuf", schema=schema), message.SerializeToString()


def write(path: Path, messages: Any, encoding: str = "protobuf") -> Path:
    """messages: (topic, bag time, message), by the library itself, or as JSON."""
    if encoding == "protobuf":
        with path.open("wb") as stream, ProtobufWriter(stream) as writer:
            for topic, time, message in messages:
                writer.write_message(topic, message, log_time=time, publish_time=time)
        return path
    writer = McapWriter(str(path))
    writer.start(profile="", library="gapeval tests")
    channels: dict[str, int] = {}
    for topic, time, message in messages:
        if topic not in channels:
            kind = message.DESCRIPTOR.full_name
            schema = writer.register_schema(kind, "jsonschema", json.dumps({"type": "object"}).encode())
            channels[topic] = writer.register_channel(topic, "json", schema)
        writer.add_message(channels[topic], time, json.dumps(as_json(message)).encode(), time)
    writer.finish()
    return path
