"""What messages of ROS say: the fast way through their bytes against rosbags' own decoding of every field."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs_writer import (
    CLOUD,
    ODOMETRY,
    POSE,
    ROS1,
    ROS2,
    TF,
    cloud_message,
    header,
    odometry_record,
    pose_record,
    tf_message,
)
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gapeval.logs.read.container import HEAD, Topic
from gapeval.logs.read.messages.content import (
    UndecodableError,
    head,
    head_suffices,
    laser_scan,
    orientation,
    pose,
    role_of,
    transforms,
)

QUICK = settings(max_examples=100, deadline=None)
LASER, MULTI_ECHO = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/MultiEchoLaserScan"
IMU = "sensor_msgs/msg/Imu"
WAYS = ("ros1", "cdr", "cdr big")
NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
STAMPS = st.integers(0, (2**31 - 1) * 10**9)
NUMBERS = st.floats(width=64, allow_nan=False)


def written(way, kind, build, definition=""):
    """(topic, raw) of a message that build makes of a typestore."""
    store = ROS1 if way == "ros1" else ROS2
    if way == "ros1":
        raw = store.serialize_ros1(build(store), kind)
    else:
        raw = store.serialize_cdr(build(store), kind, little_endian=way == "cdr")
    return Topic("/topic", kind, 1, way[:4].strip(), definition, "msg" if definition else ""), bytes(raw)


@QUICK
@given(st.sampled_from(WAYS), STAMPS, NAMES, st.integers(1, 3000))
def test_heads_are_read_from_the_first_bytes(way, stamp, name, count):
    topic, raw = written(way, CLOUD, lambda store: cloud_message(store, stamp, name, np.ones((count, 3))))
    assert head_suffices(topic)
    for part in (raw, raw[:HEAD], memoryview(raw)[:HEAD]):
        found = head(topic, part)
        assert (found.stamp, found.frame) == (stamp, name.lstrip("/"))


EDGES = st.lists(st.tuples(NAMES, NAMES, st.tuples(*[NUMBERS] * 3), st.tuples(*[NUMBERS] * 4)), max_size=4)


@QUICK
@given(st.sampled_from(WAYS), STAMPS, EDGES)
def test_transforms_are_what_was_written(way, stamp, edges):
    topic, raw = written(way, TF, lambda store: tf_message(store, stamp, edges))
    found = [(item.stamp, item.parent, item.child, item.values) for item in transforms(topic, raw)]
    assert found == [(stamp, a.lstrip("/"), b.lstrip("/"), (*t, *q)) for a, b, t, q in edges]


@QUICK
@given(
    st.sampled_from(WAYS),
    st.lists(st.tuples(st.integers(0, 299), st.integers(0, 255)), max_size=3),
    st.integers(-6, 40),
)
def test_transforms_of_broken_bytes_are_those_of_rosbags_or_refused_as_there(way, changes, cut):
    edges = [(f"parent{i}", f"child{i}", (i, 2, 3), (0, 0, 0, 1)) for i in range(2)]
    topic, raw = written(way, TF, lambda store: tf_message(store, 10**18, edges))
    broken = bytearray(raw)
    for at, value in changes:
        broken[at % len(raw)] = value
    broken = bytes(broken[: len(broken) - cut] if cut > 0 else broken + bytes(-cut))
    store = ROS1 if way == "ros1" else ROS2
    read = store.deserialize_ros1 if way == "ros1" else store.deserialize_cdr
    try:
        expected = [values_of(item) for item in read(broken, TF).transforms]
    except Exception:
        expected = None
    try:
        found = [(item.stamp, item.parent, item.child, *item.values) for item in transforms(topic, broken)]
    except UndecodableError:
        found = None
    assert repr(found) == repr(expected)


def values_of(item):
    t, q = item.transform.translation, item.transform.rotation
    stamp = item.header.stamp.sec * 10**9 + item.header.stamp.nanosec
    names = item.header.frame_id.lstrip("/"), item.child_frame_id.lstrip("/")
    return stamp, *names, t.x, t.y, t.z, q.x, q.y, q.z, q.w


def test_a_header_in_another_place():
    stock = ROS2.generate_msgdef(CLOUD, ros_version=2)[0]
    topic = Topic("/points", CLOUD, 1, "cdr", "uint8 version\n" + stock, "msg")
    assert not head_suffices(topic)
    _, plain = written("cdr", CLOUD, lambda store: cloud_message(store, 5 * 10**9 + 7, "lidar", [[1, 2, 3]]))
    # One byte and three of padding move everything by four, which is what all of it is aligned to.
    raw = plain[:4] + b"\1\0\0\0" + plain[4:]
    assert (head(topic, raw).stamp, head(topic, raw).frame) == (5 * 10**9 + 7, "lidar")


def test_transforms_with_a_field_of_their_own():
    stock = ROS2.generate_msgdef(TF, ros_version=2)[0]
    text = stock.replace("string child_frame_id\n", "string child_frame_id\nfloat64 quality\n")
    assert text != stock
    own = get_typestore(Stores.EMPTY)
    own.register(get_types_from_msg(text, TF))
    plain = tf_message(ROS2, 3, [("a", f"b{i}", (i, 2, 3), (0, 0, 0, 1)) for i in range(2)])
    kind = own.types["geometry_msgs/msg/TransformStamped"]
    items = [kind(i.header, i.child_frame_id, 0.5, i.transform) for i in plain.transforms]
    raw = bytes(own.serialize_cdr(own.types[TF](transforms=items), TF))
    found = transforms(Topic("/tf", TF, 1, "cdr", text, "msg"), raw)
    assert [(item.child, item.values) for item in found] == [
        (f"b{i}", (i, 2, 3, 0, 0, 0, 1)) for i in range(2)
    ]
    with pytest.raises(UndecodableError):
        transforms(Topic("/tf", TF, 1, "cdr"), raw)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("covariance", "says"),
    [
        (np.zeros(36), False),
        (np.diag([1e-2, 1e-2, 4e-2, 0, 0, 1e-3]), True),
        (np.full(36, math.nan), False),
        (np.diag([-1.0, 0, 0, 0, 0, 0]), False),
    ],
)
def test_odometry(way, covariance, says):
    def build(store):
        message = odometry_record(7, "/odom", "base", (1, 2, 3), (0, 0, 1, 0)).build(store)
        message.pose.covariance[:] = np.reshape(covariance, 36)
        return message

    found = pose(*written(way, ODOMETRY, build))
    assert (found.stamp, found.parent, found.child) == (7, "odom", "base")
    assert found.values == (1, 2, 3, 0, 0, 1, 0)
    assert found.covariance == (tuple(np.reshape(covariance, 36)) if says else None)


@pytest.mark.parametrize("way", WAYS)
def test_a_pose_without_covariance_and_child(way):
    found = pose(*written(way, POSE, pose_record(9, "map", (1, 2, 3)).build))
    assert (found.stamp, found.parent, found.child, found.covariance) == (9, "map", "", None)


def scan(store, kind, ranges, intensities, **changes):
    numbers = {
        "angle_min": -1.5,
        "angle_max": 1.5,
        "angle_increment": 0.25,
        "time_increment": 0.0625,
        "scan_time": 0.1,
        "range_min": 0.5,
        "range_max": 30.0,
    }
    return store.types[kind](
        header=header(store, 11, "/laser"),
        ranges=ranges,
        intensities=intensities,
        **(numbers | changes),
    )


@pytest.mark.parametrize("way", WAYS)
def test_a_laser_scan(way):
    ranges = np.array([1, math.inf, math.nan, 2.5], np.float32)
    found = laser_scan(*written(way, LASER, lambda s: scan(s, LASER, ranges, np.arange(4, dtype="f4"))))
    assert (found.stamp, found.frame, found.pose) == (11, "laser", None)
    assert (found.angle_min, found.angle_increment, found.time_increment) == (-1.5, 0.25, 0.0625)
    assert (found.range_min, found.range_max) == (0.5, 30)
    np.testing.assert_array_equal(found.ranges, [[1], [math.inf], [math.nan], [2.5]])
    np.testing.assert_array_equal(found.intensities, [[0], [1], [2], [3]])
    none = laser_scan(*written(way, LASER, lambda s: scan(s, LASER, ranges, np.zeros(0, "f4"))))
    assert none.intensities is None


@pytest.mark.parametrize("way", WAYS)
def test_a_scan_of_several_echoes(way):
    def build(store):
        make = store.types["sensor_msgs/msg/LaserEcho"]
        beams = [make(echoes=np.array(echoes, np.float32)) for echoes in ([1, 2], [], [3, 4, 5], [6])]
        return scan(store, MULTI_ECHO, beams, beams)

    found = laser_scan(*written(way, MULTI_ECHO, build))
    nan = math.nan
    expected = [[1, 2, nan], [nan, nan, nan], [3, 4, 5], [6, nan, nan]]
    np.testing.assert_array_equal(found.ranges, expected)
    np.testing.assert_array_equal(found.intensities, expected)
    empty = laser_scan(*written(way, MULTI_ECHO, lambda store: scan(store, MULTI_ECHO, [], [])))
    assert empty.ranges.shape == (0, 1)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("quaternion", "first", "says"),
    [((0, 0, 0.6, 0.8), 0.0, True), ((0, 0, 0.6, 0.8), -1.0, False), ((0, 0, 0, 0), 0.0, False)],
)
def test_an_orientation(way, quaternion, first, says):
    def build(store):
        make = store.types
        zero = make["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        x, y, z, w = map(float, quaternion)
        covariance = np.zeros(9)
        covariance[0] = first
        return make[IMU](
            header=header(store, 13, "imu"),
            orientation=make["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
            orientation_covariance=covariance,
            angular_velocity=zero,
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=zero,
            linear_acceleration_covariance=np.zeros(9),
        )

    topic, raw = written(way, IMU, build)
    assert role_of(topic) == "imu"
    found = orientation(topic, raw)
    assert (found is not None) == says
    if found is not None:
        assert (found.stamp, found.frame, found.quaternion) == (13, "imu", quaternion)


def test_roles():
    roles = {
        "sensor_msgs/msg/PointCloud2": "cloud",
        "livox_ros_driver/msg/CustomMsg": "cloud",
        "livox_ros_driver2/msg/CustomMsg": "cloud",
        LASER: "laser",
        MULTI_ECHO: "laser",
        TF: "tf",
        "tf/msg/tfMessage": "tf",
        "nav_msgs/msg/Odometry": "pose",
        "geometry_msgs/msg/PoseWithCovarianceStamped": "pose",
        "std_msgs/msg/String": None,
        "foxglove_msgs/msg/PackedElementField": None,
        "foxglove_msgs/msg/PointCloud": "cloud",
        "foxglove.PointCloud": None,
    }
    for serialization in ("ros1", "cdr"):
        assert {kind: role_of(Topic("/t", kind, 1, serialization)) for kind in roles} == roles
    foxglove = {"PointCloud": "cloud", "LaserScan": "laser", "FrameTransform": "tf", "FrameTransforms": "tf"}
    foxglove |= {"PoseInFrame": "pose", "SceneUpdate": None}
    for serialization in ("protobuf", "json"):
        for name, role in foxglove.items():
            assert role_of(Topic("/t", f"foxglove.{name}", 1, serialization)) == role
            assert role_of(Topic("/t", f"other.{name}", 1, serialization)) is None
    assert role_of(Topic("/t", "foxglove.PointCloud", 1, "flatbuffer")) is None
    assert role_of(Topic("/t", "sensor_msgs/msg/PointCloud2", 1, "protobuf")) is None
