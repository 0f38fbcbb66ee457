"""What a message says, by its topic's encoding and type.

Every function raises UndecodableError for a message that is not what its topic says it is; those of clouds
raise UnreadableCloudError for one that holds no points, or lies about itself.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from gapeval.frame import Transform
from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages import cloud_file, file_message, foxglove, ros_message
from gapeval.logs.read.messages.cloud import PackedCloud, Points, UnreadableCloudError, cloud_points
from gapeval.logs.read.messages.foxglove_message import (
    CLOUD,
    POSE,
    SCAN,
    TRANSFORM,
    TRANSFORMS,
    foxglove_type,
)
from gapeval.logs.read.messages.livox import livox_cloud
from gapeval.logs.read.messages.measurement import (
    Head,
    LaserScan,
    Orientation,
    StampedPose,
    StampedTransform,
    TimedPoints,
)
from gapeval.logs.read.messages.message import (
    IMU,
    LASER_SCAN,
    LIVOX,
    MULTI_ECHO,
    POINT_CLOUD,
    POSE_TYPES,
    TF,
    UndecodableError,
    begins_with_header,
    is_decodable,
)
from gapeval.logs.read.messages.point_time import TimeField, timed_points

__all__ = [
    "Head",
    "LaserScan",
    "Orientation",
    "Points",
    "Role",
    "StampedPose",
    "StampedTransform",
    "TimeField",
    "TimedPoints",
    "UndecodableError",
    "UnreadableCloudError",
    "cloud",
    "head",
    "head_suffices",
    "laser_scan",
    "orientation",
    "packed_cloud",
    "pose",
    "role_of",
    "time_field",
    "timed_cloud",
    "transforms",
]

FILES = (*file_message.CLOUDS, file_message.POSES)
Role = Literal["cloud", "laser", "tf", "pose", "imu"]

_ROLES: dict[str, Role] = {
    POINT_CLOUD: "cloud",
    **dict.fromkeys(LIVOX, "cloud"),
    LASER_SCAN: "laser",
    MULTI_ECHO: "laser",
    IMU: "imu",
    **dict.fromkeys(TF, "tf"),
    **dict.fromkeys(POSE_TYPES, "pose"),
}
_FOXGLOVE_ROLES: dict[str, Role] = {
    CLOUD: "cloud",
    SCAN: "laser",
    POSE: "pose",
    TRANSFORM: "tf",
    TRANSFORMS: "tf",
}


def role_of(topic: Topic) -> Role | None:
    """What a topic's messages are to gapeval; None where it cannot read them."""
    if topic.serialization in FILES:
        return "pose" if topic.serialization == file_message.POSES else "cloud"
    kind = foxglove_type(topic)
    if kind is not None:
        return _FOXGLOVE_ROLES[kind]
    return _ROLES.get(topic.type) if is_decodable(topic) else None


def head(topic: Topic, raw: Raw) -> Head:
    """The stamp and frame of a cloud, scan, pose or IMU message.

    raw: may be cut to container.HEAD bytes where head_suffices(topic).
    """
    if topic.serialization in FILES:
        return file_message.head(raw)
    return foxglove.head(topic, raw) if foxglove_type(topic) else ros_message.head(topic, raw)


def head_suffices(topic: Topic) -> bool:
    """Whether the stamp and frame are in the first bytes of a message."""
    return topic.serialization in FILES or begins_with_header(topic)


def packed_cloud(topic: Topic, raw: Raw) -> PackedCloud:
    """The cloud as it stands in its message; nothing of it is checked yet."""
    if topic.serialization in FILES:
        return cloud_file.packed_cloud(topic, raw)
    if foxglove_type(topic):
        return foxglove.packed_cloud(topic, raw)
    return livox_cloud(topic, raw) if topic.type in LIVOX else ros_message.packed_cloud(topic, raw)


def cloud(topic: Topic, raw: Raw) -> Points:
    packed = packed_cloud(topic, raw)
    return _placed(packed.pose, cloud_points(packed))


def timed_cloud(topic: Topic, raw: Raw) -> TimedPoints:
    """The points and when each was measured. Raises UnreadableCloudError, NO_TIME, where that is unknown."""
    packed = packed_cloud(topic, raw)
    timed, _ = timed_points(packed)
    return replace(timed, points=_placed(packed.pose, timed.points))


def time_field(topic: Topic, raw: Raw) -> TimeField:
    """Where a cloud has the times of its points. Raises UnreadableCloudError, as timed_cloud."""
    return timed_points(packed_cloud(topic, raw))[1]


def laser_scan(topic: Topic, raw: Raw) -> LaserScan:
    return foxglove.laser_scan(topic, raw) if foxglove_type(topic) else ros_message.laser_scan(topic, raw)


def transforms(topic: Topic, raw: Raw) -> list[StampedTransform]:
    return foxglove.transforms(topic, raw) if foxglove_type(topic) else ros_message.transforms(topic, raw)


def pose(topic: Topic, raw: Raw) -> StampedPose:
    if topic.serialization == file_message.POSES:
        return file_message.pose(raw)
    return foxglove.pose(topic, raw) if foxglove_type(topic) else ros_message.pose(topic, raw)


def orientation(topic: Topic, raw: Raw) -> Orientation | None:
    """None where the message says that it has none."""
    return ros_message.orientation(topic, raw)


def _placed(pose: Transform | None, points: Points) -> Points:
    """Points of a cloud that has a pose of its own, in the cloud's frame."""
    return points if pose is None else replace(points, xyz=pose.apply(points.xyz.astype(np.float64)))
