"""Where everything is in an MCAP file: from its summary, or by walking through its records."""

import os
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Message, Schema
from mcap.stream_reader import CRCValidationError, breakup_chunk
from mcap.summary import Summary

MAGIC = b"\x89MCAP0\r\n"
HEAD = 9  # opcode and length of a record
TAIL = HEAD + 20 + len(MAGIC)  # footer and closing magic


@dataclass(frozen=True, slots=True)
class Block:
    """A chunk, or a message that stands in no chunk.

    offset: of its record in the file; start, end: bag times [ns]; channels: those with messages in it, None
    where that is not known.
    """

    opcode: int
    offset: int
    start: int
    end: int
    channels: frozenset[int] | None

    @property
    def is_chunk(self) -> bool:
        return self.opcode == Opcode.CHUNK


@dataclass(slots=True)
class Index:
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    blocks: list[Block] = field(default_factory=list)
    notices: tuple[str, ...] = ()


def read_index(stream: BinaryIO) -> Index:
    """The index of a file. Raises whatever the mcap library raises, or ValueError, for a damaged one."""
    size = stream.seek(0, os.SEEK_END)
    _check_end(stream, size)
    if not _summary_is_intact(stream, size):
        index = _walked(stream)
        index.notices = ("the summary is damaged (CRC), so the file was read from end to end",)
        return index
    stream.seek(0)
    summary = SeekingReader(stream).get_summary()
    return _summarised(summary) if summary is not None and _is_complete(summary) else _walked(stream)


def is_indexed(stream: BinaryIO) -> bool:
    """Whether the summary alone says where everything is."""
    size = stream.seek(0, os.SEEK_END)
    _check_end(stream, size)
    if not _summary_is_intact(stream, size):
        return False
    stream.seek(0)
    summary = SeekingReader(stream).get_summary()
    return summary is not None and _is_complete(summary)


def record_content(stream: BinaryIO, offset: int) -> tuple[int, bytes]:
    """Opcode and content of the record at a byte. Raises EOFError where it is cut, before any allocation."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(offset)
    head = stream.read(HEAD)
    length = int.from_bytes(head[1:], "little")
    if len(head) < HEAD or length > size - offset - HEAD:
        raise EOFError(f"the record at byte {offset} is cut")
    return head[0], stream.read(length)


def _check_end(stream: BinaryIO, size: int) -> None:
    stream.seek(max(size - len(MAGIC), 0))
    if size < TAIL or stream.read() != MAGIC:
        raise EOFError("it was never closed, or is cut")


def _summary_is_intact(stream: BinaryIO, size: int) -> bool:
    """Whether the summary's CRC is right, or there is none."""
    opcode, content = record_content(stream, size - TAIL)
    if opcode != Opcode.FOOTER:
        raise ValueError("no footer at its end")
    start = int.from_bytes(content[:8], "little")
    expected = int.from_bytes(content[16:20], "little")
    if start == 0 or expected == 0:
        return True
    if start > size - TAIL:
        return False
    stream.seek(start)
    # From the start of the summary up to the CRC itself, which is the footer's last field.
    return zlib.crc32(stream.read(size - len(MAGIC) - 4 - start)) == expected


def _is_complete(summary: Summary) -> bool:
    """Whether the summary says all that reading needs; every part of it may be missing."""
    statistics = summary.statistics
    if statistics is None or statistics.chunk_count != len(summary.chunk_indexes):
        return False
    if statistics.message_count and not summary.chunk_indexes:
        return False
    named = set(statistics.channel_message_counts)
    for index in summary.chunk_indexes:
        named |= set(index.message_index_offsets)
    return (
        all(
            number in summary.channels and (summary.channels[number].schema_id or 0) in {0, *summary.schemas}
            for number in named
        )
        and sum(statistics.channel_message_counts.values()) == statistics.message_count
    )


def _summarised(summary: Summary) -> Index:
    assert summary.statistics is not None
    return Index(
        schemas=dict(summary.schemas),
        channels=dict(summary.channels),
        counts=Counter(summary.statistics.channel_message_counts),
        blocks=[_chunk_block(index) for index in summary.chunk_indexes],
    )


def _chunk_block(index: ChunkIndex) -> Block:
    # Message indexes may be left out while chunk indexes are there: then any channel may be in the chunk.
    channels = frozenset(index.message_index_offsets) or None
    offset, start, end = index.chunk_start_offset, index.message_start_time, index.message_end_time
    return Block(Opcode.CHUNK, offset, start, end, channels)


def _walked(stream: BinaryIO) -> Index:
    """The index by reading the whole file, with its CRCs checked."""
    index = Index()
    for opcode, offset, content in _data_records(stream):
        data = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            _note(index, Schema.read(data))
        elif opcode == Opcode.CHANNEL:
            _note(index, Channel.read(data))
        elif opcode == Opcode.MESSAGE:
            message = Message.read(data, len(content))
            _note(index, message)
            channels = frozenset({message.channel_id})
            index.blocks.append(Block(opcode, offset, message.log_time, message.log_time, channels))
        elif opcode == Opcode.CHUNK:
            records = breakup_chunk(Chunk.read(data), validate_crc=True)
            messages = [record for record in records if isinstance(record, Message)]
            for record in records:
                _note(index, record)
            # The chunk's header may lie about its times; its messages do not.
            times = [message.log_time for message in messages] or [0]
            channels = frozenset(message.channel_id for message in messages)
            index.blocks.append(Block(opcode, offset, min(times), max(times), channels))
    unknown = set(index.counts) - set(index.channels)
    if unknown:
        raise ValueError(f"messages of channel {min(unknown)}, which is not described")
    return index


def _note(index: Index, record: object) -> None:
    if isinstance(record, Schema):
        index.schemas[record.id] = record
    elif isinstance(record, Channel):
        index.channels[record.id] = record
    elif isinstance(record, Message):
        index.counts[record.channel_id] += 1


def _data_records(stream: BinaryIO) -> Iterator[tuple[int, int, bytes]]:
    """(opcode, offset, content) of every record up to the end of the data section, whose CRC is checked."""
    offset, crc = len(MAGIC), zlib.crc32(MAGIC)
    while True:
        opcode, content = record_content(stream, offset)
        if opcode == Opcode.DATA_END:
            end = DataEnd.read(ReadDataStream(BytesIO(content)))
            if end.data_section_crc not in (0, crc):
                raise CRCValidationError(end.data_section_crc, crc, end)
            return
        if opcode == Opcode.FOOTER:
            return
        yield opcode, offset, content
        crc = zlib.crc32(content, zlib.crc32(bytes([opcode]) + len(content).to_bytes(8, "little"), crc))
        offset += HEAD + len(content)
