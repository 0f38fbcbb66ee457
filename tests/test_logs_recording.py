"""From a file to frames: what is matched, what is refused, and what is said about it."""

import math
import pickle

import numpy as np
from logs_checks import frames_of, line
from logs_writer import (
    HERE,
    POINTS,
    ROS2,
    START,
    STEP,
    Record,
    cloud_message,
    cloud_record,
    clouds,
    driving,
    lidar,
    stamps,
    static_record,
    write_log,
    yaw_quaternion,
)

from gapeval.config import LogSection, StaticTransform
from gapeval.frame import Frame, Transform
from gapeval.logs.read import RefusedScan, describe, read_frames, read_recording, render
from gapeval.logs.read.playback import scan_digest

# What a recording is


def test_a_recording_and_its_frames(tmp_path):
    poses = [(stamp, 0.1 * i, -0.2 * i, 0.3) for i, stamp in enumerate(stamps(12, -1))]
    path = write_log(
        tmp_path / "log", clouds=[(s + 50_000_000, POINTS) for s in stamps(5)], poses=poses, sensor_height=1.5
    )
    seen = []
    recording = read_recording(path, LogSection(), lambda done, total: seen.append((done, total)))
    assert seen == [(i, 18) for i in range(1, 19)]
    assert recording.container == "MCAP"
    assert (recording.cloud_topic, recording.pose_source) == ("/points", "tf")
    assert (recording.robot_frame, recording.fixed_frame) == ("base_link", "map")
    assert (recording.sensor_frame, recording.cloud_frames) == ("lidar", ("lidar",))
    assert (recording.matched, recording.total, recording.refused) == (5, 5, {})
    frames = list(read_frames(pickle.loads(pickle.dumps(recording)), 0, 5))
    for i, frame in enumerate(frames):
        assert frame.stamp == START + i * STEP + 50_000_000
        assert frame.points.dtype == np.float32
        np.testing.assert_allclose(frame.points, np.add(POINTS, [0, 0, 1.5]), atol=1e-5)
        assert frame.sensor.translation.tolist() == [0, 0, 1.5]
        np.testing.assert_allclose(frame.pose.translation, [0.1 * (i + 1.5), -0.2 * (i + 1.5), 0], atol=1e-12)
        np.testing.assert_allclose(frame.pose.quaternion, yaw_quaternion(0.3), atol=1e-12)
        assert frame.lowest_elevation == recording.lowest_elevation
    elevation = np.tile(np.arctan2(POINTS[:, 2], np.hypot(POINTS[:, 0], POINTS[:, 1])), 5)
    assert math.isclose(recording.lowest_elevation, np.quantile(elevation, 0.005), abs_tol=1e-5)


def test_frames_are_read_from_any_place(tmp_path):
    rng = np.random.default_rng(0)
    given = [(stamp, rng.normal(size=(20, 3))) for stamp in stamps(9)]
    path = write_log(tmp_path / "log", clouds=given, poses=[(s, 0, 0, 0) for s in stamps(9)], container="bag")
    recording = read_recording(path, LogSection())
    every = [frame.digest for frame in read_frames(recording, 0, 9)]
    assert len(set(every)) == 9
    for first, last in ((0, 1), (4, 7), (8, 9), (8, 50), (3, 3), (9, 12)):
        assert [f.digest for f in read_frames(recording, first, last)] == every[first:last]


def test_the_digest_is_over_all_that_was_decoded(tmp_path):
    def digest(points=POINTS, stamp=START, x=0.0, height=1.0):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        write_log(path, clouds=[(stamp, points)], poses=[(stamp, x, 0, 0)], sensor_height=height)
        return frames_of(path)[0].digest

    assert digest() == digest()
    moved = POINTS.copy()
    moved[7, 1] += 1e-3
    others = [
        digest(moved),
        digest(POINTS[:-1]),
        digest(stamp=START + 1),
        digest(x=1e-3),
        digest(height=1.001),
    ]
    assert len({digest(), *others}) == 6


def test_the_digest_is_the_same_where_transforms_differ_in_their_last_bits():
    """As between processors: a sine may end otherwise, what a log holds does not."""
    turned = Transform.of([0.25, 1 / 3, 0.6], [0.1, -0.2, 0.3, 0.9])
    other = Transform(np.nextafter(turned.translation, 9), np.nextafter(turned.quaternion, -9))
    moved = Transform(turned.translation + np.array([0, 1e-3, 0]), turned.quaternion)
    one, last_bits, moved_by_a_millimetre = (
        scan_digest(START, POINTS, (placed, None)) for placed in (turned, other, moved)
    )
    assert turned != other
    assert one == last_bits != moved_by_a_millimetre


