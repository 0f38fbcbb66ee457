"""What Foxglove's types say: PointCloud, LaserScan, FrameTransform(s), PoseInFrame."""

import math
import re
from datetime import UTC, datetime
from typing import Any

import numpy as np

from gapeval.frame import FloatArray, Transform
from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages.cloud import FARTHEST, LIES, PackedCloud, PackedField, UnreadableCloudError
from gapeval.logs.read.messages.foxglove_message import (
    TRANSFORMS,
    data_bytes,
    decode_foxglove,
    foxglove_type,
)
from gapeval.logs.read.messages.measurement import Head, LaserScan, StampedPose, StampedTransform
from gapeval.logs.read.messages.message import UndecodableError, frame_of

# Foxglove's number of a type, or its name -> the number that ROS has for it
DATATYPES = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}
NAMES = ("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64")
MISFITS = (AttributeError, TypeError, ValueError, OverflowError, IndexError, KeyError)
LATEST = 1 << 62  # ns; differences of such stamps are int64 as well
INSTANT = re.compile(r"(\d{4}-\d\d-\d\d[Tt ]\d\d:\d\d:\d\d)(?:[.,](\d{1,9})\d*)?([Zz]|[+-]\d\d:?\d\d)?")


def head(topic: Topic, raw: Raw) -> Head:
    return _head(decode_foxglove(topic, raw))


def packed_cloud(topic: Topic, raw: Raw) -> PackedCloud:
    message = decode_foxglove(topic, raw)
    found = _head(message)
    try:
        data = np.frombuffer(data_bytes(message.data), np.uint8)
        fields = tuple(
            PackedField(str(item.name), _whole(item, "offset"), _datatype(getattr(item, "type", 0)))
            for item in message.fields
        )
        step, pose = _whole(message, "point_stride"), _transform(getattr(message, "pose", None))
    except MISFITS as error:
        raise UndecodableError(str(error)) from error
    if step <= 0 or len(data) % step:
        raise UnreadableCloudError(LIES, f"{len(data)} bytes are no whole points of {step}")
    return PackedCloud(
        stamp=found.stamp,
        frame=found.frame,
        height=1,
        width=len(data) // step,
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=len(data),
        data=data,
        pose=pose,
    )


def laser_scan(topic: Topic, raw: Raw) -> LaserScan:
    """Its angles are evenly spread from start_angle to end_angle; it says nothing of times and limits."""
    message = decode_foxglove(topic, raw)
    found = _head(message)
    try:
        ranges, intensities = _column(message, "ranges"), _column(message, "intensities")
        start, end = _number(message, "start_angle"), _number(message, "end_angle")
        return LaserScan(
            stamp=found.stamp,
            frame=found.frame,
            ranges=ranges,
            intensities=intensities if intensities.shape == ranges.shape else None,
            angle_min=start,
            angle_increment=(end - start) / max(1, len(ranges) - 1),
            time_increment=0.0,
            range_min=0.0,
            range_max=math.inf,
            pose=_transform(getattr(message, "pose", None)),
        )
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def transforms(topic: Topic, raw: Raw) -> list[StampedTransform]:
    message = decode_foxglove(topic, raw)
    try:
        items = message.transforms if foxglove_type(topic) == TRANSFORMS else [message]
        return [
            StampedTransform(
                stamp=_stamp(_given(item, "timestamp")),
                parent=frame_of(_text(item, "parent_frame_id")),
                child=frame_of(_named(item, "child_frame_id")),
                values=_values(getattr(item, "translation", None), getattr(item, "rotation", None)),
            )
            for item in items
        ]
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def pose(topic: Topic, raw: Raw) -> StampedPose:
    message = decode_foxglove(topic, raw)
    found = _head(message)
    try:
        return StampedPose(found.stamp, found.frame, "", _pose_values(_given(message, "pose")))
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def _head(message: Any) -> Head:
    try:
        return Head(_stamp(_given(message, "timestamp")), frame_of(_text(message, "frame_id")))
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def _stamp(time: Any) -> int:
    """Nanoseconds: {sec, nsec} in JSON, {sec, nanosec} in ROS, {seconds, nanos} in protobuf, or RFC 3339."""
    if isinstance(time, str):
        return _instant(time)
    for seconds, nanoseconds in (("sec", "nsec"), ("sec", "nanosec"), ("seconds", "nanos")):
        if hasattr(time, seconds) and hasattr(time, nanoseconds):
            return _bounded(int(getattr(time, seconds)) * 1_000_000_000 + int(getattr(time, nanoseconds)))
    raise ValueError("its timestamp is of no known form")


def _instant(text: str) -> int:
    found = INSTANT.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"its timestamp {text[:40]!r} is no RFC 3339")
    day, fraction, zone = found.groups()
    moment = datetime.fromisoformat(day.upper() + ("+00:00" if zone in (None, "Z", "z") else zone))
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    seconds = since.days * 86_400 + since.seconds
    return _bounded(seconds * 1_000_000_000 + int((fraction or "").ljust(9, "0")))


def _bounded(stamp: int) -> int:
    if abs(stamp) >= LATEST:
        raise ValueError(f"its timestamp is {stamp} ns")
    return stamp


def _given(message: Any, name: str) -> Any:
    """A message in it that must be there; protobuf has an empty one where there is none."""
    value = getattr(message, name, None)
    if value is None or (hasattr(message, "HasField") and not message.HasField(name)):
        raise ValueError(f"it has no {name}")
    return value


def _transform(pose: Any) -> Transform | None:
    """frame<-points of a message's pose; None where it is not given, or changes nothing."""
    values = _pose_values(pose)
    return None if values == (0, 0, 0, 0, 0, 0, 1) else Transform.of(values[:3], values[3:])


def _pose_values(pose: Any) -> tuple[float, ...]:
    return _values(getattr(pose, "position", None), getattr(pose, "orientation", None))


def _values(place: Any, turn: Any) -> tuple[float, ...]:
    """x, y, z and a quaternion x, y, z, w, which is the one that turns nothing where it is left out."""
    translation = tuple(_number(place, name) for name in "xyz")
    quaternion = tuple(_number(turn, name) for name in "xyzw")
    values = (*translation, *(quaternion if any(quaternion) else (0.0, 0.0, 0.0, 1.0)))
    if not all(abs(value) < FARTHEST for value in values):
        raise ValueError(f"its pose is no place: {values}")
    return values


def _number(message: Any, name: str) -> float:
    """Zeros may be left out."""
    if isinstance(message, str | float | int | list):
        raise TypeError(f"{str(message)[:40]!r} has no {name}")
    value = getattr(message, name, 0.0)
    return float(0.0 if value is None else value)


def _whole(message: Any, name: str) -> int:
    return int(_number(message, name))


def _text(message: Any, name: str) -> str:
    value = getattr(message, name, "")
    if not isinstance(value, str):
        raise TypeError(f"its {name} is no text")
    return value


def _named(message: Any, name: str) -> str:
    """A text that must not be empty."""
    text = _text(message, name)
    if not text:
        raise ValueError(f"it has no {name}")
    return text


def _column(message: Any, name: str) -> FloatArray:
    values = getattr(message, name, None)
    numbers = [] if values is None else [math.nan if v is None else v for v in values]
    return np.array(numbers, dtype=np.float64).reshape(-1, 1)


def _datatype(kind: Any) -> int:
    number = NAMES.index(kind) if isinstance(kind, str) and kind in NAMES else int(kind)
    return DATATYPES.get(number, 0)
