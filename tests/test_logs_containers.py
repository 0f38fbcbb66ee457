"""Every kind of file, written by the real libraries, gives the same frames; damaged ones give one line."""

import re
import shutil
import sqlite3
import zipfile

import numpy as np
import pytest
import yaml
from backports import zstd
from logs_writer import (
    CONTAINERS,
    ROS1,
    ROS2,
    TF,
    Record,
    cloud_message,
    cloud_record,
    static_record,
    tf_record,
    write_log,
    write_mcap,
    write_records,
    yaw_quaternion,
)
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Ros1Writer

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.frame import Frame
from gapeval.logs.read import is_costly_to_open, read_frames, read_recording
from gapeval.logs.read.container import Source, in_time_order
from gapeval.logs.read.containers.losses import BAD_CHECKSUM, CUT
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.containers.ros1_index import DAMAGED_INDEX

START = 1_700_000_000_000_000_000
STEP = 100_000_000
COUNT = 8


@pytest.fixture(scope="module")
def clouds():
    rng = np.random.default_rng(1)
    return [(START + i * STEP + 7, rng.normal(size=(150, 3)) * 5) for i in range(COUNT)]


@pytest.fixture(scope="module")
def poses():
    return [(START - STEP // 2 + i * STEP // 2, 0.05 * i, 0.1 * i, 0.02 * i) for i in range(2 * COUNT + 4)]


def digests(path, settings=None):
    recording = read_recording(path, settings or LogSection())
    return [frame.digest for frame in read_frames(recording, 0, recording.matched)]


@pytest.fixture(scope="module")
def expected(tmp_path_factory, clouds, poses):
    path = tmp_path_factory.mktemp("reference") / "log.bag"
    return digests(write_log(path, clouds=clouds, poses=poses, container="bag"))


@pytest.mark.parametrize("container", CONTAINERS)
def test_what_is_costly_to_open(tmp_path, clouds, poses, container):
    """Files whose index does not say where everything is, and files that are compressed as a whole."""
    path = write_log(tmp_path / "log", clouds=clouds, poses=poses, container=container)
    without_index = ("mcap-no-index", "mcap-no-summary", "mcap-unchunked", "mcap-bare")
    assert is_costly_to_open(path) == (container in without_index or "file" in container)
    if path.is_file():
        packed = tmp_path / "packed"
        packed.write_bytes(zstd.compress(path.read_bytes()))
        assert is_costly_to_open(packed)


@pytest.mark.parametrize("container", CONTAINERS)
def test_every_container_gives_the_same_frames(tmp_path, clouds, poses, expected, container):
    path = write_log(tmp_path / "log", clouds=clouds, poses=poses, container=container)
    recording = read_recording(path, LogSection())
    assert recording.matched == recording.total == COUNT == len(set(expected))
    assert recording.refused == {}
    assert recording.notices == ()
    assert [f.digest for f in read_frames(recording, 0, COUNT)] == expected
    assert [f.digest for f in read_frames(recording, 3, 5)] == expected[3:5]
    first = min(clouds[0][0], poses[0][0]) + 1_000_000
    if "file" not in container:
        assert recording.start == first
        assert recording.end == max(clouds[-1][0], poses[-1][0]) + 1_000_000


@pytest.mark.parametrize("container", ["split-sqlite3", "split-mcap", "split-sqlite3-file"])
def test_static_transforms_are_in_the_first_part_only(tmp_path, clouds, poses, container):
    path = write_log(tmp_path / "log", clouds=clouds, poses=poses, container=container)
    names = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    parts = [path / name for name in names["relative_file_paths"]]
    assert len(parts) == 2
    for part, count in zip(parts, (1, 0), strict=True):
        with open_container(part) as opened:
            assert len(list(opened.messages(["/tf_static"], None, None))) == count


def test_a_file_is_known_by_its_content_and_may_have_any_name(tmp_path, clouds, poses, expected):
    for container in ("bag", "mcap", "db3"):
        plain = write_log(tmp_path / container, clouds=clouds, poses=poses, container=container)
        odd = plain.rename(tmp_path / f"{container} 50%20#1?.txt")
        assert digests(odd) == expected


def test_a_compressed_file_by_itself(tmp_path, clouds, poses, expected):
    folder = write_log(tmp_path / "log", clouds=clouds, poses=poses, container="rosbag2-mcap-file")
    assert digests(next(folder.glob("*.zstd"))) == expected


@pytest.mark.parametrize("container", ["bag-lz4", "mcap", "mcap-bare", "sqlite3", "split-mcap"])
def test_reading_starts_in_the_middle(tmp_path, clouds, poses, container):
    path = write_log(tmp_path / "log", clouds=clouds, poses=poses, container=container)
    with open_container(path) as opened:
        every = [(topic.name, time) for topic, time, _ in opened.messages(["/points", "/tf"], None, None)]
        start, stop = every[5][1], every[-4][1]
        some = [(topic.name, time) for topic, time, _ in opened.messages(["/points", "/tf"], start, stop)]
    assert every == sorted(every, key=lambda item: item[1])
    assert some == [item for item in every if start <= item[1] < stop]
    assert 0 < len(some) < len(every)


def test_clouds_are_read_in_the_order_of_their_stamps_whatever_their_order_in_the_log(
    tmp_path, clouds, poses
):
    records = [static_record(START, [("base_link", "lidar", (0, 0, 1), (0, 0, 0, 1))])]
    records += [tf_record(s, [("map", "base_link", (x, y, 0), (0, 0, 0, 1))]) for s, x, y, _ in poses]
    order = [3, 1, 0, 2, 7, 6, 5, 4]
    for place, i in enumerate(order):
        record = cloud_record(clouds[i][0], clouds[i][1])
        # Two with the same bag time, all of them after their stamps.
        records.append(Record(record.topic, record.type, START + (2 + place // 2) * 10**9, record.build))
    recording = read_recording(write_records(tmp_path / "log", records, "mcap"), LogSection())
    frames = list(read_frames(recording, 0, COUNT))
    assert [f.stamp for f in frames] == [stamp for stamp, _ in clouds]
    assert recording.scans.sources.indices.tolist() == [order.index(i) for i in range(COUNT)]
    assert [len(f.points) for f in frames] == [150] * COUNT
    for frame, (_, points) in zip(frames, clouds, strict=True):
        lowered = frame.points - np.array([0, 0, 1], dtype=np.float32)
        np.testing.assert_allclose(lowered, points.astype(np.float32), atol=1e-5)


def test_in_time_order_opens_a_source_only_when_its_time_has_come():
    opened = []

    def source(number, times):
        def messages():
            opened.append(number)
            yield from ((None, time, number) for time in times)

        return Source(times[0], messages)

    merged = in_time_order([source(1, [10, 12, 14]), source(0, [1, 5, 11]), source(2, [20])])
    assert next(merged)[1] == 1
    assert opened == [0]
    assert [time for _, time, _ in merged] == [5, 10, 11, 12, 14, 20]
    assert opened == [0, 1, 2]


def one_line(path, settings=None):
    with pytest.raises(LogError) as caught:
        digests(path, settings)
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text.replace(str(path), "LOG")


def test_what_is_no_log(tmp_path):
    missing = tmp_path / "missing.bag"
    assert "no such file or folder; give a ROS 1 bag" in one_line(missing)
    for name, content in (
        ("empty.bag", b""),
        ("text.mcap", b"hello, world\n"),
        ("junk.db3", bytes(range(256))),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        assert one_line(path).startswith("LOG: no log: it ")
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a", "b")
    assert "no log: it starts with b'PK" in one_line(tmp_path / "a.zip")
    for name in ("empty.bag", "text.mcap", "junk.db3", "a.zip"):
        (tmp_path / name).unlink()
    assert "a folder without metadata.yaml and without any log" in one_line(tmp_path)


def test_a_bag_of_version_1(tmp_path):
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    assert one_line(path) == "LOG: ROS bag of version 1.2; convert it to 2.0 with `rosbag fix`"


def test_a_bag_that_was_never_closed(tmp_path, clouds, poses, expected):
    path = write_log(tmp_path / "log.bag", clouds=clouds, poses=poses, container="bag")
    data = bytearray(path.read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    end = int.from_bytes(data[at : at + 8], "little")
    data[at : at + 8] = bytes(8)
    path.write_bytes(data)
    assert digests(path) == expected
    with open_container(path) as container:
        assert container.notices == (DAMAGED_INDEX,)
        assert container.losses == []
    # The index's own records are all that tells such a bag from one that was killed.
    path.write_bytes(data[:end])
    assert digests(path) == expected
    with open_container(path) as container:
        (loss,) = container.losses
    assert (loss.reason, loss.bytes) == (CUT, None)


@pytest.mark.parametrize("container", ["db3", "mcap"])
@pytest.mark.parametrize("share", [0.001, 0.01])
def test_a_file_of_which_nothing_is_left(tmp_path, clouds, poses, container, share):
    path = write_log(tmp_path / "log", clouds=clouds, poses=poses, container=container)
    data = path.read_bytes()
    path.write_bytes(data[: max(int(len(data) * share), 20)])
    assert re.match(r"LOG: damaged .* of which nothing can be read; record it again", one_line(path))


@pytest.mark.parametrize("container", ["bag", "bag-lz4", "mcap", "mcap-bare", "db3"])
def test_flipped_bytes_never_give_anything_but_frames_or_one_line(tmp_path, clouds, poses, container):
    whole = write_log(tmp_path / "log", clouds=clouds[:3], poses=poses[:8], container=container).read_bytes()
    rng = np.random.default_rng(7)
    path = tmp_path / "damaged"
    lines = []
    for _ in range(40):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 12):
            data[at] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        try:
            assert len(digests_or_refusals(path)) <= 3
        except LogError as error:
            lines.append(str(error))
    assert lines
    assert all(line.startswith(str(path)) and "\n" not in line for line in lines)


def digests_or_refusals(path):
    recording = read_recording(path, LogSection(min_matched=0.0))
    items = list(read_frames(recording, 0, recording.matched))
    return [item.digest if isinstance(item, Frame) else str(item) for item in items]


@pytest.mark.parametrize("options", [{}, {"use_chunking": False, "enable_data_crcs": True}])
def test_a_wrong_checksum_is_found(tmp_path, clouds, options):
    """A chunk is left out; outside of chunks nobody knows which message is wrong, so that is told alone."""
    records = [cloud_record(stamp, points) for stamp, points in clouds]
    path = write_mcap(tmp_path / "log.mcap", records, compression=CompressionType.NONE, **options)
    data = bytearray(path.read_bytes())
    data[data.index(np.float32(clouds[4][1][9, 0]).tobytes())] ^= 1
    path.write_bytes(data)
    with open_container(path) as container:
        read = [time for _, time, _ in container.messages(["/points"], None, None)]
    if options:
        assert container.notices == ("the checksum (CRC) of its data is wrong",)
        assert len(read) == COUNT
        return
    (loss,) = container.losses
    assert (loss.reason, loss.messages) == (BAD_CHECKSUM, COUNT - len(read))
    assert loss.start <= clouds[4][0] <= loss.end
    assert not any(loss.start <= time <= loss.end for time in read)


def test_a_wrong_checksum_of_the_summary_costs_nothing_but_time(tmp_path, clouds, poses, expected):
    path = write_log(tmp_path / "log.mcap", clouds=clouds, poses=poses)
    data = bytearray(path.read_bytes())
    data[data.rindex(b"geometry_msgs/Transform transform")] ^= 1
    path.write_bytes(data)
    recording = read_recording(path, LogSection())
    assert recording.notices == ("the summary is damaged (CRC), so the file was read from end to end",)
    assert [f.digest for f in read_frames(recording, 0, COUNT)] == expected


def test_messages_in_a_write_ahead_log_are_not_lost_silently(tmp_path, clouds, poses, expected):
    path = write_log(tmp_path / "log.db3", clouds=clouds, poses=poses, container="db3")
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute(
        "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages"
    )
    connection.commit()
    for name in ("log.db3", "log.db3-wal"):
        shutil.copy(tmp_path / name, tmp_path / f"copy-{name}")
    connection.close()
    before = {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in tmp_path.glob("copy-*")}
    with open_container(tmp_path / "copy-log.db3") as container:
        assert [t.count for t in container.topics] == [2 * COUNT, 2 * (2 * COUNT + 4), 2]
        assert len(list(container.messages(["/points"], None, None))) == 2 * COUNT
        assert container.losses == []
    assert digests(tmp_path / "copy-log.db3") == expected
    assert before == {
        file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in tmp_path.glob("copy-*")
    }


def test_a_damaged_part_is_named_by_its_own_name(tmp_path, clouds, poses):
    folder = write_log(tmp_path / "log", clouds=clouds, poses=poses, container="db3")
    data = folder.read_bytes()
    packed = tmp_path / "part.db3.zstd"
    packed.write_bytes(zstd.compress(data[:4096]))
    assert one_line(packed).startswith("LOG: damaged rosbag2 sqlite3 (")
    packed.write_bytes(zstd.compress(zstd.compress(data)))
    assert one_line(packed) == "LOG: compressed more than once; unpack it with `zstd -d`"


def test_a_db3_file_from_before_definitions_were_stored(tmp_path, clouds, poses, expected):
    path = write_log(tmp_path / "log.db3", clouds=clouds, poses=poses, container="db3")
    connection = sqlite3.connect(path)
    connection.executescript("DROP TABLE message_definitions; UPDATE schema SET schema_version = 3")
    connection.close()
    assert digests(path) == expected


def test_a_folder_whose_metadata_is_wrong(tmp_path, clouds, poses, expected):
    path = write_log(tmp_path / "log", clouds=clouds, poses=poses, container="sqlite3")
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(text.replace(f"message_count: {COUNT}", "message_count: 5"))
    recording = read_recording(path, LogSection())
    assert recording.notices == (f"/points: metadata.yaml says 5 messages, its files hold {COUNT}",)
    assert [f.digest for f in read_frames(recording, 0, COUNT)] == expected
    for wrong in ("", "[1, 2", "rosbag2_bagfile_information: {}", "rosbag2_bagfile_information: 3"):
        metadata.write_text(wrong)
        recording = read_recording(path, LogSection())
        assert recording.notices == ("metadata.yaml is damaged, so the folder's files were looked into",)
        assert [f.digest for f in read_frames(recording, 0, COUNT)] == expected
    metadata.write_text(text)
    next(path.glob("*.db3")).unlink()
    assert "log.db3 is missing, though metadata.yaml names it" in one_line(path)


def test_fewer_messages_than_the_statistics_say(tmp_path, clouds, poses):
    path = write_log(tmp_path / "log.bag", clouds=clouds, poses=poses, container="bag")
    data = bytearray(path.read_bytes())
    # The last record is the chunk's own count: (connection, messages) pairs.
    at = data.rindex(COUNT.to_bytes(4, "little"))
    data[at : at + 4] = (COUNT + 2).to_bytes(4, "little")
    path.write_bytes(data)
    recording = read_recording(path, LogSection())
    (loss,) = recording.losses
    assert str(loss) == "log.bag: fewer messages on /points than the log's own statistics say (2 messages)"
    strict = "not whole: log.bag: fewer messages on /points than the log's own statistics say (2 messages)"
    assert one_line(path, LogSection(strict=True)) == f"LOG: {strict}; leave out --strict to use the rest"


POINT_CLOUD = ROS2.generate_msgdef("sensor_msgs/msg/PointCloud2", ros_version=2)[0]
WRONG = ("", "nonsense $$$", "uint32 height\n", "Missing thing\nuint8[] data\n")


@pytest.mark.parametrize("definition", [*WRONG, POINT_CLOUD.replace("uint32 offset", "uint8 o")])
def test_definitions_that_cannot_be_used_give_way_to_the_stock_ones(
    tmp_path, clouds, poses, expected, definition
):
    records = log_records(clouds, poses)
    definitions = {"sensor_msgs/msg/PointCloud2": definition, TF: definition}
    path = write_mcap(tmp_path / "log.mcap", records, definitions=definitions)
    assert digests(path) == expected


def test_one_bad_definition_does_not_cost_the_log(tmp_path, clouds, poses, expected):
    records = log_records(clouds, poses)
    odd = Record("/odd", "my_msgs/msg/Odd", START, raw=b"1234")
    path = write_mcap(tmp_path / "log.mcap", [odd, *records], definitions={"my_msgs/msg/Odd": "nonsense $$$"})
    assert digests(path) == expected
    with Ros1Writer(tmp_path / "log.bag") as writer:
        connection = writer.add_connection("/odd", "my_msgs/msg/Odd", msgdef="nonsense $$$", md5sum="0" * 32)
        writer.write(connection, START, b"1234")
        for record in records:
            # The definition of every message in this bag is empty.
            known = [c for c in writer.connections if c.topic == record.topic]
            connection = (known or [writer.add_connection(record.topic, record.type, msgdef="", md5sum="1")])[
                0
            ]
            writer.write(connection, record.time, bytes(ROS1.serialize_ros1(record.build(ROS1), record.type)))
    assert digests(tmp_path / "log.bag") == expected


def test_ros_1_messages_in_mcap(tmp_path, clouds, poses, expected):
    records = log_records(clouds, poses)
    path = write_mcap(
        tmp_path / "log.mcap", records, profile="ros1", encoding="ros1", schema_encoding="ros1msg"
    )
    assert digests(path) == expected


def log_records(clouds, poses):
    records = [static_record(START, [("base_link", "lidar", (0, 0, 1), (0, 0, 0, 1))])]
    records += [tf_record(s, [("map", "base_link", (x, y, 0), yaw_quaternion(w))]) for s, x, y, w in poses]
    return records + [cloud_record(stamp, points) for stamp, points in clouds]


def test_big_endian_cdr(tmp_path, clouds, poses, expected):
    records = []
    for record in log_records(clouds, poses):
        raw = ROS2.serialize_cdr(record.build(ROS2), record.type, little_endian=False)
        records.append(Record(record.topic, record.type, record.time, raw=bytes(raw)))
    path = write_mcap(tmp_path / "log.mcap", records)
    assert digests(path) == expected


@pytest.mark.parametrize("encoding", ["flatbuffer", "cbor"])
def test_other_encodings_are_named(tmp_path, encoding):
    record = Record("/scan", "foxglove.PointCloud", START, raw=b"{}")
    definitions = {"foxglove.PointCloud": ""}
    path = write_mcap(
        tmp_path / "log.mcap",
        [record],
        profile="",
        encoding=encoding,
        schema_encoding=encoding,
        definitions=definitions,
    )
    assert one_line(path) == (
        "LOG: no clouds: gapeval reads PointCloud2, LaserScan, MultiEchoLaserScan, and what Livox and "
        f"Foxglove have for them, and the log has foxglove.PointCloud as {encoding} on /scan (1)"
    )
    asked = one_line(path, LogSection(cloud_topic="/scan"))
    assert f"--cloud-topic /scan is foxglove.PointCloud as {encoding}, and gapeval reads" in asked


def test_messages_that_cannot_be_decoded_are_counted(tmp_path, clouds, poses):
    """In the survey where their header is broken, else when they are read."""
    records, last = log_records(clouds, poses), clouds[-1][0]
    cut = [
        bytes(ROS2.serialize_cdr(cloud_message(ROS2, last + i, "lidar", clouds[0][1]), records[-1].type))
        for i in (1, 2)
    ]
    for number, raw in enumerate((b"", b"\x07\x01" + cut[0][2:], cut[0][:40], cut[1][:-9])):
        records.append(Record("/points", records[-1].type, last + number + 1, raw=raw))
    recording = read_recording(write_mcap(tmp_path / "log.mcap", records), LogSection())
    assert (recording.matched, recording.total) == (COUNT + 2, COUNT + 4)
    assert recording.refused == {"message cannot be decoded": 2}
    items = list(read_frames(recording, 0, COUNT + 2))
    assert [item.reason for item in items[COUNT:]] == ["message cannot be decoded"] * 2
    assert all(isinstance(item, Frame) for item in items[:COUNT])
