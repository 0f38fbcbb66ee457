"""Messages of ROS -> what they say."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gapeval.frame import FloatArray
from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages.cloud import PackedCloud, PackedField
from gapeval.logs.read.messages.measurement import Head, LaserScan, Orientation, StampedPose, StampedTransform
from gapeval.logs.read.messages.message import (
    MULTI_ECHO,
    UndecodableError,
    begins_with_header,
    decode,
    frame_of,
    is_stock,
    stamp_of,
)
from gapeval.logs.read.messages.ros_bytes import NotSuchBytesError, read_head, read_transforms

# What is no dataclass of the expected fields, or holds numbers of another kind than expected.
MISFITS = (AttributeError, TypeError, ValueError, OverflowError)


def head(topic: Topic, raw: Raw) -> Head:
    if not begins_with_header(topic):
        return head_of(decode(topic, raw))
    try:
        return read_head(raw, topic.serialization)
    except NotSuchBytesError as error:
        raise UndecodableError(str(error)) from error


def head_of(message: Any) -> Head:
    """Of a decoded message."""
    try:
        return Head(stamp_of(message.header), frame_of(message.header.frame_id))
    except MISFITS as error:
        raise UndecodableError(f"no header: {error}") from error


def transforms(topic: Topic, raw: Raw) -> list[StampedTransform]:
    if is_stock(topic):
        try:
            return read_transforms(raw, topic.serialization)
        except NotSuchBytesError as error:
            raise UndecodableError(str(error)) from error
    try:
        return [_transform(item) for item in decode(topic, raw).transforms]
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def pose(topic: Topic, raw: Raw) -> StampedPose:
    """Of Odometry, PoseStamped or PoseWithCovarianceStamped."""
    message = decode(topic, raw)
    found = head_of(message)
    try:
        inner = getattr(message.pose, "pose", message.pose)
        t, q = inner.position, inner.orientation
        child = frame_of(getattr(message, "child_frame_id", ""))
        covariance = sound_covariance(getattr(message.pose, "covariance", ()))
        values = (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
        return StampedPose(found.stamp, found.frame, child, tuple(map(float, values)), covariance)
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def orientation(topic: Topic, raw: Raw) -> Orientation | None:
    message = decode(topic, raw)
    found = head_of(message)
    try:
        q = message.orientation
        quaternion = (float(q.x), float(q.y), float(q.z), float(q.w))
        has_none = float(message.orientation_covariance[0]) == -1 or not any(quaternion)
    except (*MISFITS, IndexError) as error:
        raise UndecodableError(str(error)) from error
    return None if has_none else Orientation(found.stamp, found.frame, quaternion)


def packed_cloud(topic: Topic, raw: Raw) -> PackedCloud:
    """A PointCloud2."""
    message = decode(topic, raw)
    found = head_of(message)
    try:
        return PackedCloud(
            stamp=found.stamp,
            frame=found.frame,
            height=int(message.height),
            width=int(message.width),
            fields=tuple(
                PackedField(str(f.name), int(f.offset), int(f.datatype), int(f.count)) for f in message.fields
            ),
            is_bigendian=bool(message.is_bigendian),
            point_step=int(message.point_step),
            row_step=int(message.row_step),
            data=np.asarray(message.data),
        )
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def laser_scan(topic: Topic, raw: Raw) -> LaserScan:
    message = decode(topic, raw)
    found = head_of(message)
    columns = _echoes if topic.type == MULTI_ECHO else _single
    try:
        ranges = columns(message.ranges)
        intensities = columns(message.intensities)
        return LaserScan(
            stamp=found.stamp,
            frame=found.frame,
            ranges=ranges,
            intensities=intensities if intensities.shape == ranges.shape else None,
            angle_min=float(message.angle_min),
            angle_increment=float(message.angle_increment),
            time_increment=float(message.time_increment),
            range_min=float(message.range_min),
            range_max=float(message.range_max),
        )
    except MISFITS as error:
        raise UndecodableError(str(error)) from error


def sound_covariance(values: Any) -> tuple[float, ...] | None:
    """36 numbers, or None where they say nothing."""
    matrix = np.asarray(values, dtype=np.float64).reshape(-1)
    if matrix.shape != (36,) or not np.isfinite(matrix).all() or not matrix.any() or (matrix[::7] < 0).any():
        return None
    return tuple(matrix.tolist())


def _transform(item: Any) -> StampedTransform:
    t, q = item.transform.translation, item.transform.rotation
    values = tuple(map(float, (t.x, t.y, t.z, q.x, q.y, q.z, q.w)))
    return StampedTransform(
        stamp_of(item.header), frame_of(item.header.frame_id), frame_of(item.child_frame_id), values
    )


def _single(values: Any) -> FloatArray:
    # A NaN that signals is NaN like any other.
    with np.errstate(invalid="ignore"):
        return np.asarray(values, dtype=np.float64).reshape(-1, 1)


def _echoes(beams: Sequence[Any]) -> FloatArray:
    """(n, e), filled with NaN where a beam has fewer echoes than others; e is at least 1."""
    lengths = np.array([len(beam.echoes) for beam in beams], dtype=np.intp)
    columns = max(1, int(lengths.max(initial=0)))
    # Rows of one length fill the array at once; a mask puts the rest where it belongs.
    out = np.full((len(beams), columns), np.nan)
    if len(beams):
        with np.errstate(invalid="ignore"):
            out[np.arange(columns) < lengths[:, None]] = np.concatenate([beam.echoes for beam in beams])
    return out
