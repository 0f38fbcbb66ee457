"""Messages with bytes and headers changed at random: read as a slow reference reads them, or refused."""

import json
import struct
import tracemalloc

import foxglove_logs as foxglove
import naive_clouds
import numpy as np
import plyfile
import pypcd4
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from logs_writer import (
    CLOUD,
    LIVOX_DRIVERS,
    ODOMETRY,
    POINTS,
    POSE,
    ROS1,
    ROS2,
    START,
    TF,
    cloud_message,
    header,
    odometry_record,
    pose_record,
    tf_message,
)

from gapeval.logs.read.container import HEAD, Topic
from gapeval.logs.read.messages import content
from gapeval.logs.read.messages.content import UndecodableError, UnreadableCloudError
from gapeval.logs.read.messages.file_message import with_head

pytestmark = pytest.mark.slow

MANY = settings(max_examples=10_000, deadline=None, suppress_health_check=list(HealthCheck))
SOME = settings(max_examples=700, deadline=None, suppress_health_check=list(HealthCheck))
WAYS = ("ros1", "cdr", "cdr big")
# Bytes that may be taken for each byte of a message, and apart from any message.
SHARE, BASE = 100, 2_000_000

PLAIN = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("intensity", 12, 7, 1)]
SIZES = st.one_of(
    st.integers(0, 40), st.sampled_from([255, 2**15, 2**16, 2**31 - 1, 2**31, 2**32 - 2, 2**32 - 1])
)
FIELDS = st.lists(
    st.tuples(
        st.sampled_from(["x", "y", "z", "x", "y", "z", "t", "xyz", "", "é"]),
        st.one_of(st.integers(0, 20), SIZES),
        st.one_of(st.integers(1, 8), st.integers(0, 255)),
        st.one_of(st.just(1), SIZES),
    ),
    max_size=7,
)
HEADERS = st.fixed_dictionaries(
    {},
    optional={
        "height": SIZES,
        "width": SIZES,
        "point_step": SIZES,
        "row_step": SIZES,
        "fields": st.one_of(FIELDS, FIELDS.map(lambda more: [*PLAIN, *more]), st.permutations(PLAIN)),
        "is_bigendian": st.booleans(),
        "is_dense": st.booleans(),
        "data": st.one_of(
            st.binary(max_size=400).map(lambda data: np.frombuffer(data, np.uint8)),
            st.integers(0, 2**32 - 1)
            .map(lambda seed: np.random.default_rng(seed).bytes(320))
            .map(lambda data: np.frombuffer(data, np.uint8)),
        ),
    },
)
# Of the 320 bytes of the message.
PLAUSIBLE = st.fixed_dictionaries(
    {"height": st.integers(1, 3), "width": st.integers(1, 6), "point_step": st.integers(6, 20)},
    optional={
        "row_step": st.one_of(st.just(0), st.integers(90, 120)),
        "fields": st.tuples(*[st.tuples(st.integers(0, 6), st.integers(1, 8))] * 3).map(
            lambda places: [(name, *place, 1) for name, place in zip("xyz", places, strict=True)]
        ),
        "is_bigendian": st.booleans(),
        "data": st.binary(min_size=300, max_size=320).map(lambda data: np.frombuffer(data, np.uint8)),
    },
)
NUMBERS = [0, 1, 2**7, 2**15, 2**31 - 1, 2**31, 2**32 - 1]
EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("set"), st.floats(0, 1), st.binary(min_size=1, max_size=1)),
        st.tuples(st.just("set"), st.floats(0, 0.2), st.sampled_from(NUMBERS).map(struct.Struct("<I").pack)),
        st.tuples(st.just("insert"), st.floats(0, 1), st.binary(max_size=9)),
        st.tuples(st.just("cut"), st.floats(0, 1), st.just(b"")),
    ),
    max_size=4,
)


def edited(raw, edits):
    for what, place, data in edits:
        at = int(place * len(raw))
        if what == "set":
            raw = raw[:at] + data + raw[at + len(data) :]
        else:
            raw = raw[:at] + (data + raw[at:] if what == "insert" else b"")
    return raw


def bounded(read, raw):
    """What read makes of a message, without taking much more memory than the message has; None if refused."""
    tracemalloc.start()
    try:
        return read()
    except (UndecodableError, UnreadableCloudError):
        return None
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < BASE + SHARE * len(raw)


def written(way, kind, message):
    store = ROS1 if way == "ros1" else ROS2
    if way == "ros1":
        return bytes(store.serialize_ros1(message, kind))
    return bytes(store.serialize_cdr(message, kind, little_endian=way == "cdr"))


