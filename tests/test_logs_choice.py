"""Topics, frames and poses pick themselves, or one line lists the candidates."""

import numpy as np
import pytest
from logs_checks import frames_of, line
from logs_writer import (
    HERE,
    POINTS,
    START,
    cloud_record,
    clouds,
    driving,
    lidar,
    odometry_record,
    pose_record,
    stamps,
    static_record,
    tf_record,
    write_records,
    yaw_quaternion,
)

from gapeval.config import LogSection, StaticTransform
from gapeval.logs.read import read_frames, read_recording

# Choosing topics


def test_several_cloud_topics(log):
    path = log(lidar(), driving(), clouds(), clouds(4, topic="/rear/points"))
    choice = "choose with --cloud-topic, or name several to merge them"
    expected = f"several topics have clouds, {choice}: /points (10), /rear/points (4)"
    assert line(path) == expected
    assert read_recording(path, LogSection(cloud_topic="rear/points")).total == 4
    wrong = line(path, LogSection(cloud_topic="/front"))
    assert wrong == "no topic /front for --cloud-topic; clouds are on /points (10), /rear/points (4)"
    other = line(path, LogSection(cloud_topic="/tf"))
    assert other.startswith(
        "--cloud-topic /tf is tf2_msgs/TFMessage, and gapeval reads PointCloud2, LaserScan, "
    )


def test_no_clouds_or_nothing_at_all(log, tmp_path):
    path = log(lidar(), driving())
    assert line(path).startswith("no clouds: gapeval reads PointCloud2, LaserScan, ")
    assert "for them, and the log has tf2_msgs/TFMessage on /tf (12), tf2" in line(path)
    for container in ("bag", "mcap", "mcap-bare", "sqlite3"):
        empty = write_records(tmp_path / f"empty-{container}", [], container)
        assert line(empty) == "no messages at all; record it again"


# Choosing frames


def test_frames_by_name_or_by_place(log, tmp_path):
    def picked(*edges, moving=(("odom", "base_link"),), **settings):
        path = tmp_path / f"frames-{len(list(tmp_path.iterdir()))}"
        records = [static_record(START, [(p, c, (0, 0, 1), HERE) for p, c in edges])]
        records += [tf_record(s, [(p, c, (0, 0, 0), HERE) for p, c in moving]) for s in stamps(5)]
        write_records(path, [*records, *clouds(4)])
        recording = read_recording(path, LogSection(**settings))
        return recording.fixed_frame, recording.robot_frame, recording.sensor_frame

    assert picked(("base_link", "lidar")) == ("odom", "base_link", "lidar")
    assert picked(("base_link", "lidar"), ("map", "odom")) == ("map", "base_link", "lidar")
    assert picked(("base_link", "lidar"), ("map", "odom"), fixed_frame="/odom")[0] == "odom"
    moving = (("odom", "base_footprint"),)
    assert picked(("base_footprint", "lidar"), moving=moving) == ("odom", "base_footprint", "lidar")
    inner = picked(("base_footprint", "base_link"), ("base_link", "lidar"), moving=moving)
    assert inner == ("odom", "base_link", "lidar")
    moving = (("odom", "car"),)
    assert picked(("car", "lidar"), moving=moving) == ("odom", "car", "lidar")
    assert picked(("car", "mast"), ("mast", "lidar"), moving=moving, robot_frame="mast")[1] == "mast"
    moving = (("start", "base_link"),)
    assert picked(("base_link", "lidar"), moving=moving) == ("start", "base_link", "lidar")
    moving = (("r1/odom", "r1/base_link"),)
    assert picked(("r1/base_link", "lidar"), moving=moving) == ("r1/odom", "r1/base_link", "lidar")


def test_nothing_is_fixed_where_nothing_moves(log):
    path = log(static_record(START, [("base_footprint", "base_link", (0, 0, 0.1), HERE)]), lidar(), clouds())
    recording = read_recording(path, LogSection())
    assert (recording.fixed_frame, recording.pose_source) == (None, "none")
    assert next(read_frames(recording, 0, 1)).pose is None


def test_frames_that_leave_a_choice(log):
    path = log(
        static_record(START, [("car", "mast", (0, 0, 1), HERE), ("mast", "lidar", (0, 0, 1), HERE)]),
        driving("start", "car"),
        driving("site", "start"),
        clouds(),
    )
    assert line(path) == "no frame base_link, choose with --robot-frame: mast, car, start, site"
    chosen = line(path, LogSection(robot_frame="car"))
    assert chosen == "no frame map, odom or world, choose with --fixed-frame: start, site"
    recording = read_recording(path, LogSection(robot_frame="car", fixed_frame="site"))
    assert recording.matched == 10
    known = "car, lidar, mast, site, start"
    assert (
        line(path, LogSection(robot_frame="cart")) == f"no frame cart for --robot-frame; the log has {known}"
    )
    wrong = LogSection(robot_frame="car", fixed_frame="map")
    assert line(path, wrong) == f"no frame map for --fixed-frame; the log has {known}"
    wrong = LogSection(robot_frame="car", fixed_frame="site", sensor_frame="x")
    assert line(path, wrong) == f"no frame x for -p log.sensor_frame=; the log has {known}"


