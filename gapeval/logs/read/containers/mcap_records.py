"""The records of MCAP that gapeval reads, from their bytes; nothing in them is believed unseen."""

import struct
from collections import Counter
from dataclasses import dataclass, field
from io import BytesIO
from typing import TypeVar

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from gapeval.logs.read.container import Raw
from gapeval.logs.read.containers.raw_file import CutError, RawFile, checksum

MAGIC = b"\x89MCAP0\r\n"
HEAD = 9  # opcode and length of a record
FOOTER = 20
TAIL = HEAD + FOOTER + len(MAGIC)
LAST_OPCODE = 0x7F  # from 0x80 on they are for private use
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
RECORD_AND_MESSAGE_HEAD = struct.Struct("<BQHIQQ")
RECORD_HEAD = struct.Struct("<BQ")
CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, uncompressed size, CRC, length of the compression's name
CHUNK_INDEX_HEAD = struct.Struct("<QQQQI")
MESSAGE_INDEX_HEAD = struct.Struct("<HI")
CODECS = ("", "lz4", "zstd")
LONGEST_CODEC = 16


Record = TypeVar("Record", Schema, Channel, Statistics)


class RecordError(Exception):
    """Bytes that are no such record."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """What a chunk says of itself.

    offset: of its record; data: of its compressed bytes; length: of these; stop: behind the record;
    start, end: bag times [ns]; size: uncompressed [bytes]; crc: 0 for none.
    """

    offset: int
    data: int
    length: int
    stop: int
    start: int
    end: int
    size: int
    crc: int
    compression: str


@dataclass(frozen=True, slots=True)
class Block:
    """A chunk, or a message that stands in no chunk.

    offset: of its record in the file; stop: behind it; start, end: bag times [ns]; topics: channels with
    messages in it, None where that is not known; count: messages in it, None likewise.
    """

    is_chunk: bool
    offset: int
    stop: int
    start: int
    end: int
    topics: frozenset[int] | None
    count: int | None = None


@dataclass(slots=True)
class Index:
    """What an MCAP file holds. counts: messages by channel; is_walked: whether its records alone say so."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    blocks: list[Block] = field(default_factory=list)
    notices: tuple[str, ...] = ()
    is_walked: bool = False


def record_at(file: RawFile, offset: int) -> tuple[int, int]:
    """Opcode and length of content of the record at an offset. Raises CutError where it is not all there."""
    opcode, length = RECORD_HEAD.unpack(file.read(offset, HEAD))
    if length > file.size - offset - HEAD:
        raise CutError(f"the record at byte {offset} is cut")
    return opcode, length


def chunk_at(file: RawFile, offset: int) -> Chunk:
    """The head of the chunk at an offset. Raises RecordError where there is none, CutError where it is cut.

    The lengths in it must agree with each other: that is what tells a chunk from other bytes.
    """
    head = file.upto(offset, HEAD + CHUNK_HEAD.size + LONGEST_CODEC + 8)
    if len(head) < HEAD + CHUNK_HEAD.size + 8:
        raise CutError(f"the chunk at byte {offset} is cut")
    opcode, record = RECORD_HEAD.unpack_from(head)
    start, end, size, crc, name = CHUNK_HEAD.unpack_from(head, HEAD)
    at = HEAD + CHUNK_HEAD.size
    if opcode != Opcode.CHUNK or name > LONGEST_CODEC or len(head) < at + name + 8:
        raise RecordError(f"no chunk at byte {offset}")
    codec = head[at : at + name].decode("ascii", "replace")
    length = int.from_bytes(head[at + name : at + name + 8], "little")
    data = offset + at + name + 8
    if record != data - offset - HEAD + length:
        raise RecordError(f"no chunk at byte {offset}")
    return Chunk(offset, data, length, data + length, start, end, size, crc, codec)


def message_index_at(file: RawFile, offset: int) -> tuple[int, list[tuple[int, int]]]:
    """Channel and (bag time, offset in the chunk) of each of its messages, in the order of the chunk.

    Raises RecordError or CutError.
    """
    opcode, length = record_at(file, offset)
    if opcode != Opcode.MESSAGE_INDEX or length < MESSAGE_INDEX_HEAD.size:
        raise RecordError(f"no message index at byte {offset}")
    content = file.read(offset + HEAD, length)
    channel, size = MESSAGE_INDEX_HEAD.unpack_from(content)
    if size % 16 or size > length - MESSAGE_INDEX_HEAD.size:
        raise RecordError(f"a message index of {size} bytes at byte {offset}")
    entries = content[MESSAGE_INDEX_HEAD.size : MESSAGE_INDEX_HEAD.size + size]
    return channel, sorted(struct.iter_unpack("<QQ", entries), key=lambda entry: entry[1])


def chunk_index(content: Raw) -> Block:
    """A chunk index of the summary. Raises RecordError."""
    try:
        start, end, offset, length, size = CHUNK_INDEX_HEAD.unpack_from(content)
        at = CHUNK_INDEX_HEAD.size
        if size % 10 or at + size + 8 > len(content):
            raise RecordError("a chunk index of odd length")
        indexes = sorted(struct.iter_unpack("<HQ", content[at : at + size]))
        behind = int.from_bytes(content[at + size : at + size + 8], "little")
    except struct.error as error:
        raise RecordError("a chunk index that is cut") from error
    channels = frozenset(channel for channel, _ in indexes)
    # Message indexes may be left out while chunk indexes are there: then any channel may be in the chunk.
    count = max(behind - len(indexes) * (HEAD + MESSAGE_INDEX_HEAD.size), 0) // 16 if indexes else None
    return Block(True, offset, offset + length, start, end, channels or None, count)


def data_checksum(file: RawFile) -> int:
    """CRC-32 of the data section: everything before its last record."""
    at = len(MAGIC)
    while True:
        try:
            opcode, length = record_at(file, at)
        except CutError:
            return 0
        if opcode == Opcode.DATA_END:
            break
        at += HEAD + length
    return checksum(file, 0, at)


def schema(content: Raw) -> Schema:
    return _read(Schema, content)


def channel(content: Raw) -> Channel:
    return _read(Channel, content)


def statistics(content: Raw) -> Statistics:
    return _read(Statistics, content)


def _read(kind: type[Record], content: Raw) -> Record:
    """By the library. Raises RecordError for whatever it raises."""
    try:
        record: Record = kind.read(ReadDataStream(BytesIO(content)))
    except Exception as error:
        raise RecordError(f"a {kind.__name__} that cannot be read") from error
    return record
