"""Logs that are broken in one way each: written by the real libraries, then damaged at one place.

Every one knows which of its messages can be read, worked out by the libraries on the whole log.
"""

import shutil
import sqlite3
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from backports import zstd
from logs_writer import (
    HERE,
    ROS1,
    ROS2,
    START,
    STEP,
    Record,
    cloud_record,
    lidar,
    pose_record,
    tf_record,
    write_mcap,
    write_records,
)
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, IndexType
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer

from gapeval.logs.read.containers import losses
from gapeval.logs.read.containers.mcap_index import CONTRADICTED, DAMAGED_SUMMARY
from gapeval.logs.read.containers.ros1_index import DAMAGED_INDEX
from gapeval.logs.read.containers.sqlite_file import DAMAGED as DAMAGED_DATABASE

Sent = tuple[str, int, bytes]  # topic, bag time, data

CLOUD = "sensor_msgs/msg/PointCloud2"
CHUNK = 6000  # bytes after which the tests' writers close a chunk


@dataclass(frozen=True)
class Damaged:
    """A broken log. sent: what can be read of it; reasons: of its losses in their order; heads: whether those
    are of `sent` alone, which checksums over more than a head would be needed for."""

    path: Path
    sent: list[Sent]
    reasons: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    heads: bool = True


def records(count: int = 10) -> list[Record]:
    """A drive: clouds of 40 to 50 points, tf between them, the laser's place at its beginning."""
    random = np.random.default_rng(3)
    found = [*lidar()] if isinstance(lidar(), list) else [lidar()]
    for i in range(-1, count + 1):
        found.append(tf_record(START + i * STEP, [("map", "base_link", (i / 10, 0, 0), HERE)]))
        points = random.normal(size=(40 + i, 3)) * 4 + [0, 0, 6]
        if 0 <= i < count:
            found.append(cloud_record(START + i * STEP + 1000, points))
            if i > count // 2:
                found.append(pose_record(START + i * STEP + 2000, "map", (i / 10, 0, 0)))
            found.append(
                tf_record(START + i * STEP + STEP // 2, [("map", "base_link", (i / 10, 0, 0), HERE)])
            )
    return sorted(found, key=lambda record: record.time)


def sent(items: Sequence[Record], version: int = 2) -> list[Sent]:
    """What was written, by the typestores themselves."""
    made = []
    for item in items:
        store = ROS1 if version == 1 else ROS2
        serialize = store.serialize_ros1 if version == 1 else store.serialize_cdr
        made.append((item.topic, item.time, item.raw or bytes(serialize(item.build(store), item.type))))
    return made


# ROS 1 bags


def bag(path: Path, codec: str = "none", definitions: dict[str, tuple[str, str]] | None = None) -> Path:
    """A bag of several chunks; definitions: text and md5 by topic in place of the right ones."""
    writer = Ros1Writer(path)
    if codec != "none":
        writer.set_compression(Ros1Writer.CompressionFormat[codec.upper()])
    writer.chunk_threshold = CHUNK
    with writer:
        connections = {}
        for item in records():
            if item.topic not in connections:
                text = (definitions or {}).get(item.topic)
                options = {"typestore": ROS1} if text is None else {"msgdef": text[0], "md5sum": text[1]}
                connections[item.topic] = writer.add_connection(item.topic, item.type, **options)
            raw = bytes(ROS1.serialize_ros1(item.build(ROS1), item.type))
            writer.write(connections[item.topic], item.time, raw)
    return path


@dataclass(frozen=True)
class BagMap:
    """Where things are in a whole bag, by rosbags. chunks: (offset of the record, of its data, length);
    places: chunk and offset in it of each message, in the order of sent."""

    chunks: list[tuple[int, int, int]]
    index: int
    sent: list[Sent]
    places: list[tuple[int, int]]

    def outside(self, *lost: int) -> list[Sent]:
        return [one for one, (chunk, _) in zip(self.sent, self.places, strict=True) if chunk not in lost]


def bag_map(path: Path) -> BagMap:
    with Ros1Reader(path) as reader:
        order = [info.pos for info in reader.chunk_infos]
        chunks = [(at, reader.chunks[at].datapos, reader.chunks[at].datasize) for at in order]
        entries = sorted(
            (entry.time, order.index(entry.chunk_pos), entry.offset, owner)
            for owner, found in reader.indexes.items()
            for entry in found
        )
        topics = {c.id: c.topic for c in reader.connections}
        data = {(topics[c.id], time): bytes(raw) for c, time, raw in reader.messages()}
        header = path.read_bytes()[:200]
    at = header.index(b"index_pos=") + 10
    found = [(topics[owner], time, data[topics[owner], time]) for time, _, _, owner in entries]
    return BagMap(chunks, int.from_bytes(header[at : at + 8], "little"), found, [e[1:3] for e in entries])


def never_closed_bag(folder: Path, codec: str) -> Damaged:
    path = bag(folder / "log.bag.active", codec)
    known, data = bag_map(path), bytearray(path.read_bytes()[: bag_map(path).index])
    for name, size in ((b"index_pos=", 8), (b"conn_count=", 4), (b"chunk_count=", 4)):
        at = data.index(name) + len(name)
        data[at : at + size] = bytes(size)
    path.write_bytes(data)
    return Damaged(path, known.sent, (losses.CUT,), (DAMAGED_INDEX,))


def cut_bag(folder: Path, codec: str) -> Damaged:
    """In the middle of its third chunk, of which the whole messages are left if it is plain."""
    path = bag(folder / "log.bag", codec)
    known = bag_map(path)
    _, start, length = known.chunks[2]
    path.write_bytes(path.read_bytes()[: start + length // 2])
    left = known.outside(*range(2, len(known.chunks)))
    if codec == "none":
        third = sorted(
            (at, one) for one, (chunk, at) in zip(known.sent, known.places, strict=True) if chunk == 2
        )
        ends = [at for at, _ in third[1:]] + [length]
        left += [one for (_, one), end in zip(third, ends, strict=True) if end <= length // 2]
    return Damaged(path, left, (losses.CUT,), (DAMAGED_INDEX,))


def cut_index_bag(folder: Path, codec: str) -> Damaged:
    path = bag(folder / "log.bag", codec)
    known = bag_map(path)
    path.write_bytes(path.read_bytes()[: known.index + 300])
    return Damaged(path, known.sent, (losses.CUT,), (DAMAGED_INDEX,))


def damaged_index_bag(folder: Path, codec: str) -> Damaged:
    """One byte of the index is wrong."""
    path = bag(folder / "log.bag", codec)
    known, data = bag_map(path), bytearray(path.read_bytes())
    data[data.index(b"chunk_pos=", known.index) + 1] ^= 0x20
    path.write_bytes(data)
    return Damaged(path, known.sent, (), (DAMAGED_INDEX,))


def misplaced_index_bag(folder: Path, codec: str) -> Damaged:
    """Bytes were put in between two chunks: all that is behind stands elsewhere than the index says."""
    path = bag(folder / "log.bag", codec)
    known, data = bag_map(path), path.read_bytes()
    at = known.chunks[2][0]
    path.write_bytes(data[:at] + bytes(100) + data[at:])
    return Damaged(path, known.sent, (losses.UNREADABLE_RECORDS,), (DAMAGED_INDEX,))


def swapped_index_bag(folder: Path, codec: str) -> Damaged:
    """The index has the chunks right but for one, whose place it takes from another."""
    path = bag(folder / "log.bag", codec)
    known, data = bag_map(path), bytearray(path.read_bytes())
    one, other = (known.chunks[i][0].to_bytes(8, "little") for i in (1, 0))
    at = data.index(b"chunk_pos=" + one, known.index) + 10
    data[at : at + 8] = other
    path.write_bytes(data)
    return Damaged(path, known.sent, (losses.INDEX_LIES,))


def damaged_chunk_bag(folder: Path, codec: str) -> Damaged:
    """Of a compressed chunk nothing can be used; of a plain one the messages behind the damage can."""
    path = bag(folder / "log.bag", codec)
    known, data = bag_map(path), bytearray(path.read_bytes())
    _, start, length = known.chunks[1]
    if codec != "none":
        data[start + length // 2 : start + length // 2 + 40] = bytes(40)
        path.write_bytes(data)
        return Damaged(path, known.outside(1), (losses.BAD_CHUNK,))
    number, (_, at) = next((i, place) for i, place in enumerate(known.places) if place[0] == 1 and place[1])
    data[start + at + 4 : start + at + 8] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    left = [one for i, one in enumerate(known.sent) if i != number]
    return Damaged(path, left, (losses.BAD_CHUNK_RECORDS,))


def bomb_bag(folder: Path, codec: str) -> Damaged:
    """A chunk says it holds 4 GB."""
    path = bag(folder / "log.bag", codec)
    known, data = bag_map(path), bytearray(path.read_bytes())
    at = data.index(b"size=", known.chunks[1][0]) + 5
    data[at : at + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(data)
    # Nobody needs to know how large a plain chunk is.
    return Damaged(path, known.sent) if codec == "none" else Damaged(path, known.outside(1), (losses.BOMB,))


def lying_size_bag(folder: Path, codec: str) -> Damaged:
    """A chunk says it holds less than it does."""
    path = bag(folder / "log.bag", codec)
    known, data = bag_map(path), bytearray(path.read_bytes())
    at = data.index(b"size=", known.chunks[1][0]) + 5
    data[at : at + 4] = (100).to_bytes(4, "little")
    path.write_bytes(data)
    return Damaged(path, known.outside(1), (losses.BAD_CHUNK,))


def odd_definitions_bag(folder: Path, codec: str) -> Damaged:
    definitions = {"/points": ("nonsense $$$", "0" * 32), "/tf": ("", "1" * 32)}
    path = bag(folder / "log.bag", codec, definitions)
    return Damaged(path, sent(records(), 1))


BAG_DAMAGES: tuple[Callable[[Path, str], Damaged], ...] = (
    never_closed_bag,
    cut_bag,
    cut_index_bag,
    damaged_index_bag,
    misplaced_index_bag,
    swapped_index_bag,
    damaged_chunk_bag,
    bomb_bag,
    odd_definitions_bag,
)


# MCAP


CODECS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
BARE = {
    "index_types": IndexType.NONE,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_statistics": False,
    "use_summary_offsets": False,
}


def mcap(path: Path, codec: str = "none", **options: object) -> Path:
    return write_mcap(path, records(), chunk_size=CHUNK, compression=CODECS[codec], **options)


@dataclass(frozen=True)
class McapMap:
    """Where things are in a whole MCAP file. top: (opcode, offset, stop) of each record; chunks: (offset,
    stop) of those that are chunks; held: what is in each."""

    top: list[tuple[int, int, int]]
    chunks: list[tuple[int, int]]
    held: list[list[Sent]]

    @property
    def sent(self) -> list[Sent]:
        return [one for chunk in self.held for one in chunk]

    def outside(self, *lost: int) -> list[Sent]:
        return [one for i, chunk in enumerate(self.held) if i not in lost for one in chunk]


def mcap_map(path: Path) -> McapMap:
    data, at, top = path.read_bytes(), 8, []
    while at < len(data) - 8:
        stop = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        top.append((data[at], at, stop))
        at = stop
    topics, held = {}, []
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                found = []
                for inner in breakup_chunk(record):
                    if hasattr(inner, "topic"):
                        topics[inner.id] = inner.topic
                    elif hasattr(inner, "log_time"):
                        found.append((topics[inner.channel_id], inner.log_time, inner.data))
                held.append(found)
    return McapMap(top, [(start, stop) for opcode, start, stop in top if opcode == 6], held)


def no_message_index_mcap(folder: Path, codec: str) -> Damaged:
    path = mcap(folder / "log.mcap", codec, index_types=IndexType.CHUNK)
    return Damaged(path, mcap_map(path).sent)


def no_footer_mcap(folder: Path, codec: str) -> Damaged:
    """Killed between two chunks."""
    path = mcap(folder / "log.mcap", codec)
    known = mcap_map(path)
    path.write_bytes(path.read_bytes()[: known.chunks[2][0]])
    return Damaged(path, known.outside(*range(2, len(known.chunks))), (losses.CUT,))


def cut_mcap(folder: Path, codec: str) -> Damaged:
    """In the middle of its third chunk, of which the whole messages are left if it is plain."""
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), path.read_bytes()
    start, stop = known.chunks[2]
    end = (start + stop) // 2
    path.write_bytes(data[:end])
    left = known.outside(*range(2, len(known.chunks)))
    if codec == "none":
        left += [one for one in known.held[2] if data.index(one[2], start) + len(one[2]) <= end]
    return Damaged(path, left, (losses.CUT,))


def bad_checksum_mcap(folder: Path, codec: str) -> Damaged:
    """The last byte of a chunk's data is wrong, with its CRC where it is plain."""
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), bytearray(path.read_bytes())
    crc = known.chunks[1][0] + 9 + 24
    data[crc] ^= 1
    path.write_bytes(data)
    return Damaged(path, known.outside(1), (losses.BAD_CHECKSUM,), heads=codec != "none")


def damaged_chunk_mcap(folder: Path, codec: str) -> Damaged:
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), bytearray(path.read_bytes())
    start, stop = known.chunks[1]
    data[start + 60 : stop - 4] = bytes(stop - 4 - start - 60)
    path.write_bytes(data)
    return Damaged(path, known.outside(1), (losses.BAD_CHECKSUM if codec == "none" else losses.BAD_CHUNK,))


def bad_summary_mcap(folder: Path, codec: str) -> Damaged:
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), bytearray(path.read_bytes())
    data[data.rindex(b"geometry_msgs/Transform transform")] ^= 1
    path.write_bytes(data)
    return Damaged(path, known.sent, (), (DAMAGED_SUMMARY,))


def misplaced_chunks_mcap(folder: Path, codec: str) -> Damaged:
    """Bytes were put in between two chunks: all that is behind stands elsewhere than the index says."""
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), path.read_bytes()
    at = known.chunks[2][0]
    moved = bytearray(data[:at] + bytes(100) + data[at:])
    # The footer says where the summary begins, and its CRC is over that as well.
    start = int.from_bytes(moved[-28:-20], "little") + 100
    moved[-28:-20] = start.to_bytes(8, "little")
    moved[-12:-8] = bytes(4)
    path.write_bytes(moved)
    return Damaged(path, known.sent, (losses.UNREADABLE_RECORDS,), (CONTRADICTED,))


def unknown_records_mcap(folder: Path, codec: str) -> Damaged:
    """Records of kinds that are still to be invented, and private ones, between the others."""
    path = mcap(folder / "log.mcap", codec, **BARE)
    known, data = mcap_map(path), path.read_bytes()
    odd = b"".join(struct.pack("<BQ", opcode, 5) + b"12345" for opcode in (0x42, 0x80, 0xFE))
    at = known.chunks[1][0]
    path.write_bytes(data[:at] + odd + data[at:])
    return Damaged(path, known.sent)


def undescribed_mcap(folder: Path, codec: str) -> Damaged:
    """A chunk with a channel's description is lost, and nothing repeats it."""
    path = mcap(folder / "log.mcap", codec, **BARE)
    known, data = mcap_map(path), bytearray(path.read_bytes())
    start, stop = known.chunks[0]
    data[start + 60 : stop - 4] = bytes(stop - 4 - start - 60)
    path.write_bytes(data)
    described = {topic for topic, _, _ in known.held[0]}
    left = [one for one in known.outside(0) if one[0] not in described]
    reason = losses.BAD_CHECKSUM if codec == "none" else losses.BAD_CHUNK
    undescribed = {topic for topic, _, _ in known.outside(0)} & described
    return Damaged(path, left, (reason, *[losses.UNDESCRIBED] * len(undescribed)))


def described_again_mcap(folder: Path, codec: str) -> Damaged:
    """The same with a summary that repeats it; its CRC is wrong, so that the file is walked through."""
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), bytearray(path.read_bytes())
    start, stop = known.chunks[0]
    data[start + 60 : stop - 4] = bytes(stop - 4 - start - 60)
    data[-10] ^= 1
    path.write_bytes(data)
    reason = losses.BAD_CHECKSUM if codec == "none" else losses.BAD_CHUNK
    return Damaged(path, known.outside(0), (reason,), (DAMAGED_SUMMARY,))


