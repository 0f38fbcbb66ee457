"""Real logs for tests, written by the real libraries: what a test says, and nothing else, is in them."""

import math
import shutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

CLOUD = "sensor_msgs/msg/PointCloud2"
TF = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
ROS2 = get_typestore(Stores.ROS2_HUMBLE)
LIVOX_DRIVERS = ("livox_ros_driver", "livox_ros_driver2")
LIVOX_POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line"
LIVOX_MESSAGE = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
    "CustomPoint[] points"
)
for _store in (ROS1, ROS2):
    for _driver in LIVOX_DRIVERS:
        _store.register(get_types_from_msg(LIVOX_POINT, f"{_driver}/msg/CustomPoint"))
        _store.register(get_types_from_msg(LIVOX_MESSAGE, f"{_driver}/msg/CustomMsg"))

BAGS = ("bag", "bag-lz4", "bag-bz2")
MCAPS = ("mcap", "mcap-lz4", "mcap-none", "mcap-no-index", "mcap-no-summary", "mcap-unchunked", "mcap-bare")
FOLDERS = (
    "sqlite3",
    "sqlite3-file",
    "sqlite3-message",
    "rosbag2-mcap",
    "rosbag2-mcap-storage",
    "rosbag2-mcap-file",
    "rosbag2-mcap-message",
)
SPLITS = ("split-sqlite3", "split-mcap", "split-sqlite3-file")
CONTAINERS = (*BAGS, *MCAPS, *FOLDERS, *SPLITS, "db3", "db3-message")

Build = Callable[[Any], Any]


@dataclass(frozen=True)
class Record:
    """One message: build makes it from a typestore; raw, where given, is written as it is."""

    topic: str
    type: str
    time: int
    build: Build | None = None
    raw: bytes | None = None


def write_log(
    path: Path,
    *,
    clouds: Sequence[tuple[int, Any]],
    poses: Sequence[tuple[int, float, float, float]],
    container: str = "mcap",
    cloud_topic: str = "/points",
    robot_frame: str = "base_link",
    fixed_frame: str = "map",
    sensor_frame: str = "lidar",
    sensor_height: float = 1.0,
    delay: int = 1_000_000,
) -> Path:
    """A log of clouds, given as (stamp [ns], points (N, 3) in the sensor frame), and of a robot's poses,
    given as (stamp [ns], x, y, yaw). fixed <- robot is on /tf, robot <- sensor on /tf_static.

    container: one of CONTAINERS; messages are logged `delay` ns after their stamp. Returns the path.
    """
    stamps = [stamp for stamp, *_ in (*clouds, *poses)] or [0]
    records = [
        static_record(min(stamps), [(robot_frame, sensor_frame, (0.0, 0.0, sensor_height), (0, 0, 0, 1))])
    ]
    records += [
        tf_record(stamp, [(fixed_frame, robot_frame, (x, y, 0.0), yaw_quaternion(yaw))])
        for stamp, x, y, yaw in poses
    ]
    records += [cloud_record(stamp, points, sensor_frame, cloud_topic) for stamp, points in clouds]
    later = [replace(record, time=record.time + delay) for record in records]
    return write_records(path, sorted(later, key=lambda record: record.time), container)