def store_of(way):
    return ROS1 if way == "ros1" else ROS2


def rosbags_reads(way, raw, kind):
    """What rosbags reads; None where it refuses, in whatever way."""
    store = store_of(way)
    try:
        return store.deserialize_ros1(raw, kind) if way == "ros1" else store.deserialize_cdr(raw, kind)
    except Exception:
        return None


# Mostly whole messages whose headers lie or might be true: changed bytes are seldom a message at all.
SOME_EDITS = st.one_of(st.just([]), st.just([]), EDITS)
SOME_CHANGES = st.one_of(HEADERS, PLAUSIBLE)


@MANY
@given(st.sampled_from(WAYS), SOME_CHANGES, SOME_EDITS)
def test_point_clouds(way, changes, edits):
    message = cloud_message(store_of(way), START, "lidar", np.arange(1, 61).reshape(20, 3), **changes)
    raw = edited(written(way, CLOUD, message), edits)
    topic = Topic("/points", CLOUD, 1, way[:4].strip())
    found = bounded(lambda: content.cloud(topic, raw), raw)
    decoded = rosbags_reads(way, raw, CLOUD)
    expected = None if decoded is None else naive_clouds.cloud_points(decoded)
    if expected is None or not expected[0]:
        assert found is None
    else:
        assert list(map(tuple, found.xyz.astype(float).tolist())) == expected[0]
        assert found.not_finite + found.zero == expected[1]
    if decoded is not None:
        stamp = decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec
        assert content.head(topic, raw[:HEAD]).stamp == stamp
    timed = bounded(lambda: content.timed_cloud(topic, raw), raw)
    assert timed is None or len(timed.nanoseconds) == len(found.xyz)


def livox_message(store, kind):
    make = store.types[kind.replace("CustomMsg", "CustomPoint")]
    points = [make(i * 1000, 1.0 + i, 2.0, 3.0, 9, 0, i % 4) for i in range(20)]
    values = (header(store, START, "livox"), START, 20, 1, np.zeros(3, np.uint8), points)
    return store.types[kind](*values)


@SOME
@given(st.sampled_from(WAYS), EDITS)
def test_livox(way, edits):
    kind = f"{LIVOX_DRIVERS[0]}/msg/CustomMsg"
    raw = edited(written(way, kind, livox_message(store_of(way), kind)), edits)
    topic = Topic("/livox", kind, 1, way[:4].strip())
    found = bounded(lambda: content.cloud(topic, raw), raw)
    decoded = rosbags_reads(way, raw, kind)
    points = [] if decoded is None else [(p.x, p.y, p.z) for p in decoded.points]
    expected = [p for p in points if any(p) and all(abs(v) <= 1e12 for v in p)]
    assert ([] if found is None else list(map(tuple, found.xyz.astype(float).tolist()))) == expected


def scan_message(store, kind):
    numbers = dict.fromkeys(("angle_min", "angle_max", "scan_time", "range_min"), 0.5)
    numbers |= {"angle_increment": 0.01, "time_increment": 0.001, "range_max": 30.0}
    ranges = np.linspace(1, 9, 30, dtype=np.float32)
    if kind == MULTI_ECHO:
        echo = store.types["sensor_msgs/msg/LaserEcho"]
        ranges = [echo(echoes=ranges[: i % 4]) for i in range(10)]
    return store.types[kind](
        header=header(store, START, "laser"), ranges=ranges, intensities=ranges, **numbers
    )