def test_the_lowest_elevation_may_be_given(log):
    path = log(lidar(), driving(), clouds())
    settings = LogSection(lowest_elevation={"log": -0.25, "other": 1.0})
    assert read_recording(path, settings).lowest_elevation == -0.25


def test_the_lowest_elevation_is_of_the_first_ten_clouds_that_can_be_read(log):
    low = np.array([[5.0, 0, -5.0]])
    unreadable = [cloud_record(stamp, np.full((3, 3), np.nan)) for stamp in stamps(2)]
    path = log(
        lidar(), driving(count=20), unreadable, clouds(10, first=2), [cloud_record(START + 12 * STEP, low)]
    )
    recording = read_recording(path, LogSection())
    elevation = np.arctan2(POINTS[:, 2], np.hypot(POINTS[:, 0], POINTS[:, 1]))
    assert math.isclose(recording.lowest_elevation, np.quantile(np.tile(elevation, 10), 0.005), abs_tol=1e-5)


# Matching


def test_no_way_between_frames(log):
    path = log(lidar(), driving(), clouds(frame="velodyne"))
    assert line(path) == (
        "none of 10 clouds has a transform base_link<-velodyne (velodyne is not in tf; "
        "frames: base_link, lidar, map); add it with `log: transforms:` in the configuration"
    )
    added = StaticTransform(parent="base_link", child="velodyne")
    assert len(frames_of(path, LogSection(transforms=(added,)))) == 10


def test_too_few_matches(log):
    path = log(lidar(), driving(count=4), clouds())
    assert line(path) == (
        "only 3 of 10 clouds have a transform map<-base_link (tf covers 0.0-0.3 s, clouds 0.1-1.0 s); "
        "record /tf for the whole time or lower --min-matched"
    )
    recording = read_recording(path, LogSection(min_matched=0.3))
    reason = "no transform map<-base_link at their stamps: tf ends up to 0.7 s earlier"
    assert recording.refused == {reason: 7}
    assert recording.examples == {reason: tuple(stamps(3, 3))}
    assert [frame.stamp for frame in read_frames(recording, 0, 9)] == stamps(3)


def test_no_overlap_in_time(log):
    path = log(lidar(), driving(count=4, first=20), clouds())
    text = line(path, LogSection(min_matched=0.0))
    assert text.startswith(
        "none of 10 clouds has a transform map<-base_link (tf covers 2.0-2.3 s, clouds 0.0-0.9"
    )
    assert "no overlap in time" in text


def test_a_sensor_with_a_clock_of_its_own(log):
    records = [
        Record(record.topic, record.type, record.time, cloud_record(i * STEP, POINTS).build)
        for i, record in enumerate(clouds())
    ]
    path = log(lidar(), driving(), records)
    text = line(path)
    assert "tf covers 1699999999.9-1700000001.0 s, clouds 0.0-0.9 s: no overlap in time" in text
    assert text.endswith("their bag times do overlap: try -p log.stamps=bag")
    assert [frame.stamp for frame in frames_of(path, LogSection(stamps="bag"))] == stamps(10)


def test_gaps_in_tf(log):
    path = log(lidar(), driving(count=2), driving(count=3, first=8), clouds())
    text = line(path)
    assert (
        "(tf has gaps of more than 0.5 s); raise it with -p log.max_tf_gap=... or lower --min-matched" in text
    )
    assert len(frames_of(path, LogSection(max_tf_gap=1.0))) == 10
    recording = read_recording(path, LogSection(min_matched=0.1))
    assert recording.refused == {
        "no transform map<-base_link at their stamps: tf has a gap of up to 0.8 s": 7
    }


def test_repeated_stamps_are_refused_and_counted(log):
    again = [Record(r.topic, r.type, r.time + 5, r.build) for r in clouds(3)]
    path = log(lidar(), driving(), clouds(), again)
    recording = read_recording(path, LogSection())
    assert recording.refused == {"stamp repeated": 3}
    assert (recording.matched, recording.total) == (10, 13)
    assert [frame.stamp for frame in read_frames(recording, 0, 20)] == stamps(10)


def test_clouds_of_changing_frames(log):
    path = log(
        static_record(
            START, [("base_link", "lidar", (0, 0, 1), HERE), ("base_link", "rear", (-1, 0, 1), HERE)]
        ),
        driving(count=20),
        clouds(6),
        clouds(3, "rear", first=6),
        clouds(1, "nowhere", first=9),
        clouds(1, "base_link", first=10),
    )
    recording = read_recording(path, LogSection())
    assert recording.cloud_frames == ("lidar", "rear", "nowhere", "base_link")
    assert recording.refused == {
        "no transform base_link<-nowhere: not connected": 1,
        "cloud in base_link, which is not a laser's own frame": 1,
    }
    places = [frame.sensor.translation[0] for frame in read_frames(recording, 0, 9)]
    assert places == [0] * 6 + [-1] * 3


