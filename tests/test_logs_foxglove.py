"""Foxglove's types in all three encodings, against the same log in ROS's own."""

import json
import math
import sys

import foxglove_logs as foxglove
import numpy as np
import pytest
from logs_checks import frames_of
from logs_writer import (
    POINTS,
    ROS2,
    START,
    clouds,
    driving,
    lidar,
    stamps,
    write_sorted,
)
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.frame import Transform
from gapeval.logs.read import describe, read_recording
from gapeval.logs.read.container import Topic
from gapeval.logs.read.laser import echoes
from gapeval.logs.read.messages.content import (
    UndecodableError,
    UnreadableCloudError,
    cloud,
    head,
    laser_scan,
    packed_cloud,
    pose,
    timed_cloud,
    transforms,
)

ENCODINGS = ("protobuf", "json")
TURN = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


@pytest.fixture(params=ENCODINGS)
def encoding(request):
    return request.param


def drive(first_topic="/tf", static_times=1):
    """The drive of most tests, with the laser's mount said `static_times` times."""
    for i, stamp in enumerate(stamps(12, -1)):
        items = [foxglove.transform(stamp, "map", "base_link", (i / 10, 0, 0))]
        if i < static_times:
            items.append(foxglove.transform(stamp, "/base_link", "lidar", (0, 0, 1)))
        yield first_topic, stamp, foxglove.transforms(*items)
    for stamp in stamps(10):
        yield "/lidar", stamp, foxglove.cloud(stamp, POINTS)


def by_time(messages):
    return sorted(messages, key=lambda message: message[1])


def test_a_log_gives_the_frames_of_the_same_log_of_ros(tmp_path, encoding):
    path = foxglove.write(tmp_path / "log.mcap", by_time(drive()), encoding)
    same = write_sorted(tmp_path / "ros.mcap", lidar(), driving(), clouds())
    assert [f.digest for f in frames_of(path)] == [f.digest for f in frames_of(same)]
    recording = read_recording(path, LogSection())
    assert recording.notices == ("base_link<-lidar is said once on /tf, so it is taken to hold for all time",)
    description = describe(path, LogSection())
    assert [(c.topic, c.frame_id, c.finite, c.point_step) for c in description.clouds] == [
        ("/lidar", "lidar", 50, 16)
    ]
    assert {e.kind for e in description.transforms if e.child == "lidar"} == {"static"}


def test_what_is_said_twice_holds_at_its_stamps(tmp_path, encoding):
    path = foxglove.write(tmp_path / "log.mcap", by_time(drive(static_times=2)), encoding)
    # Up to the second time that the mount is said, at the first cloud.
    with pytest.raises(LogError, match="only 1 of 10 clouds have a transform base_link<-lidar"):
        read_recording(path, LogSection())


def test_single_transforms_and_poses(tmp_path, encoding):
    """FrameTransform on topics of any name; the robot's poses as PoseInFrame."""
    messages = [
        ("/mount/tf_static", START, foxglove.transform(START, "base_link", "arm", (0, 0, 0.25))),
        ("/arm/mount_tf_static", START, foxglove.transform(START, "arm", "lidar", (0, 0, 0.75))),
    ]
    messages += [("/pose", s, foxglove.pose(s, "map", (i / 10, 0, 0))) for i, s in enumerate(stamps(12, -1))]
    messages += [("/lidar", stamp, foxglove.cloud(stamp, POINTS)) for stamp in stamps(10)]
    path = foxglove.write(tmp_path / "log.mcap", by_time(messages), encoding)
    same = write_sorted(tmp_path / "ros.mcap", lidar(), driving(), clouds())
    assert [f.digest for f in frames_of(path)] == [f.digest for f in frames_of(same)]
    assert read_recording(path, LogSection()).notices == ()


def test_types_of_fields_are_foxgloves_own(encoding):
    """Every type has another number in ROS but float32 and float64."""
    rng = np.random.default_rng(5)
    for kind in ("u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8"):
        rows = np.zeros(20, [("x", "<" + kind), ("skipped", "<u1"), ("y", "<f4"), ("z", "<f8")])
        rows["x"] = rng.integers(-100, 100, 20).astype(kind)
        rows["y"], rows["z"] = rng.normal(size=(2, 20))
        found = cloud(*foxglove.topic_of(foxglove.cloud(START, rows), encoding))
        expected = np.stack([rows["x"].astype(float), rows["y"].astype(float), rows["z"]], axis=1)
        assert np.array_equal(found.xyz, expected)


