"""Clouds of several messages: gathered over time, of several sensors, with each point at its own time."""

from dataclasses import replace

import numpy as np
import pytest
from logs_checks import frames_of, line
from logs_writer import Record, odometry_record, static_record, write_sorted
from moving_robot import (
    MOUNT,
    REAR,
    SECOND,
    START,
    STILL,
    cloud,
    imu,
    into_robot,
    pose,
    poses,
    skewed,
    tf,
    timed_cloud,
)

from gapeval.config import BodyBox, LogSection
from gapeval.errors import LogError
from gapeval.frame import Frame
from gapeval.logs.read import RefusedScan, preparation, read_frames, read_recording
from gapeval.logs.read.transforms import product

CONTAINERS = ("mcap-lz4", "bag", "sqlite3")
STAMPS = [START + i * SECOND // 10 for i in range(12)]
RING = 40  # points of each sparse scan
NOW = np.zeros(len(STILL), dtype=np.int64)


def there(stamp, points=STILL):
    """Where points of the map are from the robot at a stamp."""
    return into_robot(points, np.full(len(points), stamp))


def sparse(stamp, mount=MOUNT, frame="lidar", topic="/points"):
    """A scan that sees only some of the points, others each time."""
    first = RING * ((stamp - START) * 10 // SECOND % 10)
    return cloud(stamp, skewed(stamp, NOW, mount)[first : first + RING], frame, topic)


def seen(stamp, scans):
    """The points that so many sparse scans up to a stamp saw."""
    last = (stamp - START) * 10 // SECOND
    numbers = [RING * (i % 10) + k for i in range(last - scans + 1, last + 1) for k in range(RING)]
    return STILL[numbers]


def settings(**log):
    return LogSection.model_validate(log)


@pytest.fixture(scope="module", params=CONTAINERS)
def sparse_log(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "log"
    return write_sorted(path, tf(1.2, lidar=MOUNT), [sparse(s) for s in STAMPS], container=request.param)


@pytest.mark.parametrize("window", [{"scans": 3}, {"seconds": 0.3}])
def test_accumulated_scans_lie_where_the_world_is_at_the_last_stamp(sparse_log, window):
    frames = frames_of(sparse_log, settings(accumulate=window))
    # Before the third scan there is not enough to gather.
    assert [frame.stamp for frame in frames] == STAMPS[2:]
    for frame in frames:
        assert isinstance(frame, Frame)
        np.testing.assert_allclose(frame.points, there(frame.stamp, seen(frame.stamp, 3)), atol=2e-4)


def test_clouds_before_a_full_window_are_refused_and_counted(sparse_log):
    recording = read_recording(sparse_log, settings(accumulate={"scans": 5}))
    assert (recording.total, recording.matched) == (12, 8)
    assert recording.refused == {"begins before enough scans are there to accumulate": 4}


def test_the_places_that_scans_were_made_at_stay_known(sparse_log):
    """Viewpoints nearer than 0.1 m to each other count as one: the robot does 0.06 m per scan."""
    frame = frames_of(sparse_log, settings(accumulate={"scans": 6}))[-1]
    places = [frame.sensor.translation, *(view.mount.translation for view in frame.others)]
    true = []
    for stamp in STAMPS[-6:]:
        at = pose(stamp).apply(MOUNT.translation)
        true.append(into_robot(at[None], [frame.stamp])[0])
    assert 1 <= len(frame.others) <= 5
    for place in places:
        assert np.linalg.norm(np.array(true) - place, axis=1).min() < 1e-4
    apart = np.linalg.norm(np.array(places)[:, None] - np.array(places)[None], axis=2)
    assert apart[~np.eye(len(places), dtype=bool)].min() > 0.1
    for lost in true:
        assert np.linalg.norm(np.array(places) - lost, axis=1).min() <= 0.1
    (alone,) = frames_of(sparse_log, settings(start=1.05, end=1.15))
    assert alone.others == ()


def test_each_cloud_is_the_same_wherever_reading_begins(sparse_log):
    recording = read_recording(sparse_log, settings(accumulate={"scans": 4}))
    every = list(read_frames(recording, 0, recording.matched))
    for index in (7, 0, 3):
        (alone,) = read_frames(recording, index, index + 1)
        assert alone.points.tobytes() == every[index].points.tobytes()
        assert alone.digest == every[index].digest
    assert len({frame.digest for frame in every}) == len(every)


def test_what_is_gathered_needs_poses(tmp_path):
    still = [sparse(s) for s in STAMPS]
    path = write_sorted(tmp_path / "log", tf(0, lidar=MOUNT)[:1], still)
    assert line(path, settings(accumulate={"scans": 2})) == (
        "log.accumulate needs the robot's poses, and there are none; record /tf or odometry"
    )
    assert line(path, settings(deskew=True)).startswith("log.deskew needs the time of each point of /points")


# Several sensors


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Two lasers that see other points, the rear one 30 ms later and at half the rate."""
    front = [sparse(stamp) for stamp in STAMPS]
    rear = [sparse(stamp + 3 * SECOND // 100, REAR, "rear", "/rear") for stamp in STAMPS[::2]]
    path = tmp_path_factory.mktemp("log") / "log"
    return write_sorted(path, tf(1.2, lidar=MOUNT, rear=REAR), front, rear)


def test_clouds_of_several_sensors_are_merged_at_the_first_ones_stamps(two):
    recording = read_recording(two, settings(cloud_topics=["/points", "/rear"]))
    frames = list(read_frames(recording, 0, recording.matched))
    assert recording.cloud_topic == "/points + /rear"
    assert [frame.stamp for frame in frames] == STAMPS
    for number, frame in enumerate(frames):
        own, other = seen(frame.stamp, 1), seen(STAMPS[number // 2 * 2], 1)
        expected = there(frame.stamp, np.vstack([own, other]))
        assert len(frame.points) == 2 * RING
        apart = np.linalg.norm(frame.points[:, None] - expected[None], axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 2e-4
        (rear,) = frame.others
        # As far as the robot drives between the two.
        assert 0 < np.linalg.norm(rear.mount.translation - REAR.translation) < 0.06


def test_each_sensor_has_its_own_lowest_ray(two):
    recording = read_recording(two, settings(cloud_topics=["/points", "/rear"]))
    for number, name in enumerate(("/points", "/rear")):
        alone = read_recording(two, settings(cloud_topic=name))
        assert recording.lowest_elevations[number] == pytest.approx(alone.lowest_elevation, abs=1e-6)
    assert recording.lowest_elevations[0] != recording.lowest_elevations[1]


def test_a_merged_cloud_without_its_partner_is_refused(tmp_path):
    front = [sparse(stamp) for stamp in STAMPS]
    rear = [sparse(stamp, REAR, "rear", "/rear") for stamp in STAMPS[:6]]
    path = write_sorted(tmp_path / "log", tf(1.2, lidar=MOUNT, rear=REAR), front, rear)
    recording = read_recording(path, settings(cloud_topics=["/points", "/rear"]))
    assert recording.scans.stamps.tolist() == STAMPS[:6]
    assert recording.refused == {"no cloud of /rear within half its period": 6}
    assert line(path, settings(cloud_topics=["/points", "/points"])).startswith("a topic is named twice")


def test_all_clouds_of_the_first_topic_count_where_several_are_merged(tmp_path):
    """Also those that have no transform, which are told, scan by scan, beside those of the others."""
    front = [sparse(stamp) for stamp in STAMPS]
    rear = [sparse(stamp, REAR, "rear", "/rear") for stamp in STAMPS]
    path = write_sorted(tmp_path / "log", tf(0.25, lidar=MOUNT, rear=REAR), front, rear)
    recording = read_recording(path, settings(cloud_topics=["/points", "/rear"]))
    assert (recording.total, recording.matched) == (12, 8)
    assert recording.refused == {}
    told = [notice.split() for notice in recording.notices if notice.startswith("left out")]
    assert sum(int(words[2]) for words in told) == 8
    assert all(words[3:6] == ["scans:", "no", "transform"] for words in told)


def test_one_sensor_frame_for_several_topics_is_told(two):
    named = read_recording(two, settings(cloud_topics=["/points", "/rear"], sensor_frame="lidar"))
    told = "log.sensor_frame: all of /points + /rear count as seen from there"
    assert told in named.notices
    assert told not in read_recording(two, settings(cloud_topic="/points", sensor_frame="lidar")).notices
    for frame in read_frames(named, 0, 2):
        assert np.linalg.norm(frame.sensor.translation - MOUNT.translation) < 1e-6


# Points at their own times


TIMES = np.sort(np.random.default_rng(3).integers(0, SECOND // 10, len(STILL)))


@pytest.fixture(scope="module")
def skewed_log(tmp_path_factory):
    clouds = [timed_cloud(stamp, skewed(stamp, TIMES), TIMES) for stamp in STAMPS]
    return write_sorted(tmp_path_factory.mktemp("log") / "log", tf(1.5, lidar=MOUNT), clouds)


def test_deskewed_points_lie_where_the_world_is_at_the_stamp(skewed_log):
    plain, deskewed = frames_of(skewed_log), frames_of(skewed_log, settings(deskew=True))
    assert [frame.stamp for frame in deskewed] == STAMPS
    for before, after in zip(plain, deskewed, strict=True):
        np.testing.assert_allclose(after.points, there(after.stamp), atol=1e-3)
        assert np.abs(before.points - there(after.stamp)).max() > 0.03


def test_deskewed_clouds_can_be_accumulated(skewed_log):
    for frame in frames_of(skewed_log, settings(deskew=True, accumulate={"scans": 2})):
        assert len(frame.points) == 2 * len(STILL)
        np.testing.assert_allclose(frame.points, np.tile(there(frame.stamp), (2, 1)), atol=1e-3)


def test_clouds_that_last_beyond_the_poses_are_refused(tmp_path):
    clouds = [timed_cloud(stamp, skewed(stamp, TIMES), TIMES) for stamp in STAMPS]
    path = write_sorted(tmp_path / "log", tf(0.45, lidar=MOUNT), clouds)
    recording = read_recording(path, settings(deskew=True))
    # Poses end at 0.95 s; the cloud of 0.9 s lasts until 1.0 s.
    assert recording.scans.stamps.tolist() == STAMPS[:9]
    assert sum(recording.refused.values()) == 3


# Parts of a log


def test_a_window_in_seconds_from_the_beginning(sparse_log):
    """The log begins with /tf_static, 1 s before the first cloud."""
    recording = read_recording(sparse_log, settings(start=1.35, end=1.75))
    assert recording.scans.stamps.tolist() == STAMPS[4:8]
    assert recording.total == 4
    assert [f.stamp for f in read_frames(recording, 0, 4)] == STAMPS[4:8]
    every = read_recording(sparse_log, settings(every=5))
    assert every.scans.stamps.tolist() == STAMPS[::5]
    assert "every 5: 3 of 12 clouds are used" in every.notices
    assert "nothing from 20 to" in line(sparse_log, settings(start=20))


# Attitude


def test_up_is_the_fixed_frames_z_where_there_is_one(sparse_log):
    for frame in frames_of(sparse_log):
        np.testing.assert_allclose(frame.up, pose(frame.stamp).matrix[2], atol=1e-4)


def test_up_is_by_the_imu_where_there_is_no_pose(tmp_path):
    """An IMU that is mounted upside down on a robot that pitches."""

    def pitched(stamp):
        angle = 0.2 * np.sin((stamp - START) / SECOND)
        return np.array([0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)])

    over = np.array([1.0, 0.0, 0.0, 0.0])
    stamps = range(START - SECOND // 10, START + 2 * SECOND, SECOND // 100)
    imus = [imu(s, product(pitched(s)[None], over[None])[0]) for s in stamps]
    mounts = [("base_link", "lidar", (0, 0, 1), (0, 0, 0, 1)), ("base_link", "imu", (0, 0, 0), over)]
    path = write_sorted(
        tmp_path / "log", static_record(START - SECOND, mounts), imus, [cloud(s, STILL) for s in STAMPS]
    )
    for frame in frames_of(path):
        angle = 0.2 * np.sin((frame.stamp - START) / SECOND)
        np.testing.assert_allclose(frame.up, [-np.sin(angle), 0, np.cos(angle)], atol=1e-5)
        assert frame.quality is None


def test_the_quality_of_a_pose_tells_the_gap_that_it_was_interpolated_over(tmp_path):
    path = write_sorted(tmp_path / "log", tf(1.2, rate=8, lidar=MOUNT), [sparse(stamp) for stamp in STAMPS])
    for frame in frames_of(path):
        assert frame.quality.gap == pytest.approx(1 / 8, abs=1e-6)
        assert 0 < frame.quality.roll < 0.01


def odometry(stamp, covariance):
    """An odometry that says how well it knows the pose."""
    record = odometry_record(stamp, "map", "base_link", *(v[0].tolist() for v in poses([stamp])))

    def build(store):
        message = record.build(store)
        message.pose.covariance[:] = covariance.ravel()
        return message

    return Record(record.topic, record.type, record.time, build)


def test_the_covariance_of_a_pose_is_turned_into_the_robots_frame(tmp_path):
    deviations = np.array([0.1, 0.2, 0.05, 0.01, 0.04, 0.3])
    exact = [odometry(stamp, np.diag(deviations**2)) for stamp in [START - 5, *STAMPS, STAMPS[-1] + 5]]
    mounts = static_record(
        START - SECOND, [("base_link", "lidar", MOUNT.translation.tolist(), MOUNT.quaternion.tolist())]
    )
    for frame in frames_of(write_sorted(tmp_path / "log", mounts, exact, [sparse(s) for s in STAMPS])):
        turn = pose(frame.stamp).matrix
        attitude = turn.T @ np.diag(deviations[3:] ** 2) @ turn
        place = turn.T @ np.diag(deviations[:3] ** 2) @ turn
        expected = [0.0, *np.sqrt([attitude[0, 0], attitude[1, 1], place[2, 2]])]
        found = frame.quality
        assert [found.gap, found.roll, found.pitch, found.height] == pytest.approx(expected, abs=1e-6)


def test_quality_against_one_by_one(tmp_path):
    """Poses at 8 Hz, some of which say how well they are known: the nearest one's word counts."""
    random = np.random.default_rng(5)
    stamps = [int(s) for s in START - SECOND // 4 + np.arange(16) * (SECOND // 8) + 321]
    known = {}
    for stamp in stamps:
        half = random.normal(size=(6, 6)) * 0.1
        known[stamp] = half @ half.T if random.random() < 0.6 else np.zeros((6, 6))
    mounts = static_record(
        START - SECOND, [("base_link", "lidar", MOUNT.translation.tolist(), MOUNT.quaternion.tolist())]
    )
    path = write_sorted(
        tmp_path / "log", mounts, [odometry(s, known[s]) for s in stamps], [sparse(s) for s in STAMPS]
    )
    said = 0
    for frame in frames_of(path):
        before = max(s for s in stamps if s <= frame.stamp)
        after = min(s for s in stamps if s >= frame.stamp)
        nearest = before if frame.stamp - before <= after - frame.stamp else after
        covariance, turn = known[nearest], frame.pose.matrix
        said += bool(covariance.any())
        variance = (turn.T @ covariance[3:, 3:] @ turn)[[0, 1], [0, 1]].tolist()
        variance.append((turn.T @ covariance[:3, :3] @ turn)[2, 2])
        changes = []
        for one, other in ((pose(before), frame.pose), (frame.pose, pose(after))):
            spin = one.matrix.T @ other.matrix
            # Of a small turn: half of what is skew.
            height = one.apply_inverse(other.translation[None])[0, 2]
            changes.append(np.abs([(spin[2, 1] - spin[1, 2]) / 2, (spin[0, 2] - spin[2, 0]) / 2, height]))
        expected = np.sqrt(variance + np.min(changes, axis=0) ** 2)
        found = frame.quality
        assert found.gap == pytest.approx((after - before) / 1e9, abs=1e-9)
        assert [found.roll, found.pitch, found.height] == pytest.approx(expected.tolist(), abs=1e-4)
    assert 3 < said < len(STAMPS) - 2


def test_poses_may_come_from_a_file(tmp_path):
    """TUM poses beside a log that has none; they name themselves in the results."""
    mounts = static_record(
        START - SECOND, [("base_link", "lidar", MOUNT.translation.tolist(), MOUNT.quaternion.tolist())]
    )
    path = write_sorted(tmp_path / "log", mounts, [sparse(s) for s in STAMPS])
    stamps = np.arange(START - SECOND, START + 3 * SECOND, SECOND // 100)
    lines = [
        " ".join([f"{s // SECOND}.{s % SECOND:09d}", *(f"{v:.9f}" for v in (*p, *q))])
        for s, p, q in zip(stamps, *poses(stamps), strict=True)
    ]
    file = tmp_path / "slam.tum"
    file.write_text("\n".join(["# a trajectory", *lines]))
    recording = read_recording(path, settings(poses=str(file), accumulate={"scans": 3}))
    assert recording.pose_source.startswith("slam.tum (sha256 ")
    for frame in read_frames(recording, 0, recording.matched):
        np.testing.assert_allclose(frame.points, there(frame.stamp, seen(frame.stamp, 3)), atol=2e-3)


def test_the_robots_own_body_leaves_no_trail(tmp_path):
    """What is seen of the robot itself drives along with it."""
    own = np.array([[0.1, 0.2, 0.5], [-0.2, 0.0, 0.4], [0.25, -0.1, 0.3]])

    def with_body(stamp):
        return cloud(stamp, np.vstack([skewed(stamp, NOW)[:RING], MOUNT.apply_inverse(own)]))

    path = write_sorted(tmp_path / "log", tf(1.2, lidar=MOUNT), [with_body(s) for s in STAMPS])
    box = BodyBox(x=(-0.3, 0.3), y=(-0.3, 0.3), z=(0.2, 0.6))
    recording = read_recording(path, settings(accumulate={"scans": 8}), body=box)
    wrong = settings(accumulate={"scans": 8}, pose_error={"height": 0.25, "roll": 0.2})
    erring = read_recording(path, wrong, body=box)
    for frame, other in zip(
        read_frames(recording, 0, recording.matched), read_frames(erring, 0, erring.matched), strict=True
    ):
        # A robot that errs in its pose knows its body as well as before.
        raised = erring.scans.wrong.at(0).apply(frame.points.astype(np.float64))
        np.testing.assert_allclose(other.points, raised, atol=1e-4)
        # Those of the last scan are left to the detector, which knows the box too.
        np.testing.assert_allclose(frame.points[-3:], own, atol=1e-4)
        others = frame.points[:-3]
        assert len(others) == 8 * RING
        np.testing.assert_allclose(others, np.tile(there(frame.stamp, STILL[:RING]), (8, 1)), atol=2e-4)


# What is found to be damaged only when clouds are read


def test_a_large_log_tells_damaged_clouds_when_they_are_read(tmp_path, monkeypatch):
    """Its clouds are not checked when it is opened; then the bad chunk is told, and --strict is an error."""
    monkeypatch.setattr(preparation, "LARGE", 0)
    records = [sparse(stamp) for stamp in STAMPS]
    path = write_sorted(tmp_path / "log", tf(1.2, lidar=MOUNT), records, container="mcap-none")
    data = bytearray(path.read_bytes())
    last = np.ascontiguousarray(skewed(STAMPS[6], NOW)[RING * 6 + 5], dtype="<f4").tobytes()
    at = data.index(last)
    data[at] ^= 0x55
    path.write_bytes(data)
    recording = read_recording(path, LogSection())
    assert (recording.matched, recording.losses, recording.checked) == (12, (), False)
    items = list(read_frames(recording, 0, 12))
    refused = [item for item in items if isinstance(item, RefusedScan)]
    assert {item.reason for item in refused} == {"in a damaged part of the log"}
    assert STAMPS[6] in [item.stamp for item in refused]
    assert len(refused) < 6
    with pytest.raises(LogError, match=r"not whole: log: a chunk does not match its checksum .*--strict"):
        list(read_frames(read_recording(path, settings(strict=True)), 0, 12))


def test_messages_that_cannot_be_decoded_are_an_error_by_strict(tmp_path):
    broken = [sparse(stamp) for stamp in STAMPS]
    broken[4] = replace(broken[4], build=None, raw=b"\0\1\0\0" + bytes(30))
    path = write_sorted(tmp_path / "log", tf(1.2, lidar=MOUNT), broken)
    recording = read_recording(path, LogSection())
    every = [item for item in read_frames(recording, 0, recording.matched) if isinstance(item, Frame)]
    assert len(every) == 11
    with pytest.raises(LogError, match="not whole"):
        list(read_frames(read_recording(path, settings(strict=True)), 0, 12))