def bomb_mcap(folder: Path, codec: str) -> Damaged:
    """A chunk says that it holds 2**40 bytes."""
    path = mcap(folder / "log.mcap", codec)
    known, data = mcap_map(path), bytearray(path.read_bytes())
    at = known.chunks[1][0] + 9 + 16
    data[at : at + 8] = (1 << 40).to_bytes(8, "little")
    path.write_bytes(data)
    return Damaged(path, known.outside(1), (losses.BAD_CHUNK if codec == "none" else losses.BOMB,))


def out_of_order_mcap(folder: Path, codec: str) -> Damaged:
    """Not damaged at all, but not in the order of time either, within chunks and between them."""
    mixed = records()[::-1]
    path = write_mcap(folder / "log.mcap", mixed, chunk_size=CHUNK, compression=CODECS[codec])
    return Damaged(path, sent(mixed))


def without_schema_mcap(folder: Path, codec: str) -> Damaged:
    from mcap.writer import Writer

    path = folder / "log.mcap"
    writer = Writer(str(path), chunk_size=CHUNK, compression=CODECS[codec])
    writer.start(profile="ros2")
    bare = writer.register_channel("/bare", "cdr", 0)
    for i in range(5):
        writer.add_message(bare, START + i, bytes([i]) * 50, START + i)
    writer.finish()
    return Damaged(path, [("/bare", START + i, bytes([i]) * 50) for i in range(5)])