def test_two_parents(log):
    path = log(lidar(), driving(), static_record(START, [("cart", "base_link", (0, 0, 0), HERE)]), clouds())
    assert line(path).startswith("frame base_link has two parents, ")


# Clouds that hold nothing


def test_clouds_that_hold_nothing_are_refused_one_by_one(log):
    lying = cloud_record(START + 3 * STEP, POINTS, width=51)
    unnamed = cloud_record(START + 4 * STEP, POINTS, fields=[("a", 0, 7, 1)])
    records = [
        cloud_record(START, np.zeros((0, 3))),
        cloud_record(START + STEP, np.full((5, 3), np.nan)),
        cloud_record(START + 2 * STEP, np.zeros((5, 3))),
        lying,
        unnamed,
        *clouds(2, first=5),
    ]
    items = frames_of(log(lidar(), driving(), records))
    assert [item.stamp for item in items] == stamps(7)
    assert [item.reason for item in items[:5] if isinstance(item, RefusedScan)] == [
        "empty cloud",
        "no finite point",
        "no finite point",
        "header lies about its size",
        "no usable x, y, z fields",
    ]
    assert str(items[3]) == "header lies about its size: 1 x 51 points need 816 bytes, it has 800"
    assert [isinstance(item, Frame) for item in items[5:]] == [True, True]


def test_a_log_of_clouds_that_hold_nothing(log):
    records = [cloud_record(stamp, np.zeros((i % 2, 3))) for i, stamp in enumerate(stamps(5))]
    text = line(log(lidar(), driving(), records))
    assert (
        text == "no cloud holds a point to detect in (3 x empty cloud; 2 x no finite point); record it again"
    )


def test_a_log_in_which_no_cloud_can_be_decoded(log):
    records = [Record(r.topic, r.type, r.time, raw=b"\0\1\0\0abc") for r in clouds(3)]
    assert line(log(lidar(), driving(), records)).startswith("no cloud on /points can be decoded: ")


def test_a_file_that_changed_since_it_was_surveyed(log):
    path = log(lidar(), driving(), clouds())
    recording = read_recording(path, LogSection())
    path.unlink()
    log(lidar(), driving(), clouds(3), clouds(3, first=6))
    items = list(read_frames(recording, 0, 10))
    assert [item.stamp for item in items] == stamps(10)
    lost = [str(item) for item in items if isinstance(item, RefusedScan)]
    assert lost == ["not found again in the log"] * 4


# Describing


def test_a_description_says_all_of_it(log):
    path = log(lidar(), driving(), clouds(), clouds(2, first=20))
    description = describe(path, LogSection())
    assert description.problem is None
    text = render(description)
    for part in (
        f"{path}: MCAP, 2.2 s",
        "/points     sensor_msgs/PointCloud2  12",
        "clouds on /points: frame lidar, 50 x 1, 5.24 Hz",
        "16 bytes per point, little-endian; first cloud: 50 points, 0 NaN or infinite, 0 at (0, 0, 0)",
        "intensity  float32  at 12",
        "base_link <- lidar  static   1 x            /tf_static",
        "map <- base_link    dynamic  12 x, 10.0 Hz  /tf",
        "robot base_link, fixed map, sensor lidar",
        "10 of 12 have all transforms",
        "2 x no transform map<-base_link at their stamps: tf ends up to 1.1 s earlier (e.g. 17000000020000",
    ):
        assert part in text
    values = description.to_dict()
    assert values["choice"]["first_stamp"] == str(START)
    assert values["choice"]["examples"] == {
        "no transform map<-base_link at their stamps: tf ends up to 1.1 s earlier": [
            str(START + 20 * STEP),
            str(START + 21 * STEP),
        ]
    }
    assert values["clouds"][0]["fields"][2] == {"name": "z", "type": "float32", "offset": 8, "count": 1}


def test_a_description_of_a_log_that_cannot_be_swept(log):
    description = describe(log(lidar(), driving()), LogSection())
    assert [edge.parent for edge in description.transforms] == ["base_link", "map"]
    assert description.choice is None
    assert "cannot be swept: " in render(description)
    assert description.to_dict()["choice"] is None


def test_a_description_of_a_cloud_that_cannot_be_read(log):
    path = log(lidar(), driving(), [cloud_record(START, POINTS, width=51)], clouds(3, first=1))
    description = describe(path, LogSection())
    assert description.clouds[0].problem.startswith("header lies about its size")
    assert "  cannot be read: header lies about its size" in render(description)
    assert cloud_message(ROS2, START, "lidar", POINTS).width == 50
