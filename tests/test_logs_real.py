"""The real recordings, where GAPEVAL_DATA says where they are."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from gapeval.config import LogSection, StaticTransform
from gapeval.errors import LogError
from gapeval.logs.read import describe, read_frames, read_recording
from gapeval.logs.read.container import Topic
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.messages.content import cloud, time_field, timed_cloud
from gapeval.logs.read.messages.message import POINT_CLOUD

pytestmark = pytest.mark.skipif(
    "GAPEVAL_DATA" not in os.environ, reason="GAPEVAL_DATA does not name the folder of real logs"
)
DATA = Path(os.environ.get("GAPEVAL_DATA", ""))


def test_the_mcap_and_the_bag_of_one_drive_are_the_same_log():
    digests = {}
    for suffix in ("mcap", "bag"):
        recording = read_recording(DATA / f"os1_street/os1_street.{suffix}", LogSection())
        assert (recording.matched, recording.total, recording.refused) == (3, 3, {})
        assert (recording.robot_frame, recording.fixed_frame) == ("base_link", "map")
        assert recording.sensor_frame == "os_sensor"
        frames = list(read_frames(recording, 0, 3))
        assert [len(frame.points) for frame in frames] == [107_647, 107_357, 107_532]
        # An OS1-128 sees down to 22.5 degrees below its equator.
        assert -22.6 < np.degrees(recording.lowest_elevation) < -20
        np.testing.assert_allclose(frames[0].sensor.translation, [1.1, 0.05, 1.93], atol=1e-3)
        assert np.abs(frames[0].pose.translation).max() < 1e-9
        digests[suffix] = [frame.digest for frame in frames]
    assert digests["mcap"] == digests["bag"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (
            "laserscan_tf",
            "the planar laser on /zed/scan_merged does not turn against base_link, so its scans make no "
            "clouds; gapeval needs clouds, or planar scans of a laser that turns by tf",
        ),
        (
            "two_laserscans_no_tf",
            "no clouds and no transforms: the log has planar scans on /front_scan (331), /rear_scan (330), "
            "of which gapeval makes clouds only where /tf tells how the laser turns",
        ),
        (
            "ouster_packets_no_cloud",
            "no clouds: gapeval reads PointCloud2, LaserScan, MultiEchoLaserScan, and what Livox and "
            "Foxglove have for them, and the log has ouster_ros/PacketMsg on /os_node0/imu_packets (10), "
            "ouster_ros/PacketMsg on /os_node0/lidar_packets (32)",
        ),
        (
            "damaged_index",
            "no clouds and no transforms: the log has planar scans on /scan (360), of which gapeval makes "
            "clouds only where /tf tells how the laser turns",
        ),
    ],
)
def test_logs_that_cannot_be_used_say_so_in_one_line(name, expected):
    path = DATA / f"logs/{name}.bag"
    with pytest.raises(LogError) as caught:
        read_recording(path, LogSection())
    assert str(caught.value) == f"{path}: {expected}"


def test_every_message_of_a_bag_with_a_damaged_index_is_read():
    """The indexes behind its chunks are of odd length, so rosbags refuses it."""
    path = DATA / "logs/damaged_index.bag"
    data = path.read_bytes()
    with open_container(path) as container:
        times = [time for _, time, _ in container.messages(["/scan"], None, None)]
        heads = [time for _, time, _ in container.heads(["/scan"], (), None, None)]
        assert container.losses == []
    # Every message's header ends with its time.
    heads_by_hand = re.findall(rb"\x04\x00\x00\x00op=\x02\x0d\x00\x00\x00time=(.{4})(.{4})", data, re.DOTALL)
    by_hand = [
        int.from_bytes(seconds, "little") * 10**9 + int.from_bytes(rest, "little")
        for seconds, rest in heads_by_hand
    ]
    assert len(by_hand) == 360
    assert times == heads == sorted(by_hand)


def test_tf_of_a_log_without_clouds_is_described():
    edges = describe(DATA / "logs/laserscan_tf.bag", LogSection()).transforms
    found = {f"{edge.parent}<-{edge.child}": edge.count for edge in edges}
    assert found["odom<-base_link"] > 100
    assert found["base_link<-laser_front"] > 1000


def test_a_cloud_of_26_byte_points():
    raw = (DATA / "clouds/pointcloud2_cdr_26byte_step.bin").read_bytes()
    topic = Topic("/points", POINT_CLOUD, 1, "cdr")
    points = cloud(topic, raw)
    assert len(points.xyz) + points.not_finite + points.zero == 64_000
    assert len(points.xyz) > 30_000
    assert 5 < np.linalg.norm(points.xyz, axis=1).max() < 300
    timed, found = timed_cloud(topic, raw), time_field(topic, raw)
    assert np.array_equal(timed.points.xyz, points.xyz)
    # Half a turn at 10 Hz, from the stamp on.
    assert (found.name, found.type, found.unit, found.origin) == ("timestamp", "float64", "s", "absolute")
    assert (timed.nanoseconds.min(), timed.nanoseconds.max()) == (0, 49_806_118)
    # Points are in the order in which they were measured.
    assert (np.diff(timed.nanoseconds) >= 0).all()


def test_times_that_a_driver_left_empty_are_none():
    for suffix in ("mcap", "bag"):
        (found,) = describe(DATA / f"os1_street/os1_street.{suffix}", LogSection()).clouds
        assert found.time is None
        assert "goes from 0 to 0, which is no scan" in found.no_time


def test_a_folder_of_one_pcd_file(tmp_path):
    """An HDL-32, 1.98 m up."""
    path = DATA / "clouds/hdl32_tilted_6deg.pcd"
    shutil.copy(path, tmp_path / "1700000000.5.pcd")
    (tmp_path / "poses.tum").write_text("1700000000.5 0 0 1.98 0 0 0 1\n")
    mount = StaticTransform(parent="base_link", child="lidar", translation=(0.0, 0.0, 1.98))
    recording = read_recording(tmp_path, LogSection(transforms=(mount,)))
    (frame,) = read_frames(recording, 0, 1)
    assert (recording.container, frame.dropped) == ("folder of pcd", 5_032)
    assert -45 < np.degrees(recording.lowest_elevation) < -20
    rows = np.frombuffer(path.read_bytes().partition(b"DATA binary\n")[2], "<f4").reshape(-1, 4)[:, :3]
    expected = rows[rows.any(axis=1)]
    assert len(expected) == 64_056
    np.testing.assert_allclose(frame.points, expected + np.float32([0, 0, 1.98]), atol=1e-5)
