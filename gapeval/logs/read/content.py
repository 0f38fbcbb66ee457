"""What a message says, by its topic's encoding and type.

Every function raises UndecodableError for a message that is not what its topic says it is; those of clouds
raise UnreadableCloudError for one that holds no points, or lies about itself.
"""

from typing import Literal

from gapeval.logs.read import ros_message
from gapeval.logs.read.cloud import NO_TIME, Points, UnreadableCloudError, cloud_points
from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.measurement import (
    Head,
    LaserScan,
    Orientation,
    StampedPose,
    StampedTransform,
    TimedPoints,
)
from gapeval.logs.read.message import (
    IMU,
    LASER_SCAN,
    MULTI_ECHO,
    POINT_CLOUD,
    POSE_TYPES,
    TF,
    UndecodableError,
    begins_with_header,
    decode,
    is_decodable,
)

__all__ = [
    "Head",
    "LaserScan",
    "Orientation",
    "Points",
    "Role",
    "StampedPose",
    "StampedTransform",
    "TimedPoints",
    "UndecodableError",
    "UnreadableCloudError",
    "cloud",
    "head",
    "head_suffices",
    "laser_scan",
    "orientation",
    "pose",
    "role_of",
    "timed_cloud",
    "transforms",
]

Role = Literal["cloud", "laser", "tf", "pose", "imu"]

_ROS_ROLES: dict[str, Role] = {
    POINT_CLOUD: "cloud",
    LASER_SCAN: "laser",
    MULTI_ECHO: "laser",
    IMU: "imu",
    **dict.fromkeys(TF, "tf"),
    **dict.fromkeys(POSE_TYPES, "pose"),
}


def role_of(topic: Topic) -> Role | None:
    """What a topic's messages are to gapeval; None where it cannot read them."""
    return _ROS_ROLES.get(topic.type) if is_decodable(topic) else None


def head(topic: Topic, raw: Raw) -> Head:
    """The stamp and frame of a cloud, scan, pose or IMU message.

    raw: may be cut to container.HEAD bytes where head_suffices(topic).
    """
    return ros_message.head(topic, raw)


def head_suffices(topic: Topic) -> bool:
    """Whether the stamp and frame are in the first bytes of a message."""
    return begins_with_header(topic)


def cloud(topic: Topic, raw: Raw) -> Points:
    return cloud_points(decode(topic, raw))


def timed_cloud(topic: Topic, raw: Raw) -> TimedPoints:
    """The points and when each was measured. Raises UnreadableCloudError, NO_TIME, where that is unknown."""
    raise UnreadableCloudError(NO_TIME)


def laser_scan(topic: Topic, raw: Raw) -> LaserScan:
    return ros_message.laser_scan(topic, raw)


def transforms(topic: Topic, raw: Raw) -> list[StampedTransform]:
    return ros_message.transforms(topic, raw)


def pose(topic: Topic, raw: Raw) -> StampedPose:
    return ros_message.pose(topic, raw)


def orientation(topic: Topic, raw: Raw) -> Orientation | None:
    """None where the message says that it has none."""
    return ros_message.orientation(topic, raw)
