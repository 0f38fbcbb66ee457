"""What is written: clouds and transforms, and their ROS messages."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from gapeval.frame import Transform

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
TF = "tf2_msgs/msg/TFMessage"
TF_TOPIC, TF_STATIC = "/tf", "/tf_static"
FLOAT32 = 7  # of sensor_msgs/PointField


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """stamp [ns]; points: (N, 3) float32, in frame_id [m]."""

    stamp: int
    topic: str
    frame_id: str
    points: NDArray[np.float32]

    type: ClassVar[str] = POINT_CLOUD


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


Message = Cloud | Links


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
    return store.types[TF](transforms=[_link(store, message.stamp, link) for link in message.links])


def _cloud(store: Typestore, cloud: Cloud) -> Any:
    points = np.ascontiguousarray(cloud.points, dtype="<f4")
    field = store.types["sensor_msgs/msg/PointField"]
    return store.types[POINT_CLOUD](
        header=_header(store, cloud.stamp, cloud.frame_id),
        height=1,
        width=len(points),
        fields=[field(name=name, offset=4 * i, datatype=FLOAT32, count=1) for i, name in enumerate("xyz")],
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=points.reshape(-1).view(np.uint8),
        is_dense=True,
    )


def _link(store: Typestore, stamp: int, link: Link) -> Any:
    make = store.types
    x, y, z = link.transform.translation.tolist()
    qx, qy, qz, qw = link.transform.quaternion.tolist()
    return make["geometry_msgs/msg/TransformStamped"](
        header=_header(store, stamp, link.parent),
        child_frame_id=link.child,
        transform=make["geometry_msgs/msg/Transform"](
            translation=make["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
            rotation=make["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
        ),
    )


def _header(store: Typestore, stamp: int, frame_id: str) -> Any:
    kind: Any = store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    ros1 = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
    return kind(stamp=time, frame_id=frame_id, **ros1)