def test_the_pose_of_a_cloud_is_applied(encoding):
    there = ([500_000.25, 5_400_000.5, 3], TURN)
    topic, raw = foxglove.topic_of(foxglove.cloud(START, POINTS, pose=there), encoding)
    expected = Transform.of(*there).apply(POINTS.astype(np.float32).astype(float))
    np.testing.assert_allclose(cloud(topic, raw).xyz, expected, rtol=0, atol=1e-9)
    assert head(topic, raw).frame == "lidar"
    # Where protobuf leaves out zeros, no turn is meant and not an impossible one.
    moved = foxglove.cloud(START, POINTS, pose=((1, 0, 0), (0, 0, 0, 0)))
    found = cloud(*foxglove.topic_of(moved, encoding)).xyz
    np.testing.assert_allclose(found, POINTS.astype(np.float32) + np.array([1.0, 0, 0]), atol=1e-12)
    assert packed_cloud(*foxglove.topic_of(foxglove.cloud(START, POINTS), encoding)).pose is None


def test_times_of_points(encoding):
    rows = np.zeros(3, [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    rows["x"], rows["t"] = [1, 2, 3], [0, 50_000_000, 100_000_000]
    posed = foxglove.cloud(START, rows, pose=((0, 0, 5), TURN))
    timed = timed_cloud(*foxglove.topic_of(posed, encoding))
    assert timed.nanoseconds.tolist() == [0, 50_000_000, 100_000_000]
    np.testing.assert_allclose(timed.points.xyz, [[0, 1, 5], [0, 2, 5], [0, 3, 5]], atol=1e-12)


def test_a_laser_scan(encoding):
    message = foxglove.scan(START, [1, 2, 3], -0.5, 0.5, pose=((0, 0, 0.3), TURN), intensities=[7, 8, 9])
    found = laser_scan(*foxglove.topic_of(message, encoding))
    assert (found.stamp, found.frame) == (START, "laser")
    assert (found.angle_min, found.angle_increment, found.time_increment) == (-0.5, 0.5, 0)
    assert found.ranges.tolist() == [[1], [2], [3]]
    assert found.intensities.tolist() == [[7], [8], [9]]
    assert found.pose == Transform.of((0, 0, 0.3), TURN)
    # Turned by a quarter, the middle beam looks along y.
    points = echoes(found, LogSection().laser).points
    np.testing.assert_allclose(points[1], [0, 2, 0.3], atol=1e-12)
    bare = laser_scan(*foxglove.topic_of(foxglove.scan(START, [4], 0.25, 0.25), encoding))
    assert (bare.pose, bare.intensities, bare.angle_increment) == (None, None, 0)


def test_the_same_as_messages_of_ros():
    """Types of foxglove_msgs, by their definitions in the log, and by ours where it has none."""
    make = ROS2.types
    time = make["builtin_interfaces/msg/Time"](sec=5, nanosec=7)
    store = get_typestore(Stores.ROS2_HUMBLE)
    text = (
        "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose\nuint32 point_stride\n"
        "foxglove_msgs/PackedElementField[] fields\nuint8[] data\n"
    )
    kind, field = "foxglove_msgs/msg/PointCloud", "foxglove_msgs/msg/PackedElementField"
    store.register(get_types_from_msg("uint8 FLOAT32=7\nstring name\nuint32 offset\nuint8 type\n", field))
    store.register(get_types_from_msg(text, kind))
    point = make["geometry_msgs/msg/Point"](x=1.0, y=0.0, z=0.0)
    turn = make["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    message = store.types[kind](
        timestamp=time,
        frame_id="/lidar",
        pose=make["geometry_msgs/msg/Pose"](position=point, orientation=turn),
        point_stride=12,
        fields=[store.types[field](name=name, offset=4 * i, type=7) for i, name in enumerate("xyz")],
        data=np.frombuffer(np.arange(1, 7, dtype="<f4").tobytes(), np.uint8),
    )
    raw = bytes(store.serialize_cdr(message, kind))
    for definition in (store.generate_msgdef(kind, ros_version=2)[0], ""):
        topic = Topic("/lidar", kind, 1, "cdr", definition, "msg" if definition else "")
        assert cloud(topic, raw).xyz.tolist() == [[2, 2, 3], [5, 5, 6]]
        assert (head(topic, raw).stamp, head(topic, raw).frame) == (5_000_000_007, "lidar")


@pytest.mark.parametrize(
    ("time", "stamp"),
    [
        ({"sec": 5, "nsec": 7}, 5_000_000_007),
        ("2023-11-14T22:13:20Z", 1_700_000_000_000_000_000),
        ("2023-11-14T22:13:20.123456789Z", 1_700_000_000_123_456_789),
        ("2023-11-14T23:13:20.5+01:00", 1_700_000_000_500_000_000),
        ("2023-11-14t22:13:20.000000001z", 1_700_000_000_000_000_001),
        ("2023-11-14T22:13:20", 1_700_000_000_000_000_000),
    ],
)
def test_times_in_json(time, stamp):
    text = json.dumps({"timestamp": time, "frame_id": "map", "pose": {"position": {"x": 1}}})
    found = pose(Topic("/pose", "foxglove.PoseInFrame", 1, "json"), text.encode())
    assert (found.stamp, found.parent, found.values) == (stamp, "map", (1, 0, 0, 0, 0, 0, 1))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"timestamp": None}, "it has no timestamp"),
        ({"timestamp": "yesterday"}, "no RFC 3339"),
        ({"timestamp": "2023-02-30T00:00:00Z"}, "day is out of range"),
        ({"timestamp": {"sec": 2**62, "nsec": 0}}, "its timestamp is"),
        ({"timestamp": 5}, "no known form"),
        ({"frame_id": 5}, "its frame_id is no text"),
        ({"pose": {"position": [1, 2, 3]}}, "has no x"),
        ({"pose": {"position": {"x": math.nan}}}, "its pose is no place"),
        ({"pose": {"position": {"x": "far"}}}, "could not convert"),
        ({"pose": None}, "it has no pose"),
    ],
)
def test_json_that_is_not_what_it_should_be(changes, reason):
    values = {"timestamp": {"sec": 1, "nsec": 0}, "frame_id": "map", "pose": {}} | changes
    with pytest.raises(UndecodableError, match=reason):
        pose(Topic("/pose", "foxglove.PoseInFrame", 1, "json"), json.dumps(values).encode())


