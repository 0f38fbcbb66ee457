"""Raw messages -> decoded ones, by the log's own definition or else by the stock one."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from gapeval.logs.read.container import Raw, Topic

POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
LASER_SCAN = "sensor_msgs/msg/LaserScan"
MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
IMU = "sensor_msgs/msg/Imu"
LIVOX = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
POSE_TYPES = (ODOMETRY, POSE, POSE_WITH_COVARIANCE)
TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

# Types that are not among rosbags' own, by their definitions.
_LIVOX = {
    "CustomMsg": (
        "std_msgs/Header header",
        "uint64 timebase",
        "uint32 point_num",
        "uint8 lidar_id",
        "uint8[3] rsvd",
        "CustomPoint[] points",
    ),
    "CustomPoint": (
        "uint32 offset_time",
        *(f"float32 {name}" for name in "xyz"),
        *(f"uint8 {name}" for name in ("reflectivity", "tag", "line")),
    ),
}
_FOXGLOVE_BEGIN = ("builtin_interfaces/Time timestamp", "string frame_id", "geometry_msgs/Pose pose")
_FOXGLOVE = {
    "PointCloud": (*_FOXGLOVE_BEGIN, "uint32 point_stride", "PackedElementField[] fields", "uint8[] data"),
    "PackedElementField": ("string name", "uint32 offset", "uint8 type"),
    "LaserScan": (
        *_FOXGLOVE_BEGIN,
        "float64 start_angle",
        "float64 end_angle",
        "float64[] ranges",
        "float64[] intensities",
    ),
    "PoseInFrame": _FOXGLOVE_BEGIN,
    "FrameTransform": (
        "builtin_interfaces/Time timestamp",
        "string parent_frame_id",
        "string child_frame_id",
        "geometry_msgs/Vector3 translation",
        "geometry_msgs/Quaternion rotation",
    ),
    "FrameTransforms": ("FrameTransform[] transforms",),
}
STOCK: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(TF, ("geometry_msgs/TransformStamped[] transforms",)),
    **{kind.replace("CustomMsg", name): lines for kind in LIVOX for name, lines in _LIVOX.items()},
    **{f"foxglove_msgs/msg/{name}": lines for name, lines in _FOXGLOVE.items()},
}
FOXGLOVE = tuple(f"foxglove_msgs/msg/{name}" for name in _FOXGLOVE if name != "PackedElementField")

_LASER = frozenset(
    {
        "header",
        "angle_min",
        "angle_increment",
        "time_increment",
        "range_min",
        "range_max",
        "ranges",
        "intensities",
    }
)
# What is read of each type; a definition in the log that has one of these otherwise than ROS is not believed.
NEEDED: dict[str, frozenset[str]] = {
    POINT_CLOUD: frozenset(
        {"header", "height", "width", "fields", "is_bigendian", "point_step", "row_step", "data"}
    ),
    LASER_SCAN: _LASER,
    MULTI_ECHO: _LASER,
    IMU: frozenset({"header", "orientation", "orientation_covariance"}),
    ODOMETRY: frozenset({"header", "child_frame_id", "pose"}),
    POSE: frozenset({"header", "pose"}),
    POSE_WITH_COVARIANCE: frozenset({"header", "pose"}),
    **dict.fromkeys(TF, frozenset({"transforms"})),
    **{
        f"foxglove_msgs/msg/{name}": frozenset(line.split()[1] for line in lines)
        for name, lines in _FOXGLOVE.items()
    },
    "std_msgs/msg/Header": frozenset({"stamp", "frame_id"}),
    "sensor_msgs/msg/LaserEcho": frozenset({"echoes"}),
    "sensor_msgs/msg/PointField": frozenset({"name", "offset", "datatype", "count"}),
    "geometry_msgs/msg/TransformStamped": frozenset({"header", "child_frame_id", "transform"}),
    "geometry_msgs/msg/Transform": frozenset({"translation", "rotation"}),
    "geometry_msgs/msg/PoseWithCovariance": frozenset({"pose"}),
    "geometry_msgs/msg/Pose": frozenset({"position", "orientation"}),
    "geometry_msgs/msg/Vector3": frozenset("xyz"),
    "geometry_msgs/msg/Point": frozenset("xyz"),
    "geometry_msgs/msg/Quaternion": frozenset("xyzw"),
}
HEADER = "std_msgs/msg/Header"
READ = (POINT_CLOUD, LASER_SCAN, MULTI_ECHO, IMU, *LIVOX, *POSE_TYPES, *TF, *FOXGLOVE)
SERIALIZATIONS = ("ros1", "cdr")

Decode = Callable[[Raw], Any]


class UndecodableError(Exception):
    """A message that does not hold what its definition says."""


def decode(topic: Topic, raw: Raw) -> Any:
    """The message as a dataclass of rosbags; its arrays are views of the raw bytes.

    Raises UndecodableError for a message that is cut, or not of the topic's type.
    """
    if not is_decodable(topic):
        raise UndecodableError(f"{topic.serialization} {topic.type}")
    decoder = _decoder(topic.type, topic.serialization, topic.syntax, topic.definition)
    try:
        return decoder(memoryview(raw))
    except Exception as error:
        # struct.error, IndexError, KeyError, SerdeError ...: whatever the generated code runs into.
        text = " ".join(str(error).split())
        raise UndecodableError(text or type(error).__name__) from error


def is_decodable(topic: Topic) -> bool:
    return topic.type in READ and topic.serialization in SERIALIZATIONS


@lru_cache(maxsize=256)
def begins_with_header(topic: Topic) -> bool:
    """Whether a message begins with the std_msgs/Header that ROS itself has."""
    if not is_decodable(topic):
        return False
    store = _store(topic.type, topic.serialization, topic.syntax, topic.definition)
    fields = store.fielddefs[topic.type][1]
    is_first = bool(fields) and tuple(fields[0]) == ("header", (Nodetype.NAME, HEADER))
    return is_first and _is_stock(store, _stock_store(topic.serialization), HEADER)


@lru_cache(maxsize=64)
def is_stock(topic: Topic) -> bool:
    """Whether a message has the very fields, in their order, that its type has in ROS itself."""
    if not is_decodable(topic):
        return False
    store = _store(topic.type, topic.serialization, topic.syntax, topic.definition)
    return _is_stock(store, _stock_store(topic.serialization), topic.type)


def stamp_of(header: Any) -> int:
    """Nanoseconds of a std_msgs/Header."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def frame_of(name: str) -> str:
    """A frame's name without the leading slash of old ROS 1 logs."""
    return name.lstrip("/")