def imu_message(store, kind):
    make = store.types
    zero = make["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    turn = make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.6, w=0.8)
    nine = np.zeros(9)
    return make[kind](header(store, START, "imu"), turn, nine, zero, nine, zero, nine)


LASER, MULTI_ECHO = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/MultiEchoLaserScan"
IMU = "sensor_msgs/msg/Imu"
EDGES = [(f"parent{i}", f"child{i}", (i, 2, 3), (0, 0, 0, 1)) for i in range(3)]
# type -> (how it is read, message of a typestore)
OTHERS = {
    LASER: (content.laser_scan, lambda store: scan_message(store, LASER)),
    MULTI_ECHO: (content.laser_scan, lambda store: scan_message(store, MULTI_ECHO)),
    IMU: (content.orientation, lambda store: imu_message(store, IMU)),
    TF: (content.transforms, lambda store: tf_message(store, START, EDGES)),
    POSE: (content.pose, pose_record(START, "map", (1, 2, 3)).build),
    ODOMETRY: (content.pose, odometry_record(START, "odom", "base", (1, 2, 3)).build),
}


@pytest.mark.parametrize("kind", OTHERS)
@SOME
@given(way=st.sampled_from(WAYS), edits=EDITS)
def test_other_messages_of_ros(kind, way, edits):
    """Read exactly when rosbags reads them, and of those some are refused for what they say."""
    read, build = OTHERS[kind]
    raw = edited(written(way, kind, build(store_of(way))), edits)
    topic = Topic("/topic", kind, 1, way[:4].strip())
    found = bounded(lambda: read(topic, raw), raw)
    decoded = rosbags_reads(way, raw, kind)
    if decoded is None:
        assert found is None
    elif kind != IMU:
        assert found is not None
    if kind == TF and decoded is not None:
        assert len(found) == len(decoded.transforms)


FOXGLOVE = {
    content.cloud: foxglove.cloud(START, POINTS, pose=((1, 2, 3), (0, 0, 0, 1))),
    content.laser_scan: foxglove.scan(START, [1, 2, 3], -1, 1, intensities=[1, 2, 3]),
    content.transforms: foxglove.transforms(*(foxglove.transform(START, *edge) for edge in EDGES)),
    content.pose: foxglove.pose(START, "map", (1, 2, 3)),
}


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
@pytest.mark.parametrize("read", FOXGLOVE, ids=lambda read: read.__name__)
@SOME
@given(edits=EDITS)
def test_foxglove(read, encoding, edits):
    topic, raw = foxglove.topic_of(FOXGLOVE[read], encoding)
    broken = edited(raw, edits)
    found = bounded(lambda: read(topic, broken), broken)
    if read is content.cloud:
        bounded(lambda: content.timed_cloud(topic, broken), broken)
    if broken == raw:
        assert found is not None


@pytest.mark.parametrize("field", ["timestamp", "frame_id", "pose", "point_stride", "fields", "data", "more"])
@SOME
@given(
    value=st.recursive(
        st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text()),
        lambda inner: st.one_of(
            st.lists(inner, max_size=4),
            st.dictionaries(
                st.sampled_from(["sec", "nsec", "position", "orientation", "x", "w", "name", "type"]),
                inner,
                max_size=4,
            ),
        ),
        max_leaves=8,
    )
)
def test_values_of_any_kind_in_json(field, value):
    values = foxglove.as_json(FOXGLOVE[content.cloud]) | {field: value}
    raw = json.dumps(values).encode()
    topic = Topic("/lidar", "foxglove.PointCloud", 1, "json")
    bounded(lambda: content.cloud(topic, raw), raw)
    bounded(lambda: content.head(topic, raw), raw)


def files_of_clouds(folder):
    """serialization and name -> the bytes of a whole file."""
    xyz = np.round(POINTS, 1).astype(np.float32)
    made = {}
    for encoding in ("ascii", "binary", "binary_compressed"):
        path = folder / f"{encoding}.pcd"
        pypcd4.PointCloud.from_xyzi_points(np.c_[xyz, xyz[:, 0] * 0]).save(path, pypcd4.Encoding(encoding))
        made["pcd", encoding] = path.read_bytes()
    rows = np.zeros(len(xyz), [("x", "f4"), ("y", "f4"), ("z", "f8"), ("t", "u4")])
    for i, name in enumerate("xyz"):
        rows[name] = xyz[:, i]
    for order, text in (("<", True), ("<", False), (">", False)):
        path = folder / "cloud.ply"
        element = plyfile.PlyElement.describe(rows, "vertex")
        plyfile.PlyData([element], text=text, byte_order=order).write(str(path))
        made["ply", f"{order} {text}"] = path.read_bytes()
    made["kitti", "bin"] = np.c_[xyz, xyz[:, 0]].astype("<f4").tobytes()
    return made


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return files_of_clouds(tmp_path_factory.mktemp("files"))


@pytest.mark.parametrize("number", range(7))
@SOME
@given(edits=EDITS)
def test_files_of_clouds(files, number, edits):
    (form, _), whole = list(files.items())[number]
    raw = edited(whole, edits)
    topic, message = Topic("/points", form.upper(), 1, form), with_head(START, "lidar", raw)
    found = bounded(lambda: content.cloud(topic, message), message)
    assert content.head(topic, message[:HEAD]).stamp == START
    if raw == whole:
        assert len(found.xyz) == len(POINTS)
