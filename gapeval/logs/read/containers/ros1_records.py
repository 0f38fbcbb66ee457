"""The records of ROS 1 bags, from their bytes; nothing in them is believed unseen."""

import struct
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from enum import IntEnum

from gapeval.logs.read.container import Raw
from gapeval.logs.read.containers.raw_file import CutError, RawFile

MAGIC = b"#ROSBAG V"
FIRST = b"#ROSBAG V2.0\n"
LONGEST_HEADER = 1 << 16  # bytes of a record's own fields; those of a connection are in its data
INDEX_ENTRY = struct.Struct("<III")  # seconds, nanoseconds, offset in the chunk
COUNT_ENTRY = struct.Struct("<II")  # connection, messages


class Op(IntEnum):
    MESSAGE = 2
    BAG = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7


class RecordError(Exception):
    """Bytes that are no such record."""


@dataclass(frozen=True, slots=True)
class Record:
    """fields: of its header; offset: of the record; data, stop: where its data begins and ends."""

    fields: dict[bytes, bytes]
    offset: int
    data: int
    stop: int

    @property
    def op(self) -> int:
        return number(self.fields, b"op", 1)


@dataclass(frozen=True, slots=True)
class Connection:
    """A topic of one publisher. topic, type, definition: as they stand there."""

    topic: str
    type: str
    definition: str


@dataclass(frozen=True, slots=True)
class Chunk:
    """What is known of a chunk without reading it.

    offset: of its record; start, end: bag times [ns]; counts: messages by connection, None where that is not
    known. is_indexed: whether the index of the bag says so.
    """

    offset: int
    start: int
    end: int
    counts: dict[int, int] | None
    is_indexed: bool = False

    @property
    def topics(self) -> Collection[int] | None:
        return self.counts


@dataclass(slots=True)
class Index:
    """What a bag holds."""

    connections: dict[int, Connection] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    notices: tuple[str, ...] = ()

    @property
    def counts(self) -> Counter[int]:
        found: Counter[int] = Counter()
        for chunk in self.chunks:
            found.update(chunk.counts or {})
        return found


def header_fields(data: Raw) -> dict[bytes, bytes]:
    """The fields of a header. Raises RecordError."""
    content, at, fields = bytes(data), 0, {}
    while at < len(content):
        size = int.from_bytes(content[at : at + 4], "little")
        name, equals, value = content[at + 4 : at + 4 + size].partition(b"=")
        if not equals or at + 4 + size > len(content):
            raise RecordError("a header that cannot be read")
        fields[name] = value
        at += 4 + size
    return fields


def number(fields: dict[bytes, bytes], name: bytes, size: int) -> int:
    """An unsigned integer of so many bytes. Raises RecordError."""
    value = fields.get(name, b"")
    if len(value) != size:
        raise RecordError(f"no {name.decode()} in a header")
    return int.from_bytes(value, "little")


def time(fields: dict[bytes, bytes], name: bytes) -> int:
    """A bag time [ns]. Raises RecordError."""
    value = number(fields, name, 8)
    return (value & 0xFFFFFFFF) * 1_000_000_000 + (value >> 32)


def record_at(file: RawFile, offset: int) -> Record:
    """The record at an offset. Raises RecordError for what is none, CutError where its data is cut."""
    head = file.upto(offset, 512)
    if len(head) < 8:
        raise CutError(f"the record at byte {offset} is cut")
    size = int.from_bytes(head[:4], "little")
    if not 0 < size <= LONGEST_HEADER:
        raise RecordError(f"no record at byte {offset}")
    if size + 8 > len(head):
        head = file.read(offset, size + 8)
    fields = header_fields(head[4 : 4 + size])
    data = offset + size + 8
    stop = data + int.from_bytes(head[4 + size : 8 + size], "little")
    record = Record(fields, offset, data, stop)
    if not Op.MESSAGE <= record.op <= Op.CONNECTION:
        raise RecordError(f"a record of kind {record.op} at byte {offset}")
    if stop > file.size:
        raise CutError(f"the record at byte {offset} is cut")
    return record


def connection(fields: dict[bytes, bytes], data: Raw) -> tuple[int, Connection]:
    """A connection by its number. Raises RecordError."""
    number_, details = number(fields, b"conn", 4), header_fields(data)
    topic = fields.get(b"topic") or details.get(b"topic")
    if not topic or b"type" not in details:
        raise RecordError("a connection without topic or type")
    name, kind, definition = (
        value.decode("utf-8", "replace")
        for value in (topic, details[b"type"], details.get(b"message_definition", b""))
    )
    return number_, Connection(name, kind, definition)


def chunk_info(file: RawFile, record: Record) -> Chunk:
    """What the index says of a chunk. Raises RecordError."""
    fields, count = record.fields, number(record.fields, b"count", 4)
    if number(fields, b"ver", 4) != 1 or record.stop - record.data < count * COUNT_ENTRY.size:
        raise RecordError("a chunk's entry in the index that cannot be read")
    counts = dict(COUNT_ENTRY.iter_unpack(file.read(record.data, count * COUNT_ENTRY.size)))
    offset = number(fields, b"chunk_pos", 8)
    return Chunk(offset, time(fields, b"start_time"), time(fields, b"end_time"), counts, is_indexed=True)


def index_entries(file: RawFile, record: Record) -> tuple[int, list[tuple[int, int]]]:
    """Connection and (bag time, offset in the chunk) of each message of an index. Raises RecordError."""
    count = number(record.fields, b"count", 4)
    if number(record.fields, b"ver", 4) != 1 or record.stop - record.data != count * INDEX_ENTRY.size:
        raise RecordError("an index of odd length")
    entries = INDEX_ENTRY.iter_unpack(file.read(record.data, count * INDEX_ENTRY.size))
    found = [(seconds * 1_000_000_000 + nanoseconds, at) for seconds, nanoseconds, at in entries]
    return number(record.fields, b"conn", 4), found