@lru_cache(maxsize=64)
def _decoder(kind: str, serialization: str, syntax: str, definition: str) -> Decode:
    store = _store(kind, serialization, syntax, definition)
    if serialization == "ros1":
        return lambda raw: store.deserialize_ros1(raw, kind)
    return lambda raw: store.deserialize_cdr(raw, kind)


@lru_cache(maxsize=64)
def _store(kind: str, serialization: str, syntax: str, definition: str) -> Typestore:
    """The log's own definition where it agrees with what is read of a type, else the stock one."""
    stock = _stock_store(serialization)
    own = _own_store(kind, syntax, definition) if definition else None
    return own if own is not None and _agrees(own, stock, kind) else stock


def _own_store(kind: str, syntax: str, definition: str) -> Typestore | None:
    """A store with this type alone, so that no other topic's definition can be in its way."""
    store = get_typestore(Stores.EMPTY)
    try:
        is_idl = syntax == "idl"
        store.register(get_types_from_idl(definition) if is_idl else get_types_from_msg(definition, kind))
        store.get_msgdef(kind)
    except Exception:
        # Empty, unparsable or incomplete definitions are common, and the stock one serves.
        return None
    return store


def _agrees(own: Typestore, stock: Typestore, kind: str) -> bool:
    """Whether all that is read of a type, and of the types in it, is there as the stock definition has it."""
    if kind not in own.fielddefs:
        return False
    have, known = dict(own.fielddefs[kind][1]), dict(stock.fielddefs[kind][1])
    if any(have.get(name) != known[name] for name in NEEDED.get(kind, ())):
        return False
    inner = [_message_type(known[name]) for name in NEEDED.get(kind, ())]
    return all(_agrees(own, stock, other) for other in inner if other in NEEDED)


def _is_stock(store: Typestore, stock: Typestore, kind: str) -> bool:
    """Whether a type, and all in it, has the same fields in the same order in both stores."""
    if kind not in store.fielddefs or kind not in stock.fielddefs:
        return False
    fields, known = store.fielddefs[kind][1], stock.fielddefs[kind][1]
    if list(map(tuple, fields)) != list(map(tuple, known)):
        return False
    inner = {_message_type(description) for _, description in known} - {None}
    return all(_is_stock(store, stock, str(other)) for other in inner)


def _message_type(description: Any) -> str | None:
    """The message type of a field, or of the items of an array; None for numbers and strings."""
    node, detail = description
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        node, detail = detail[0]
    return str(detail) if node == Nodetype.NAME else None


@lru_cache(maxsize=2)
def _stock_store(serialization: str) -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC if serialization == "ros1" else Stores.ROS2_HUMBLE)
    for kind, lines in STOCK.items():
        if kind not in store.fielddefs:
            store.register(get_types_from_msg("\n".join(lines), kind))
    return store
