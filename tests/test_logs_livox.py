"""Livox's CustomMsg, written by rosbags by the drivers' definition: its points and when each was measured."""

import numpy as np
import pytest
from logs_writer import (
    LIVOX_DRIVERS,
    LIVOX_MESSAGE,
    LIVOX_POINT,
    ROS1,
    ROS2,
    START,
    Record,
    driving,
    header,
    lidar,
    stamps,
    write_sorted,
)

from gapeval.config import LogSection
from gapeval.logs.read import read_frames, read_recording
from gapeval.logs.read.container import HEAD, Topic
from gapeval.logs.read.messages.content import (
    UndecodableError,
    UnreadableCloudError,
    cloud,
    head,
    head_suffices,
    timed_cloud,
)

DRIVERS = LIVOX_DRIVERS
WAYS = ("ros1", "cdr", "cdr big")


def written(way, points, offsets, stamp=START, timebase=None, driver=DRIVERS[0]):
    """(topic, raw) of a message of points (n, 3), measured at offsets [ns] after the time base."""
    store, kind = ROS1 if way == "ros1" else ROS2, f"{driver}/msg/CustomMsg"
    make = store.types[f"{driver}/msg/CustomPoint"]
    items = [
        make(offset_time=int(t), x=float(x), y=float(y), z=float(z), reflectivity=i % 256, tag=16, line=i % 6)
        for i, ((x, y, z), t) in enumerate(zip(points, offsets, strict=True))
    ]
    message = store.types[kind](
        header=header(store, stamp, "livox_frame"),
        timebase=stamp if timebase is None else timebase,
        point_num=len(items),
        lidar_id=1,
        rsvd=np.zeros(3, np.uint8),
        points=items,
    )
    if way == "ros1":
        raw = store.serialize_ros1(message, kind)
    else:
        raw = store.serialize_cdr(message, kind, little_endian=way == "cdr")
    return Topic("/livox/lidar", kind, 1, way[:4].strip()), bytes(raw)


@pytest.mark.parametrize("driver", DRIVERS)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("count", [1, 2, 3, 200])
def test_points_and_times(way, driver, count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3)).astype(np.float32)
    offsets = np.linspace(0, 99_000_000, count).astype(int)
    topic, raw = written(way, points, offsets, timebase=START + 3_000, driver=driver)
    assert np.array_equal(cloud(topic, raw).xyz, points)
    assert head_suffices(topic)
    assert (head(topic, raw[:HEAD]).stamp, head(topic, raw[:HEAD]).frame) == (START, "livox_frame")
    if count > 1:
        timed = timed_cloud(topic, raw)
        assert np.array_equal(timed.points.xyz, points)
        assert timed.nanoseconds.tolist() == (offsets + 3_000).tolist()


def test_a_time_base_of_another_clock_is_not_believed():
    points = np.ones((3, 3))
    timed = timed_cloud(*written("cdr", points, [0, 50_000_000, 100_000_000], timebase=123_456))
    assert timed.nanoseconds.tolist() == [0, 50_000_000, 100_000_000]


def test_points_at_the_origin_are_left_out_with_their_times():
    points = [[1, 2, 3], [0, 0, 0], [4, 5, 6], [np.nan, 0, 0], [7, 8, 9]]
    timed = timed_cloud(*written("cdr", points, [0, 1, 20_000_000, 3, 40_000_000]))
    assert timed.points.xyz.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert timed.nanoseconds.tolist() == [0, 20_000_000, 40_000_000]
    assert (timed.points.zero, timed.points.not_finite) == (1, 1)


@pytest.mark.parametrize("way", WAYS)
def test_messages_that_lie_are_refused(way):
    topic, raw = written(way, np.ones((5, 3)), range(5))
    for cut in (1, 19, 60, 100, len(raw) - 3):
        with pytest.raises(UndecodableError):
            cloud(topic, raw[:-cut])
    with pytest.raises(UndecodableError, match="5 points need"):
        cloud(topic, raw + bytes(4))
    # The length of the array, which stands right before the points.
    at = len(raw) - (95 if way == "ros1" else 99) - 4
    order = "big" if way == "cdr big" else "little"
    assert int.from_bytes(raw[at : at + 4], order) == 5
    for count in (0, 4, 6, 2**32 - 1):
        with pytest.raises(UndecodableError, match=f"{count} points need"):
            cloud(topic, raw[:at] + count.to_bytes(4, order) + raw[at + 4 :])
    with pytest.raises(UnreadableCloudError, match="empty cloud"):
        cloud(*written(way, [], []))


def test_another_definition_is_not_taken_for_this_one():
    topic, raw = written("cdr", np.ones((5, 3)), range(5))
    text = (
        LIVOX_MESSAGE
        + "\n"
        + "=" * 80
        + "\nMSG: livox_ros_driver/CustomPoint\n"
        + LIVOX_POINT
        + "\nuint8 more\n"
    )
    text += "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    with pytest.raises(UndecodableError, match="not the one of Livox's drivers"):
        cloud(Topic(topic.name, topic.type, 1, "cdr", text, "msg"), raw)


@pytest.mark.parametrize("container", ["bag", "mcap", "sqlite3"])
def test_a_log_of_them_is_read(tmp_path, container):
    """With the drivers' definition in the log."""
    way = "ros1" if container == "bag" else "cdr"
    points = (np.random.default_rng(1).normal(size=(50, 3)) * 3).astype(np.float32)
    records = [
        Record("/livox", f"{DRIVERS[1]}/msg/CustomMsg", stamp, raw=written(way, points, range(50), stamp)[1])
        for stamp in stamps(10)
    ]
    path = write_sorted(tmp_path / "log", lidar(child="livox_frame"), driving(), records, container=container)
    recording = read_recording(path, LogSection())
    assert (recording.matched, recording.sensor_frame) == (10, "livox_frame")
    frames = list(read_frames(recording, 0, 10))
    np.testing.assert_allclose(frames[0].points, points + np.array([0, 0, 1]), atol=1e-5)
