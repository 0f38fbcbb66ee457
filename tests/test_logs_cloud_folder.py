"""Folders of PCD, PLY and KITTI files, written by the formats' own libraries, with files of poses."""

import math
import re
import shutil
from decimal import Decimal
from pathlib import Path

import numpy as np
import plyfile
import pypcd4
import pytest
import yaml
from logs_checks import frames_of, line
from logs_writer import POINTS, START, clouds, driving, lidar, stamps, write_sorted

from gapeval.config import LogSection, StaticTransform
from gapeval.errors import LogError
from gapeval.frame import Transform
from gapeval.logs.read import RefusedScan, describe, read_frames, read_recording
from gapeval.logs.read.container import HEAD, Topic
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.messages.content import (
    UndecodableError,
    UnreadableCloudError,
    cloud,
    head,
    packed_cloud,
    timed_cloud,
)
from gapeval.logs.read.messages.file_message import with_head
from gapeval.logs.read.messages.lzf import lzf_decompressed
from gapeval.logs.read.messages.pose_file import read_pose_file

ENCODINGS = tuple(map(pypcd4.Encoding, ("ascii", "binary", "binary_compressed")))
XYZ = POINTS.astype(np.float32)
# map <- lidar of the drive: the lidar sits 1 m above the robot, which moves along x.
MOUNT = StaticTransform(parent="base_link", child="lidar", translation=(0.0, 0.0, 1.0))


def write_pcd(path, columns, types, encoding=pypcd4.Encoding.BINARY, viewpoint=None):
    """columns: name -> values."""
    made = pypcd4.PointCloud.from_points(list(columns.values()), list(columns), types)
    if viewpoint is not None:
        made.metadata.viewpoint = viewpoint
    made.save(path, encoding)
    return path


def write_xyz(path, points=XYZ, encoding=pypcd4.Encoding.BINARY):
    pypcd4.PointCloud.from_xyz_points(np.asarray(points, np.float32)).save(path, encoding)


def seconds(stamp):
    return f"{stamp // 10**9}.{stamp % 10**9:09d}"


def tum(path, times, moved=lambda i: (i / 10, 0, 1)):
    rows = [
        f"{seconds(t)} {' '.join(map(repr, map(float, (*moved(i), 0, 0, 0, 1))))}"
        for i, t in enumerate(times)
    ]
    path.write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(rows) + "\n")