def test_bytes_that_are_no_message(encoding):
    topic, raw = foxglove.topic_of(foxglove.cloud(START, POINTS), encoding)
    for broken in (b"\xff" * 40, raw[: len(raw) // 2], b"[1]" if encoding == "json" else b"\x08"):
        with pytest.raises(UndecodableError):
            head(topic, broken)
    with pytest.raises(UndecodableError):
        transforms(Topic("/tf", "foxglove.FrameTransform", 1, encoding, schema=b"\xff"), raw)
    nested = b"[" * 100_000
    with pytest.raises(UndecodableError):
        head(Topic("/lidar", "foxglove.PointCloud", 1, "json"), nested)


def test_clouds_that_lie(encoding):
    message = foxglove.cloud(START, POINTS)
    message.point_stride = 17
    with pytest.raises(UnreadableCloudError, match="800 bytes are no whole points of 17"):
        cloud(*foxglove.topic_of(message, encoding))
    message.point_stride = 0
    with pytest.raises(UnreadableCloudError, match="800 bytes are no whole points of 0"):
        cloud(*foxglove.topic_of(message, encoding))
    message.point_stride = 10
    with pytest.raises(UnreadableCloudError, match="field z ends at 12 of 10"):
        cloud(*foxglove.topic_of(message, encoding))
    message.fields[0].type = 0
    with pytest.raises(UnreadableCloudError, match="x is of the unknown datatype 0"):
        cloud(*foxglove.topic_of(message, encoding))


def test_protobuf_without_its_library_is_told_in_one_line(tmp_path, monkeypatch):
    path = foxglove.write(tmp_path / "log.mcap", by_time(drive()))
    # What importing does where a package is not installed.
    monkeypatch.setitem(sys.modules, "google.protobuf", None)
    with pytest.raises(LogError) as caught:
        read_recording(path, LogSection())
    assert str(caught.value) == (
        f"{path}: /lidar is foxglove.PointCloud as protobuf, which needs an extra: "
        "pip install 'gapeval[foxglove]'"
    )
