"""What is written: clouds and transforms, and their ROS messages."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from gapeval.frame import Transform

POINT_CLOUD, LASER_SCAN = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/LaserScan"
TF = "tf2_msgs/msg/TFMessage"
TF_TOPIC, TF_STATIC = "/tf", "/tf_static"
FLOAT32, UINT32 = 7, 6  # of sensor_msgs/PointField


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """stamp [ns]; points: (N, 3) float32, in frame_id [m].

    nanoseconds: (N,) uint32, when each point was measured after the stamp; None where that is not said.
    """

    stamp: int
    topic: str
    frame_id: str
    points: NDArray[np.float32]
    nanoseconds: NDArray[np.uint32] | None = None

    type: ClassVar[str] = POINT_CLOUD


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """A planar scan. stamp: of its first beam [ns]; ranges: (beams,) float32 [m].

    angles: first and last, and the step from beam to beam [rad]. beam_period: from beam to beam, scan_period:
    from scan to scan [s]. limits: least and greatest range that counts as measured [m].
    """

    stamp: int
    topic: str
    frame_id: str
    ranges: NDArray[np.float32]
    angles: tuple[float, float, float]
    beam_period: float
    scan_period: float
    limits: tuple[float, float]

    type: ClassVar[str] = LASER_SCAN


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """parent<-child."""

    parent: str
    child: str
    transform: Transform


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Transforms of one stamp [ns], for /tf or /tf_static."""

    stamp: int
    links: tuple[Link, ...]
    is_static: bool

    type: ClassVar[str] = TF

    @property
    def topic(self) -> str:
        return TF_STATIC if self.is_static else TF_TOPIC


Message = Cloud | Scan | Links


def ros1_types() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def ros2_types() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)


def ros_message(store: Typestore, message: Message) -> Any:
    """The message of a typestore's own types."""
    if isinstance(message, Cloud):
        return _cloud(store, message)
    if isinstance(message, Scan):
        return _scan(store, message)
    return store.types[TF](transforms=[_link(store, message.stamp, link) for link in message.links])


def _cloud(store: Typestore, cloud: Cloud) -> Any:
    layout = [(name, 4 * i, FLOAT32) for i, name in enumerate("xyz")]
    rows = np.ascontiguousarray(cloud.points, dtype="<f4").view("<u4")
    if cloud.nanoseconds is not None:
        layout.append(("t", 12, UINT32))
        rows = np.column_stack([rows, cloud.nanoseconds.astype("<u4")])
    field = store.types["sensor_msgs/msg/PointField"]
    step = 4 * len(layout)
    return store.types[POINT_CLOUD](
        header=header_of(store, cloud.stamp, cloud.frame_id),
        height=1,
        width=len(rows),
        fields=[field(name=name, offset=offset, datatype=kind, count=1) for name, offset, kind in layout],
        is_bigendian=False,
        point_step=step,
        row_step=step * len(rows),
        data=rows.reshape(-1).view(np.uint8),
        is_dense=True,
    )


def _scan(store: Typestore, scan: Scan) -> Any:
    first, last, step = scan.angles
    low, high = scan.limits
    return store.types[LASER_SCAN](
        header=header_of(store, scan.stamp, scan.frame_id),
        angle_min=first,
        angle_max=last,
        angle_increment=step,
        time_increment=scan.beam_period,
        scan_time=scan.scan_period,
        range_min=low,
        range_max=high,
        ranges=np.ascontiguousarray(scan.ranges, dtype="<f4"),
        intensities=np.empty(0, dtype="<f4"),
    )


def _link(store: Typestore, stamp: int, link: Link) -> Any:
    make = store.types
    x, y, z = link.transform.translation.tolist()
    qx, qy, qz, qw = link.transform.quaternion.tolist()
    return make["geometry_msgs/msg/TransformStamped"](
        header=header_of(store, stamp, link.parent),
        child_frame_id=link.child,
        transform=make["geometry_msgs/msg/Transform"](
            translation=make["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
            rotation=make["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
        ),
    )


def header_of(store: Typestore, stamp: int, frame_id: str) -> Any:
    kind: Any = store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    ros1 = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
    return kind(stamp=time, frame_id=frame_id, **ros1)