def bad_data_checksum_mcap(folder: Path, codec: str) -> Damaged:
    options = {**BARE, "use_chunking": False, "enable_data_crcs": True}
    path = mcap(folder / "log.mcap", codec, **options)
    data = bytearray(path.read_bytes())
    at = next(start for opcode, start, _ in mcap_map(path).top if opcode == 15) + 9
    data[at] ^= 1
    path.write_bytes(data)
    return Damaged(path, sent(records()), (), ("the checksum (CRC) of its data is wrong",))


def damaged_message_mcap(folder: Path, codec: str) -> Damaged:
    """A message outside of chunks whose length is wrong."""
    path = mcap(folder / "log.mcap", codec, **{**BARE, "use_chunking": False})
    data, messages = bytearray(path.read_bytes()), [r for r in mcap_map(path).top if r[0] == 5]
    at = messages[7][1]
    data[at + 1 : at + 9] = b"\xff" * 8
    path.write_bytes(data)
    whole = sent(records())
    return Damaged(path, whole[:7] + whole[8:], (losses.UNREADABLE_RECORDS,))


MCAP_DAMAGES: tuple[Callable[[Path, str], Damaged], ...] = (
    no_message_index_mcap,
    no_footer_mcap,
    cut_mcap,
    bad_checksum_mcap,
    damaged_chunk_mcap,
    bad_summary_mcap,
    misplaced_chunks_mcap,
    unknown_records_mcap,
    undescribed_mcap,
    described_again_mcap,
    bomb_mcap,
    out_of_order_mcap,
    without_schema_mcap,
    bad_data_checksum_mcap,
    damaged_message_mcap,
)


