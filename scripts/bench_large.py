"""How long it takes to open logs of 100 GB and to read the heads of their clouds, and in how much memory.

No part of ./scripts/bench: `python scripts/bench_large.py FOLDER [CLOUDS] [BYTES]`, on a file system that has
sparse files. The clouds' points are holes, which take no space; headers, chunks and indexes are there. A
database cannot have holes, so that one is small and full.
"""

import argparse
import resource
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import BinaryIO

START = 1_700_000_000_000_000_000
STEP = 100_000_000  # ns between clouds
TF = 5  # small messages for each cloud
SECOND = 1_000_000_000
PARTS = ("open", "heads", "tenth")  # the last: whole messages of ten seconds in the middle


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("clouds", type=int, nargs="?", default=100_000)
    parser.add_argument("bytes", type=int, nargs="?", default=1_000_000, help="of each cloud")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    small = min(asked.clouds, 3000)
    for name, write, clouds in (
        ("bag", write_bag, asked.clouds),
        ("mcap", write_mcap, asked.clouds),
        ("db3", write_db3, small),
    ):
        path = asked.folder / f"large.{name}"
        if not path.exists():
            write(path, clouds, asked.bytes)
        print(f"{name}: {clouds} clouds, {path.stat().st_size / 1e9:.1f} GB", flush=True)
        for part in PARTS:
            # A process of its own, so that what it held at most is known.
            code = f"import bench_large; bench_large.measure({str(path)!r}, {part!r}, {clouds})"
            subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=True)
        if name != "db3":
            code = f"import bench_large; bench_large.rosbags_alone({str(path)!r}, {name!r})"
            subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, check=False)


def measure(path: str, part: str, clouds: int) -> None:
    from gapeval.logs.read.containers.opening import open_container

    middle = START + clouds // 2 * STEP
    begun, before = time.perf_counter(), peak()
    with open_container(Path(path)) as container:
        count, size = 0, 0
        if part == "heads":
            messages = container.heads({"/points"}, {"/tf"}, None, None)
        else:
            span = (middle, middle + 10 * SECOND) if part == "tenth" else (0, 0)
            messages = container.messages({"/points"}, *span)
        for _, _, raw in messages:
            count, size = count + 1, size + len(raw)
        assert not container.losses
    took = time.perf_counter() - begun
    print(
        f"  {part}: {took:.2f} s, {count} messages, {size / 1e6:.0f} MB; {before:.0f} -> {peak():.0f} MB",
        flush=True,
    )


def rosbags_alone(path: str, name: str) -> None:
    from rosbags.rosbag1 import Reader
    from rosbags.rosbag2.storage_mcap import McapReader

    begun, before = time.perf_counter(), peak()
    reader = Reader(path) if name == "bag" else McapReader(Path(path))
    reader.open()
    took = time.perf_counter() - begun
    print(f"  rosbags alone, open: {took:.2f} s; {before:.0f} -> {peak():.0f} MB", flush=True)