def settings(**values):
    return LogSection(transforms=(MOUNT,), **values)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The frames of the same drive recorded by ROS."""
    path = write_sorted(tmp_path_factory.mktemp("ros") / "log.mcap", lidar(), driving(first=0), clouds())
    return frames_of(path)


def assert_same_frames(path, expected):
    found = frames_of(path, settings())
    assert [frame.stamp for frame in found] == [frame.stamp for frame in expected]
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one.points, other.points)
        np.testing.assert_allclose(one.pose.translation, other.pose.translation, atol=1e-12)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_pcd_files_named_by_their_times(tmp_path, expected, encoding):
    for stamp in stamps(10):
        write_xyz(tmp_path / f"{seconds(stamp)}.pcd", encoding=encoding)
    tum(tmp_path / "poses.tum", stamps(11))
    found = frames_of(tmp_path, settings())
    assert [frame.stamp for frame in found] == stamps(10)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.points, other.points, atol=2e-6)
        np.testing.assert_allclose(one.pose.translation, other.pose.translation, atol=1e-12)
    recording = read_recording(tmp_path, settings())
    assert (recording.container, recording.pose_source) == ("folder of pcd", "/poses")
    assert (recording.robot_frame, recording.fixed_frame, recording.sensor_frame) == (
        "base_link",
        "map",
        "lidar",
    )


def test_the_order_of_numbers_and_the_times_of_the_poses(tmp_path, expected):
    """`cloud_10` comes after `cloud_9`; a TUM file with as many lines as there are clouds has their times."""
    for i in range(10):
        write_xyz(tmp_path / f"cloud_{i + 1}.pcd", XYZ + np.float32(i))
    tum(tmp_path / "all_poses_1.txt", stamps(10))
    found = frames_of(tmp_path, settings())
    assert [frame.stamp for frame in found] == stamps(10)
    for i, frame in enumerate(found):
        np.testing.assert_allclose(frame.points, XYZ + np.float32(i) + np.float32([0, 0, 1]), atol=1e-5)


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("order", "<>")
def test_ply_files(tmp_path, expected, text, order):
    folder = tmp_path / "clouds"
    folder.mkdir()
    rows = np.zeros(len(XYZ), [("red", "u1"), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("scalar", "f8")])
    for i, name in enumerate("xyz"):
        rows[name] = XYZ[:, i]
    camera = np.zeros(2, [("focal", "f8"), ("n", "i2")])
    elements = [plyfile.PlyElement.describe(camera, "camera"), plyfile.PlyElement.describe(rows, "vertex")]
    for i in range(10):
        plyfile.PlyData(elements, text=text, byte_order=order).write(str(folder / f"{i:06d}.ply"))
    (folder / "times.txt").write_text("".join(f"{seconds(stamp)}\n" for stamp in stamps(10)))
    # In the folder that the folder is in.
    tum(tmp_path / "x.tum", stamps(11))
    if text:
        found = frames_of(folder, settings())
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one.points, other.points, atol=1e-5)
    else:
        assert_same_frames(folder, expected)


def kitti_calibration():
    """camera <- laser: x of the camera is -y of the laser, y is -z, z is x."""
    return np.array([[0, -1, 0, 0.05], [0, 0, -1, -0.1], [1, 0, 0, -0.3], [0, 0, 0, 1]])


def write_kitti(folder, count=10):
    """A sequence as KITTI has it: velodyne/000000.bin, times.txt, calib.txt, poses.txt of the camera."""
    velodyne = folder / "velodyne"
    velodyne.mkdir()
    laser, poses = kitti_calibration(), []
    for i in range(count):
        np.c_[XYZ, np.zeros(len(XYZ), "f4")].astype("<f4").tofile(velodyne / f"{i:06d}.bin")
        moved = np.eye(4)
        moved[0, 3] = i / 10
        poses.append(laser @ moved @ np.linalg.inv(laser))
    rows = [" ".join(f"{value:.12e}" for value in pose[:3].ravel()) for pose in poses]
    (folder / "poses.txt").write_text("\n".join(rows))
    (folder / "times.txt").write_text("".join(f"{i / 10:.6e}\n" for i in range(count)))
    numbers = " ".join(f"{value:.12e}" for value in laser[:3].ravel())
    (folder / "calib.txt").write_text(f"P0: {' '.join(['1'] * 12)}\nTr: {numbers}\n")
    return velodyne


def test_a_sequence_of_kitti(tmp_path, expected):
    path = write_kitti(tmp_path)
    mount = StaticTransform(parent="base_link", child="velodyne", translation=(0.0, 0.0, 1.0))
    recording = read_recording(path, LogSection(transforms=(mount,)))
    assert (recording.matched, recording.sensor_frame, recording.notices) == (10, "velodyne", ())
    for i, frame in enumerate(read_frames(recording, 0, 10)):
        assert frame.stamp == i * 10**8
        assert np.array_equal(frame.points, expected[i].points)
        # The laser was at its own origin, so the robot begins 1 m below it.
        np.testing.assert_allclose(frame.pose.translation, [i / 10, 0, -1], atol=1e-9)
        np.testing.assert_allclose(frame.pose.matrix, np.eye(3), atol=1e-9)


def test_poses_of_a_camera_need_a_calibration(tmp_path):
    path = write_kitti(tmp_path)
    (tmp_path / "calib.txt").unlink()
    mount = StaticTransform(parent="base_link", child="velodyne", translation=(0.0, 0.0, 1.0))
    recording = read_recording(path, LogSection(transforms=(mount,)))
    assert "no calib.txt beside poses.txt" in recording.notices[0]
    (tmp_path / "calib.txt").write_text("P0: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    assert "no line Tr" in one_error(path)


@pytest.mark.parametrize(
    ("stem", "stamp"),
    [
        ("1234567890.123456789", 1_234_567_890_123_456_789),
        ("1234567890.5", 1_234_567_890_500_000_000),
        ("scan_1234567890_000000123", 1_234_567_890_000_000_123),
        ("1234567890123456789", 1_234_567_890_123_456_789),
        ("1234567890123456", 1_234_567_890_123_456_000),
        ("lidar-1234567890123456", 1_234_567_890_123_456_000),
        ("front.1234567890.25", 1_234_567_890_250_000_000),
    ],
)
def test_names_that_are_times(tmp_path, stem, stamp):
    write_xyz(tmp_path / f"{stem}.pcd")
    with open_container(tmp_path) as container:
        assert (container.start, container.end) == (stamp, stamp)
        assert [topic.count for topic in container.topics] == [1]
        assert "no file of poses" in container.notices[0]


def one_error(path):
    with pytest.raises(LogError) as caught:
        read_recording(path, settings())
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_clouds_without_times_are_told(tmp_path):
    for name in ("1.pcd", "2.pcd"):
        write_xyz(tmp_path / name)
    assert one_error(tmp_path) == (
        f"{tmp_path}: nothing says when its clouds were measured; name them by their times, as "
        "1234567890.123456789.pcd, or add times.txt with a line of seconds for each"
    )
    tum(tmp_path / "a.tum", stamps(5))
    assert "; a.tum has 5 poses for 2 clouds; name" in one_error(tmp_path)
    (tmp_path / "times.txt").write_text("1.5\n")
    assert "times.txt: 1 times for 2 clouds in " in one_error(tmp_path)
    (tmp_path / "times.txt").write_text("1.5\nlater\n")
    assert "times.txt: line 2: 'later' is no time in seconds" in one_error(tmp_path)
    tum(tmp_path / "b.tum", stamps(5))
    assert "several files of poses, a.tum, b.tum; keep one" in one_error(tmp_path)
    write_kitti_file = tmp_path / "3.bin"
    XYZ.tofile(write_kitti_file)
    assert "holds .bin and .pcd files; put each kind into a folder of its own" in one_error(tmp_path)


def test_a_broken_file_is_one_cloud_less(tmp_path):
    for stamp in stamps(6):
        write_xyz(tmp_path / f"{seconds(stamp)}.pcd")
    tum(tmp_path / "poses.txt", stamps(6))
    names = [tmp_path / f"{seconds(stamp)}.pcd" for stamp in stamps(6)]
    names[1].write_bytes(names[1].read_bytes()[:-5])
    names[2].write_bytes(b"")
    names[3].write_bytes(b"\xff" * 1000)
    recording = read_recording(tmp_path, settings())
    items = list(read_frames(recording, 0, 6))
    reasons = [str(item) if isinstance(item, RefusedScan) else "" for item in items]
    assert reasons[0] == reasons[4] == reasons[5] == ""
    assert reasons[1] == "header lies about its size: 1 x 50 points need 600 bytes, it has 595"
    assert reasons[2:4] == [
        "message cannot be decoded: it is empty",
        "message cannot be decoded: it has no PCD header",
    ]


def test_a_window_of_time_is_read(tmp_path):
    for stamp in stamps(6):
        write_xyz(tmp_path / f"{seconds(stamp)}.pcd")
    tum(tmp_path / "poses.txt", stamps(6))
    with open_container(tmp_path) as container:
        start, stop = stamps(6)[1], stamps(6)[3]
        both = list(container.messages(["/points", "/poses"], start, stop))
        assert [(topic.name, time) for topic, time, _ in both] == [
            ("/points", start),
            ("/poses", start),
            ("/points", stamps(6)[2]),
            ("/poses", stamps(6)[2]),
        ]
        heads = list(container.heads(["/points"], [], None, None))
        assert [head(topic, raw[:HEAD]).stamp for topic, _, raw in heads] == stamps(6)
        assert all(len(raw) <= 2 * HEAD for _, _, raw in heads)


def test_a_viewpoint_moves_the_points(tmp_path):
    quarter = math.sqrt(0.5)
    columns = {name: XYZ[:, i] for i, name in enumerate("xyz")}
    for stamp in stamps(2):
        viewpoint = (1.0, 2.0, 3.0, quarter, 0.0, 0.0, quarter)
        write_pcd(tmp_path / f"{seconds(stamp)}.pcd", columns, [np.float32] * 3, viewpoint=viewpoint)
    tum(tmp_path / "poses.txt", stamps(2))
    recording = read_recording(tmp_path, settings())
    assert recording.notices == (f"{seconds(START)}.pcd has a VIEWPOINT, by which its points are moved",)
    frame = next(read_frames(recording, 0, 1))
    turned = Transform.of((1, 2, 3 + 1), (0, 0, quarter, quarter)).apply(XYZ.astype(float))
    np.testing.assert_allclose(frame.points, turned, atol=1e-5)


def file_cloud(form, raw):
    return Topic("/points", form.upper(), 1, form), with_head(START, "lidar", raw)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_fields_of_any_type(tmp_path, encoding):
    rng = np.random.default_rng(2)
    types = [np.uint8, np.float64, np.int16, np.float32, np.uint32, np.int32, np.uint16, np.int8]
    names = ["ring", "x", "y", "z", "t", "a", "b", "c"]
    columns = {n: rng.integers(1, 100, 30).astype(t) for n, t in zip(names, types, strict=True)}
    columns["t"] = np.linspace(0, 99_000_000, 30).astype(np.uint32)
    topic, raw = file_cloud("pcd", write_pcd(tmp_path / "a.pcd", columns, types, encoding).read_bytes())
    expected = np.stack([columns[name].astype(float) for name in "xyz"], axis=1)
    assert np.array_equal(cloud(topic, raw).xyz, expected)
    assert timed_cloud(topic, raw).nanoseconds.tolist() == columns["t"].tolist()
    assert [found.name for found in packed_cloud(topic, raw).fields] == names


def test_headers_that_lie():
    def of(text, data=b""):
        return file_cloud("pcd", text.encode() + data)

    plain = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {}\n"
    two = np.arange(1, 7, dtype="<f4").tobytes()
    assert cloud(*of(plain.format("binary"), two)).xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud(*of(plain.format("ascii"), b"1 2 3\r\n4 5 nan\n")).xyz.tolist() == [[1, 2, 3]]
    for text, data, kind, reason in (
        (plain.format("binary"), two[:-1], UnreadableCloudError, "need 24 bytes, it has 23"),
        (plain.format("ascii"), b"1 2 3 4 5", UnreadableCloudError, "2 points of 3 numbers, it has 5"),
        (plain.format("ascii"), b"1 2 3 4 5 six", UndecodableError, "what is no number"),
        (plain.format("binary").replace("POINTS 2", "POINTS 3"), two, UndecodableError, "says 3 points"),
        (plain.format("other"), two, UndecodableError, "its DATA is 'other'"),
        (plain.format("binary").replace("SIZE 4 4 4", "SIZE 4 4"), two, UndecodableError, "not as many"),
        (plain.format("binary").replace("SIZE 4 4 4", "SIZE 4 4 0"), two, UndecodableError, "below 1"),
        (plain.format("binary").replace("WIDTH 2", "WIDTH two"), two, UndecodableError, "no PCD's"),
        (plain.format("binary").replace("2", str(2**63)), two, UnreadableCloudError, "need"),
        (plain.format("binary_compressed"), b"\1\0", UnreadableCloudError, "its data is cut"),
        (plain.format("binary_compressed"), b"\xff\0\0\0\x18\0\0\0", UnreadableCloudError, "255 compressed"),
        (plain.format("binary_compressed"), b"\0\0\0\0\xff\0\0\0", UnreadableCloudError, "it has 255"),
        (plain.format("binary_compressed"), b"\1\0\0\0\x18\0\0\0\0", UnreadableCloudError, "unpacks to 0"),
        (plain.format("binary").replace("TYPE F", "TYPE Q"), two, UnreadableCloudError, "unknown datatype 0"),
        ("ply\n", b"", UndecodableError, "no PCD header"),
    ):
        with pytest.raises(kind, match=reason):
            cloud(*of(text, data))


ASCII_2 = "ply\nformat ascii 1.0\nelement vertex 2\nXend_header\n"


@pytest.mark.parametrize(
    ("text", "data", "kind", "reason"),
    [
        ("", b"", UndecodableError, "it is empty"),
        ("ply\nformat ascii 1.0\n", b"", UndecodableError, "does not end"),
        ("ply\nformat other 1.0\nelement vertex 1\nend_header\n", b"", UndecodableError, "format 'other'"),
        ("ply\nformat ascii 1.0\nelement face 1\nend_header\n", b"", UndecodableError, "no vertex"),
        ("ply\nformat ascii 1.0\nproperty float x\nend_header\n", b"", UndecodableError, "no PLY's"),
        (
            "ply\nformat ascii 1.0\nelement vertex 2\nXend_header\n",
            b"1 2 3\n4 5\n",
            UnreadableCloudError,
            "has 5",
        ),
        ("ply\nformat ascii 1.0\nelement vertex 1\nXend_header\n", b"1 2 e\n", UndecodableError, "no number"),
        (
            "ply\nformat binary_little_endian 1.0\nelement vertex 2\nXend_header\n",
            b"ab",
            UnreadableCloudError,
            "24",
        ),
        ("ply\nformat ascii 1.0\nelement vertex -1\nXend_header\n", b"", UndecodableError, "below 0"),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int i\nend_header\n",
            b"",
            UndecodableError,
            "has a list",
        ),
    ],
)
def test_ply_headers_that_lie(text, data, kind, reason):
    text = text.replace("X", "property float x\nproperty float y\nproperty float z\n")
    with pytest.raises(kind, match=reason):
        cloud(*file_cloud("ply", text.encode() + data))


def test_lzf_of_long_and_overlapping_runs():
    import lzf

    rng = np.random.default_rng(3)
    for data in (bytes(10_000), b"abc" * 5000, rng.bytes(3000) * 3, np.arange(5000, dtype="<f4").tobytes()):
        packed = lzf.compress(data)
        if packed is None:
            continue
        assert lzf_decompressed(packed, len(data)) == data
        for wrong in (len(data) - 1, len(data) + 1):
            with pytest.raises(ValueError, match="unpacks to"):
                lzf_decompressed(packed, wrong)
    with pytest.raises(ValueError, match="cannot hold"):
        lzf_decompressed(b"\0a", 10**9)
    with pytest.raises(ValueError, match="before its beginning"):
        lzf_decompressed(b"\x20\x00", 3)


def test_times_of_poses_are_exact(tmp_path):
    texts = ["1700000000.123456789", "1.700000001e9", "1700000002", "0.000000001", "1305031102.175304"]
    (tmp_path / "a.tum").write_text("".join(f"{text} 1 2 3 0 0 0 1\n" for text in texts))
    found = read_pose_file(tmp_path / "a.tum")
    assert [pose.stamp for pose in found] == [int(Decimal(text) * 10**9) for text in texts]
    assert found[0].values == (1, 2, 3, 0, 0, 0, 1)
    # Commas do as well.
    (tmp_path / "b.csv").write_text("1.5,1,2,3,0,0,0,1\n")
    assert read_pose_file(tmp_path / "b.csv")[0].stamp == 1_500_000_000
    (tmp_path / "c.tum").write_text("1.5 1 2 3 0 0 0 2\n")
    with pytest.raises(LogError, match="line 1 has a quaternion of length 2; it must be of length 1"):
        read_pose_file(tmp_path / "c.tum")


def test_rotations_come_back(tmp_path):
    rng = np.random.default_rng(8)
    quaternions = np.vstack([rng.normal(size=(50, 4)), np.eye(4), [[1, 1, 0, 0]]])
    turns = [Transform.of(rng.normal(size=3), q) for q in quaternions]
    rows = [np.c_[turn.matrix, turn.translation].ravel() for turn in turns]
    (tmp_path / "poses.txt").write_text("\n".join(" ".join(map(repr, map(float, row))) for row in rows))
    found = read_pose_file(tmp_path / "poses.txt", stamps=range(len(rows)))
    for pose, turn in zip(found, turns, strict=True):
        np.testing.assert_allclose(
            Transform.of(pose.values[:3], pose.values[3:]).matrix, turn.matrix, atol=1e-9
        )
        np.testing.assert_allclose(pose.values[:3], turn.translation)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "holds no pose"),
        ("1 2 3\n", "3 columns; TUM poses have 8"),
        ("1 2 3 4 0 0 0 1\n2 3\n", "line 2 has"),
        ("1 2 3 4 0 0 0 x\n", "line 1 has what is no number"),
        ("x 2 3 4 0 0 0 1\n", "line 1: 'x' is no time in seconds"),
        ("nan 2 3 4 0 0 0 1\n", "line 1: 'nan' is no time in seconds"),
        ("1 2 3 4 0 0 0 0\n", "a quaternion of zeros"),
        ("1 nan 3 4 0 0 0 1\n", "not finite"),
        ("1700000000000000000 1 2 3 0 0 0 1\n", "is no time since 1970; TUM has seconds"),
        ("1 0 0 0 0 1 0 0 0 0 2 0\n", "line 1 is no rotation"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2, "2 poses for 1 times"),
    ],
)
def test_pose_files_that_are_none(tmp_path, text, reason):
    path = tmp_path / "poses.txt"
    path.write_text(text)
    with pytest.raises(LogError) as caught:
        read_pose_file(path, stamps=[1])
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)
    with pytest.raises(LogError, match="cannot be read: No such file"):
        read_pose_file(tmp_path / "none.txt")


def test_kitti_poses_need_times(tmp_path):
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(LogError, match=r"KITTI poses have no times; add times\.txt"):
        read_pose_file(tmp_path / "poses.txt")


def test_info_of_a_folder(tmp_path):
    write_kitti(tmp_path)
    found = describe(tmp_path / "velodyne", LogSection())
    assert found.container == "folder of kitti"
    assert [(t.name, t.type, t.serialization, t.count) for t in found.topics] == [
        ("/points", "KITTI", "kitti", 10),
        ("/poses", "poses", "poses", 10),
    ]
    assert [(c.finite, c.point_step) for c in found.clouds] == [(50, 16)]
    assert "log.sensor_frame" in found.problem
    assert line(tmp_path / "velodyne")
    shutil.rmtree(tmp_path / "velodyne")
    (tmp_path / "velodyne").mkdir()
    assert "metadata.yaml" in one_error(tmp_path / "velodyne")


def test_the_example_in_the_docs(tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "logs.md").read_text()
    section = page.partition("## Folders of clouds")[2]
    values = yaml.safe_load(section.partition("```yaml")[2].partition("```")[0])
    names = re.findall(r"drive/([0-9.]+pcd)", section)
    assert len(names) == 2
    for name in names:
        write_xyz(tmp_path / name)
    tum(tmp_path / "poses.tum", [1_700_000_000_000_000_000 + i * 10**8 for i in range(4)])
    choice = describe(tmp_path, LogSection(**values["log"])).choice
    assert (choice.matched, choice.robot_frame, choice.sensor_frame) == (2, "base_link", "lidar")