# sqlite3


def db3(path: Path) -> Path:
    return write_records(path, records(40), "db3")


def in_wal_db3(folder: Path) -> Damaged:
    """Killed while most messages were still in the -wal."""
    path = db3(folder / "whole.db3")
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute(
        "INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp + 1, data FROM messages"
    )
    connection.commit()
    for suffix in ("", "-wal"):
        shutil.copy(f"{path}{suffix}", folder / f"log.db3{suffix}")
    connection.close()
    once = sent(records(40))
    return Damaged(folder / "log.db3", once + [(topic, time + 1, raw) for topic, time, raw in once])


def no_definitions_db3(folder: Path) -> Damaged:
    path = db3(folder / "log.db3")
    connection = sqlite3.connect(path)
    connection.executescript("DROP TABLE message_definitions; UPDATE schema SET schema_version = 3")
    connection.close()
    return Damaged(path, sent(records(40)))


def odd_definitions_db3(folder: Path) -> Damaged:
    path = db3(folder / "log.db3")
    connection = sqlite3.connect(path)
    connection.execute(
        "UPDATE message_definitions SET encoding = 'odd', encoded_message_definition = 'nonsense $$$'"
    )
    connection.commit()
    connection.close()
    return Damaged(path, sent(records(40)))


def damaged_page_db3(folder: Path) -> Damaged:
    """One leaf with rows of the table of messages is zero."""
    path = db3(folder / "log.db3")
    data, whole = bytearray(path.read_bytes()), sent(records(40))
    pages = [at for at in range(4096, len(data), 4096) if data[at] == 0x0D]
    held = {at: [one for one in whole if one[1].to_bytes(8, "big") in data[at : at + 4096]] for at in pages}
    page = next(at for at in pages[len(pages) // 2 :] if held[at])
    data[page : page + 4096] = bytes(4096)
    path.write_bytes(data)
    left = [one for one in whole if one not in held[page]]
    return Damaged(path, left, (losses.MISSING_ROWS,), (DAMAGED_DATABASE,))


def damaged_tree_db3(folder: Path) -> Damaged:
    """The page over the leaves of the table of messages is zero; all rows are still there."""
    path = db3(folder / "log.db3")
    connection = sqlite3.connect(path)
    (root,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    connection.close()
    data = bytearray(path.read_bytes())
    assert data[(root - 1) * 4096] == 0x05
    data[(root - 1) * 4096 : root * 4096] = bytes(4096)
    path.write_bytes(data)
    return Damaged(path, sent(records(40)), (), (DAMAGED_DATABASE,))


def bad_compression_db3(folder: Path) -> Damaged:
    """One message of a log that is compressed message by message."""
    path = write_records(folder / "log.db3", records(40), "db3-message")
    connection = sqlite3.connect(path)
    (raw,) = connection.execute("SELECT data FROM messages WHERE id = 9").fetchone()
    connection.execute("UPDATE messages SET data = ? WHERE id = 9", (raw[: len(raw) // 2],))
    connection.commit()
    connection.close()
    whole = sent(records(40))
    return Damaged(path, whole[:8] + whole[9:], (losses.BAD_MESSAGE,))


def bomb_db3(folder: Path) -> Damaged:
    """A message that says it holds 2**40 bytes."""
    path = db3(folder / "log.db3")
    frame = b"\x28\xb5\x2f\xfd\xe0" + (1 << 40).to_bytes(8, "little") + bytes(100)
    connection = sqlite3.connect(path)
    connection.execute("UPDATE messages SET data = ? WHERE id = 9", (frame,))
    connection.commit()
    connection.close()
    whole = sent(records(40))
    return Damaged(path, whole[:8] + whole[9:], (losses.BOMB,))


def odd_columns_db3(folder: Path) -> Damaged:
    path = db3(folder / "log.db3")
    connection = sqlite3.connect(path)
    connection.execute("UPDATE messages SET data = 'text' WHERE id = 9")
    connection.commit()
    connection.close()
    whole = sent(records(40))
    return Damaged(path, whole[:8] + whole[9:], (losses.ODD_ROW,))


DB3_DAMAGES: tuple[Callable[[Path], Damaged], ...] = (
    in_wal_db3,
    no_definitions_db3,
    odd_definitions_db3,
    damaged_page_db3,
    damaged_tree_db3,
    bad_compression_db3,
    bomb_db3,
    odd_columns_db3,
)


# Folders, and files that are compressed as a whole

LOOKED_INTO = "so the folder's files were looked into"


def split(folder: Path, container: str = "split-mcap") -> Path:
    return write_records(folder / "log", records(), container)


def no_metadata_folder(folder: Path) -> Damaged:
    path = split(folder)
    (path / "metadata.yaml").unlink()
    return Damaged(path, sent(records()), (), (f"there is no metadata.yaml, {LOOKED_INTO}",))


def empty_metadata_folder(folder: Path) -> Damaged:
    path = split(folder, "split-sqlite3")
    (path / "metadata.yaml").write_bytes(b"")
    return Damaged(path, sent(records()), (), (f"metadata.yaml is damaged, {LOOKED_INTO}",))


def cut_metadata_folder(folder: Path) -> Damaged:
    path = split(folder, "split-sqlite3-file")
    metadata = path / "metadata.yaml"
    metadata.write_bytes(metadata.read_bytes()[:300])
    return Damaged(path, sent(records()), (), (f"metadata.yaml is damaged, {LOOKED_INTO}",))


def missing_part_folder(folder: Path) -> Damaged:
    path = split(folder, "split-sqlite3")
    sorted(path.glob("*.db3"))[1].unlink()
    whole = sent(records())
    return Damaged(path, whole[: len(whole) // 2], (losses.MISSING_PART,))


def renamed_part_folder(folder: Path) -> Damaged:
    path = split(folder, "split-sqlite3")
    sorted(path.glob("*.db3"))[1].rename(path / "odd.db3")
    return Damaged(
        path, sent(records()), (), ("metadata.yaml does not name odd.db3, which was read instead",)
    )


def unreadable_part_folder(folder: Path) -> Damaged:
    path = split(folder, "split-mcap")
    sorted(path.glob("*.mcap"))[1].write_bytes(b"\x89MCAP0\r\n" + bytes(1000))
    whole = sent(records())
    return Damaged(path, whole[: len(whole) // 2], (losses.UNREADABLE_PART,))


def cut_compressed_mcap(folder: Path) -> Damaged:
    """What the cut file decompresses to is what zstd itself makes of it."""
    path = mcap(folder / "whole.mcap", "none")
    known, data = mcap_map(path), path.read_bytes()
    end = known.chunks[2][0]
    packed = zstd.compress(data[:end])
    (folder / "log.mcap.zstd").write_bytes(packed + zstd.compress(data[end:])[:12])
    return Damaged(folder / "log.mcap.zstd", known.outside(*range(2, len(known.chunks))), (losses.CUT,))


FOLDER_DAMAGES: tuple[Callable[[Path], Damaged], ...] = (
    no_metadata_folder,
    empty_metadata_folder,
    cut_metadata_folder,
    missing_part_folder,
    renamed_part_folder,
    unreadable_part_folder,
    cut_compressed_mcap,
)