def yaw_quaternion(yaw: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


def tf_record(stamp: int, transforms: Iterable[Any], topic: str = "/tf") -> Record:
    """transforms: (parent, child, translation, quaternion x, y, z, w), all at the stamp."""
    items = list(transforms)
    return Record(topic, TF, stamp, lambda store: tf_message(store, stamp, items))


def static_record(stamp: int, transforms: Iterable[Any], topic: str = "/tf_static") -> Record:
    return tf_record(stamp, transforms, topic)


def cloud_record(
    stamp: int, points: Any, frame: str = "lidar", topic: str = "/points", **layout: Any
) -> Record:
    return Record(topic, CLOUD, stamp, lambda store: cloud_message(store, stamp, frame, points, **layout))


def odometry_record(
    stamp: int,
    parent: str,
    child: str,
    translation: Any,
    quaternion: Any = (0, 0, 0, 1),
    topic: str = "/odom",
) -> Record:
    def build(store: Any) -> Any:
        make = store.types
        zero = make["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        covariance = np.zeros(36)
        return make[ODOMETRY](
            header=header(store, stamp, parent),
            child_frame_id=child,
            pose=make["geometry_msgs/msg/PoseWithCovariance"](
                pose=pose(store, translation, quaternion), covariance=covariance
            ),
            twist=make["geometry_msgs/msg/TwistWithCovariance"](
                twist=make["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=covariance
            ),
        )

    return Record(topic, ODOMETRY, stamp, build)


def pose_record(
    stamp: int, parent: str, translation: Any, quaternion: Any = (0, 0, 0, 1), topic: str = "/pose"
) -> Record:
    def build(store: Any) -> Any:
        return store.types[POSE](
            header=header(store, stamp, parent), pose=pose(store, translation, quaternion)
        )

    return Record(topic, POSE, stamp, build)


def header(store: Any, stamp: int, frame: str) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    kind = store.types["std_msgs/msg/Header"]
    return kind(seq=0, stamp=time, frame_id=frame) if store is ROS1 else kind(stamp=time, frame_id=frame)


def pose(store: Any, translation: Any, quaternion: Any) -> Any:
    x, y, z = map(float, translation)
    qx, qy, qz, qw = map(float, quaternion)
    make = store.types
    return make["geometry_msgs/msg/Pose"](
        position=make["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=make["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )


def tf_message(store: Any, stamp: int, transforms: Iterable[Any]) -> Any:
    make = store.types
    items = []
    for parent, child, translation, quaternion in transforms:
        x, y, z = map(float, translation)
        qx, qy, qz, qw = map(float, quaternion)
        items.append(
            make["geometry_msgs/msg/TransformStamped"](
                header=header(store, stamp, parent),
                child_frame_id=child,
                transform=make["geometry_msgs/msg/Transform"](
                    translation=make["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
                    rotation=make["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
                ),
            )
        )
    return make[TF](transforms=items)


def cloud_message(store: Any, stamp: int, frame: str, points: Any, **layout: Any) -> Any:
    """A plain cloud of 16-byte float32 points; layout: any field of PointCloud2 to have otherwise, where
    fields are (name, offset, datatype, count)."""
    xyz = np.asarray(points, dtype="<f4").reshape(-1, 3)
    rows = np.zeros((len(xyz), 4), dtype="<f4")
    rows[:, :3] = xyz
    values: dict[str, Any] = {
        "height": 1,
        "width": len(xyz),
        "fields": [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("intensity", 12, 7, 1)],
        "is_bigendian": False,
        "point_step": 16,
        "row_step": 16 * len(xyz),
        "data": rows.view(np.uint8).reshape(-1),
        "is_dense": True,
    } | layout
    make = store.types["sensor_msgs/msg/PointField"]
    values["fields"] = [make(name=n, offset=o, datatype=d, count=c) for n, o, d, c in values["fields"]]
    return store.types[CLOUD](header=header(store, stamp, frame), **values)


def write_records(path: Path, records: Sequence[Record], container: str = "mcap") -> Path:
    """Records, in this order, into a file or folder of one of CONTAINERS. Returns the path."""
    if container in BAGS:
        _write_bag(path, records, container)
    elif container in MCAPS:
        write_mcap(path, records, **_MCAP_OPTIONS[container])
    elif container.startswith("split-"):
        _write_split(path, records, container.removeprefix("split-"))
    elif container.startswith("db3"):
        folder = path.with_name(path.name + ".folder")
        _write_folder(folder, records, container.replace("db3", "sqlite3"))
        shutil.move(next(folder.glob("*.db3")), path)
        shutil.rmtree(folder)
    else:
        _write_folder(path, records, container)
    return path


_MCAP_OPTIONS: dict[str, dict[str, Any]] = {
    "mcap": {},
    "mcap-lz4": {"compression": CompressionType.LZ4},
    "mcap-none": {"compression": CompressionType.NONE},
    "mcap-no-index": {"index_types": IndexType.NONE},
    "mcap-no-summary": {
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
    },
    "mcap-unchunked": {"use_chunking": False},
    "mcap-bare": {
        "use_chunking": False,
        "index_types": IndexType.NONE,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_statistics": False,
        "use_summary_offsets": False,
        "enable_data_crcs": True,
    },
}


def write_mcap(
    path: Path,
    records: Sequence[Record],
    *,
    profile: str = "ros2",
    encoding: str = "cdr",
    schema_encoding: str = "ros2msg",
    definitions: dict[str, str] | None = None,
    chunk_size: int = 4096,
    **options: Any,
) -> Path:
    """An MCAP file; definitions: texts by type in place of the stock ones."""
    store, version = (ROS1, 1) if encoding == "ros1" else (ROS2, 2)
    writer = McapWriter(str(path), chunk_size=chunk_size, **options)
    writer.start(profile=profile, library="gapeval tests")
    channels: dict[tuple[str, str], int] = {}
    for record in records:
        key = (record.topic, record.type)
        if key not in channels:
            text = (definitions or {}).get(record.type)
            if text is None:
                text = store.generate_msgdef(record.type, ros_version=version)[0]
            name = record.type.replace("/msg/", "/") if version == 1 else record.type
            schema = writer.register_schema(name, schema_encoding, text.encode())
            channels[key] = writer.register_channel(record.topic, encoding, schema)
        writer.add_message(channels[key], record.time, _raw(record, store), record.time)
    writer.finish()
    return path


def _raw(record: Record, store: Any) -> bytes:
    if record.raw is not None:
        return record.raw
    assert record.build is not None
    message = record.build(store)
    if store is ROS1:
        return bytes(store.serialize_ros1(message, record.type))
    return bytes(store.serialize_cdr(message, record.type))


def _write_bag(path: Path, records: Sequence[Record], container: str) -> None:
    writer = Ros1Writer(path)
    formats = {"bag-lz4": Ros1Writer.CompressionFormat.LZ4, "bag-bz2": Ros1Writer.CompressionFormat.BZ2}
    if container in formats:
        writer.set_compression(formats[container])
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for record in records:
            key = (record.topic, record.type)
            if key not in connections:
                connections[key] = writer.add_connection(record.topic, record.type, typestore=ROS1)
            writer.write(connections[key], record.time, _raw(record, ROS1))


def _write_folder(path: Path, records: Sequence[Record], container: str) -> None:
    plugin = StoragePlugin.SQLITE3 if container.startswith("sqlite3") else StoragePlugin.MCAP
    writer = Ros2Writer(path, version=9, storage_plugin=plugin)
    modes = {
        "file": CompressionMode.FILE,
        "message": CompressionMode.MESSAGE,
        "storage": CompressionMode.STORAGE,
    }
    mode = modes.get(container.rpartition("-")[2])
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for record in records:
            key = (record.topic, record.type)
            if key not in connections:
                connections[key] = writer.add_connection(record.topic, record.type, typestore=ROS2)
            writer.write(connections[key], record.time, _raw(record, ROS2))


def _write_split(path: Path, records: Sequence[Record], container: str) -> None:
    """Two parts, as rosbag2 splits a log: /tf_static is latched and thus in the first part alone."""
    middle = len(records) // 2
    path.mkdir()
    whole: dict[str, Any] = {}
    for number, part in enumerate((records[:middle], records[middle:])):
        folder = path / f"part_{number}"
        _write_folder(folder, part, container.replace("mcap", "rosbag2-mcap"))
        text = (folder / "metadata.yaml").read_text(encoding="utf-8")
        whole = _joined(whole, yaml.safe_load(text)["rosbag2_bagfile_information"])
        for file in folder.iterdir():
            if file.name != "metadata.yaml":
                shutil.move(file, path / file.name)
        shutil.rmtree(folder)
    (path / "metadata.yaml").write_text(
        yaml.safe_dump({"rosbag2_bagfile_information": whole}), encoding="utf-8"
    )


def _joined(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    if not first:
        return second
    start = first["starting_time"]["nanoseconds_since_epoch"]
    end = second["starting_time"]["nanoseconds_since_epoch"] + second["duration"]["nanoseconds"]
    topics = {item["topic_metadata"]["name"]: item for item in first["topics_with_message_count"]}
    for item in second["topics_with_message_count"]:
        known = topics.setdefault(item["topic_metadata"]["name"], item | {"message_count": 0})
        known["message_count"] += item["message_count"]
    return first | {
        "relative_file_paths": first["relative_file_paths"] + second["relative_file_paths"],
        "files": first["files"] + second["files"],
        "duration": {"nanoseconds": end - start},
        "message_count": first["message_count"] + second["message_count"],
        "topics_with_message_count": list(topics.values()),
    }


# The drive of most tests: along x, 0.1 m and 0.1 s from scan to scan.

START = 1_700_000_000_000_000_000
STEP = 100_000_000
HERE = (0, 0, 0, 1)
POINTS = np.random.default_rng(2).normal(size=(50, 3)) * 4 + [0, 0, 6]


def stamps(count, first=0):
    return [START + (first + i) * STEP for i in range(count)]


def lidar(parent="base_link", child="lidar", height=1.0):
    return static_record(START, [(parent, child, (0, 0, height), HERE)])


def driving(parent="map", child="base_link", count=12, first=-1):
    return [
        tf_record(stamp, [(parent, child, (i / 10, 0, 0), HERE)])
        for i, stamp in enumerate(stamps(count, first))
    ]


def clouds(count=10, frame="lidar", topic="/points", first=0):
    return [cloud_record(stamp, POINTS, frame, topic) for stamp in stamps(count, first)]


def write_sorted(path: Path, *records: Any, container: str = "mcap") -> Path:
    """Records and lists of records in the order of their times."""
    every: list[Record] = []
    for record in records:
        every += record if isinstance(record, list) else [record]
    return write_records(path, sorted(every, key=lambda record: record.time), container)