@pytest.mark.parametrize("frame", ["base_link", "odom", "map"])
def test_assembled_clouds_need_the_laser(log, frame):
    path = log(lidar(), driving("odom"), driving("map", "odom"), clouds(frame=frame))
    assert line(path) == (
        f"the clouds are in {frame}, which is not the laser's own frame; "
        "say where the laser is with -p log.sensor_frame=..., one of lidar"
    )
    frames = frames_of(path, LogSection(sensor_frame="lidar"))
    assert [frame.sensor.translation.tolist() for frame in frames] == [[0, 0, 1]] * 10
    shift = {"base_link": 0.0, "odom": 0.1, "map": 0.2}[frame]
    for i, found in enumerate(frames):
        np.testing.assert_allclose(found.points, POINTS - [shift * (i + 1), 0, 0], atol=1e-5)


def test_assembled_clouds_far_from_the_origin_keep_their_precision(log):
    far = np.array([600_000.0, 5_300_000.0, 400.0])
    records = []
    for stamp in stamps(3):
        data = np.frombuffer((POINTS + far).astype("<f8").tobytes(), np.uint8)
        fields = [("x", 0, 8, 1), ("y", 8, 8, 1), ("z", 16, 8, 1)]
        records.append(
            cloud_record(stamp, POINTS, "map", fields=fields, point_step=24, row_step=0, data=data)
        )
    poses = [tf_record(stamp, [("map", "base_link", far, HERE)]) for stamp in stamps(3)]
    for frame in frames_of(log(lidar(), poses, records), LogSection(sensor_frame="lidar")):
        assert np.abs(frame.points - POINTS).max() < 1e-5


def test_a_log_without_any_transform(log):
    path = log(clouds())
    text = line(path)
    assert text.startswith(
        "no transforms, so where the laser sits is unknown; add it with `log: transforms:`, or"
    )
    assert text.endswith("with --robot-frame lidar -p log.sensor_frame=lidar")
    frames = frames_of(path, LogSection(robot_frame="lidar", sensor_frame="lidar"))
    np.testing.assert_array_equal(frames[0].points, POINTS.astype(np.float32))
    assert frames[0].pose is None
    added = StaticTransform(parent="base_link", child="lidar", translation=(0, 0, 2))
    frames = frames_of(path, LogSection(transforms=(added,)))
    assert frames[0].sensor.translation.tolist() == [0, 0, 2]


def test_clouds_that_name_no_frame(log):
    path = log(lidar(), driving(), clouds(frame=""))
    assert line(path) == "the clouds on /points name no frame; name it with -p log.sensor_frame=..."
    assert len(frames_of(path, LogSection(sensor_frame="lidar"))) == 10


# Poses


def test_odometry_where_tf_has_no_poses(log):
    odometry = [odometry_record(s, "odom", "base_link", (i, 0, 0)) for i, s in enumerate(stamps(11))]
    recording = read_recording(log(lidar(), odometry, clouds()), LogSection())
    assert (recording.pose_source, recording.fixed_frame) == ("/odom", "odom")
    assert [f.pose.translation[0] for f in read_frames(recording, 0, 10)] == list(range(10))


def test_tf_is_preferred_unless_a_pose_topic_is_named(log):
    odometry = [odometry_record(s, "gps", "imu", (100 + i, 0, 0.5)) for i, s in enumerate(stamps(11))]
    path = log(
        lidar(),
        static_record(START, [("base_link", "imu", (0, 0, 0.5), HERE)]),
        driving(),
        odometry,
        clouds(),
    )
    assert read_recording(path, LogSection()).pose_source == "tf"
    recording = read_recording(path, LogSection(pose_topic="odom"))
    assert (recording.pose_source, recording.fixed_frame) == ("/odom", "gps")
    assert [f.pose.translation.tolist() for f in read_frames(recording, 0, 2)] == [[100, 0, 0], [101, 0, 0]]
    wrong = line(path, LogSection(pose_topic="/tf"))
    assert wrong.startswith("no topic /tf with poses (nav_msgs/Odometry, ")
    assert wrong.endswith("for --pose-topic; the log has /odom (11)")


def test_stamped_poses_are_of_the_robot_frame(log):
    poses = [pose_record(s, "map", (0, i, 0), yaw_quaternion(0.5)) for i, s in enumerate(stamps(11))]
    goals = [pose_record(s, "map", (9, 9, 9), topic="/move_base_simple/goal") for s in stamps(2)]
    recording = read_recording(log(lidar(), poses, goals, clouds()), LogSection())
    assert (recording.pose_source, recording.fixed_frame) == ("/pose", "map")
    assert [f.pose.translation[1] for f in read_frames(recording, 0, 10)] == list(range(10))


def test_several_pose_topics(log):
    path = log(
        lidar(),
        [odometry_record(s, "odom", "base_link", (0, 0, 0)) for s in stamps(11)],
        [pose_record(s, "map", (0, 0, 0)) for s in stamps(11)],
        clouds(),
    )
    expected = "tf does not place base_link in the world, choose with --pose-topic: /odom (11), /pose (11)"
    assert line(path) == expected
    assert read_recording(path, LogSection(pose_topic="/pose")).fixed_frame == "map"


def test_poses_without_frames(log):
    path = log(lidar(), [odometry_record(s, "", "", (1, 2, 3)) for s in stamps(11)], clouds())
    assert line(path) == "/odom does not name its frame; say what to call it with --fixed-frame map"
    recording = read_recording(path, LogSection(fixed_frame="map"))
    assert next(read_frames(recording, 0, 1)).pose.translation.tolist() == [1, 2, 3]


def test_poses_that_change_their_frames(log):
    odometry = [odometry_record(s, f"odom{i}", "base_link", (0, 0, 0)) for i, s in enumerate(stamps(2))]
    text = line(log(lidar(), odometry, clouds(2)))
    assert (
        text
        == "/odom changes its frames (odom0<-base_link, odom1<-base_link); name another with --pose-topic"
    )