def peak() -> float:
    """Most memory that the process ever held [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def head(stamp: int) -> bytes:
    """The beginning of a cloud: its header in ROS 1."""
    frame = b"lidar"
    return struct.pack("<III", 0, *divmod(stamp, SECOND)) + struct.pack("<I", len(frame)) + frame


def hole(file: BinaryIO, length: int) -> None:
    file.seek(length, 1)


def ros1_header(**fields: bytes) -> bytes:
    items = [name.encode() + b"=" + value for name, value in fields.items()]
    content = b"".join(struct.pack("<I", len(item)) + item for item in items)
    return struct.pack("<I", len(content)) + content


def ros1_time(time_: int) -> bytes:
    return struct.pack("<II", *divmod(time_, SECOND))


def write_bag(path: Path, clouds: int, size: int) -> None:
    topics = {0: (b"/points", b"sensor_msgs/PointCloud2"), 1: (b"/tf", b"tf2_msgs/TFMessage")}
    number = [struct.pack("<I", i) for i in topics]
    with path.open("wb") as file:
        file.write(b"#ROSBAG V2.0\n" + bytes(4096))
        infos = []
        for cloud in range(clouds):
            stamp, at = START + cloud * STEP, file.tell()
            items = [(stamp + i * STEP // TF, 1, bytes(100), 0) for i in range(TF)]
            items.append((stamp + STEP // 2, 0, head(stamp), size - len(head(stamp))))
            parts, entries, offset = [], {0: b"", 1: b""}, 0
            for when, owner, data, more in sorted(items):
                record = ros1_header(op=b"\x02", conn=number[owner], time=ros1_time(when))
                record += struct.pack("<I", len(data) + more) + data
                entries[owner] += ros1_time(when) + struct.pack("<I", offset)
                parts.append((record, more))
                offset += len(record) + more
            file.write(ros1_header(op=b"\x05", compression=b"none", size=struct.pack("<I", offset)))
            file.write(struct.pack("<I", offset))
            for record, more in parts:
                file.write(record)
                hole(file, more)
            for owner, found in entries.items():
                count = struct.pack("<I", len(found) // 12)
                file.write(ros1_header(op=b"\x04", ver=struct.pack("<I", 1), conn=number[owner], count=count))
                file.write(struct.pack("<I", len(found)) + found)
            infos.append((at, stamp, stamp + (TF - 1) * STEP // TF))
        index = file.tell()
        for owner, (topic, kind) in topics.items():
            file.write(ros1_header(op=b"\x07", conn=number[owner], topic=topic))
            details = ros1_header(topic=topic, type=kind, md5sum=b"0" * 32, message_definition=b"")
            file.write(details)
        for at, start, end in infos:
            fields = {"chunk_pos": struct.pack("<Q", at), "count": struct.pack("<I", 2)}
            times = {"start_time": ros1_time(start), "end_time": ros1_time(end)}
            file.write(ros1_header(op=b"\x06", ver=struct.pack("<I", 1), **fields, **times))
            file.write(struct.pack("<IIIII", 16, 0, 1, 1, TF))
        file.seek(13)
        counts = {"conn_count": struct.pack("<I", 2), "chunk_count": struct.pack("<I", clouds)}
        header = ros1_header(op=b"\x03", index_pos=struct.pack("<Q", index), **counts)
        file.write(header + struct.pack("<I", 4092 - len(header)) + b" " * (4092 - len(header)))


def mcap_record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def write_mcap(path: Path, clouds: int, size: int) -> None:
    magic, crlf = b"\x89MCAP0\r\n", b"ros2"
    kinds = (b"sensor_msgs/msg/PointCloud2", b"tf2_msgs/msg/TFMessage")
    described = b""
    for i, (topic, kind) in enumerate(zip((b"/points", b"/tf"), kinds, strict=True), start=1):
        described += mcap_record(3, struct.pack("<H", i) + text(kind) + text(b"ros2msg") + text(b""))
        described += mcap_record(4, struct.pack("<HH", i, i) + text(topic) + text(b"cdr") + text(b""))
    with path.open("wb") as file:
        file.write(magic + mcap_record(1, text(crlf) + text(b"")) + described)
        chunks = []
        for cloud in range(clouds):
            stamp, at = START + cloud * STEP, file.tell()
            items = [(stamp + i * STEP // TF, 2, bytes(100), 0) for i in range(TF)]
            items.append((stamp + STEP // 2, 1, head(stamp), size - len(head(stamp))))
            end, offset, parts, entries = max(items)[0], 0, [], {1: b"", 2: b""}
            for when, channel, data, more in sorted(items):
                message = struct.pack("<HIQQ", channel, 0, when, when) + data
                record = struct.pack("<BQ", 5, len(message) + more) + message
                entries[channel] += struct.pack("<QQ", when, offset)
                parts.append((record, more))
                offset += len(record) + more
            fields = struct.pack("<QQQII", stamp, end, offset, 0, 0) + struct.pack("<Q", offset)
            file.write(struct.pack("<BQ", 6, len(fields) + offset) + fields)
            for record, more in parts:
                file.write(record)
                hole(file, more)
            stop, places = file.tell(), b""
            for channel, found in entries.items():
                places += struct.pack("<HQ", channel, file.tell())
                file.write(mcap_record(7, struct.pack("<H", channel) + text(found)))
            index = struct.pack("<QQQQ", stamp, end, at, stop - at) + text(places)
            index += struct.pack("<Q", file.tell() - stop) + text(b"") + struct.pack("<QQ", offset, offset)
            chunks.append(mcap_record(8, index))
        file.write(mcap_record(15, struct.pack("<I", 0)))
        start = file.tell()
        file.write(described + b"".join(chunks))
        counts = struct.pack("<HQHQ", 1, clouds, 2, clouds * TF)
        span = (START, START + (clouds - 1) * STEP + (TF - 1) * STEP // TF)
        statistics = struct.pack("<QHIIIIQQ", clouds * (TF + 1), 2, 2, 0, 0, clouds, *span) + text(counts)
        file.write(mcap_record(11, statistics))
        file.write(mcap_record(2, struct.pack("<QQI", start, 0, 0)) + magic)


def write_db3(path: Path, clouds: int, size: int) -> None:
    import sqlite3

    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

    with sqlite3.connect(path) as database:
        database.executescript(Sqlite3Writer.SQLITE_SCHEMA)
        kinds = ("sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage")
        for i, (topic, kind) in enumerate(zip(("/points", "/tf"), kinds, strict=True), start=1):
            database.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '', '')", (i, topic, kind))
        for cloud in range(clouds):
            stamp = START + cloud * STEP
            rows = [(2, stamp + i * STEP // TF, bytes(100)) for i in range(TF)]
            rows.append((1, stamp + STEP // 2, head(stamp) + bytes(size - len(head(stamp)))))
            database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    database.close()


if __name__ == "__main__":
    main()
