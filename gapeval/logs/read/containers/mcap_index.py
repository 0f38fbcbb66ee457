"""Where everything is in an MCAP file: from its summary where that says all, else by a walk through it."""

from collections.abc import Iterator

from mcap.opcode import Opcode
from mcap.records import Statistics

from gapeval.logs.read.containers import mcap_records
from gapeval.logs.read.containers.blocks import LAST_TIME
from gapeval.logs.read.containers.losses import Losses
from gapeval.logs.read.containers.mcap_records import (
    FOOTER,
    HEAD,
    MAGIC,
    TAIL,
    Index,
    RecordError,
    chunk_at,
    record_at,
)
from gapeval.logs.read.containers.mcap_salvage import walked
from gapeval.logs.read.containers.raw_file import CutError, RawFile, checksum

DAMAGED_SUMMARY = "the summary is damaged (CRC), so the file was read from end to end"
CONTRADICTED = "the index is not of this file, so it was read from end to end"


def read_index(file: RawFile, losses: Losses) -> Index:
    """The index of a file, whatever state that is in; what is missing of the file is among the losses."""
    notice = ""
    try:
        summary = _summary(file)
        if summary is not None:
            return summary
    except _DamagedSummaryError as error:
        notice = str(error)
    except (RecordError, CutError):
        # The walk says what is wrong with the file.
        pass
    index = walked(file, losses)
    if notice:
        index.notices = (notice, *index.notices)
    return index


def is_indexed(file: RawFile) -> bool:
    """Whether the summary alone says where everything is."""
    try:
        return _summary(file) is not None
    except (_DamagedSummaryError, RecordError, CutError):
        return False


class _DamagedSummaryError(Exception):
    """A summary that is there and must not be used; the text says why."""


def _summary(file: RawFile) -> Index | None:
    """The index by the summary; None where it does not say all.

    Raises _DamagedSummaryError, or RecordError or CutError where the file does not end as one should.
    """
    if file.size < TAIL + len(MAGIC) or file.read(file.size - len(MAGIC), len(MAGIC)) != MAGIC:
        raise CutError("it was never closed, or is cut")
    footer = file.size - TAIL
    opcode, length = record_at(file, footer)
    if opcode != Opcode.FOOTER or length != FOOTER:
        raise RecordError("no footer at its end")
    content = file.read(footer + HEAD, FOOTER)
    start, expected = int.from_bytes(content[:8], "little"), int.from_bytes(content[16:], "little")
    if start == 0:
        return None
    # From the start of the summary up to the CRC itself, which is the footer's last field.
    if start > footer or (expected and checksum(file, start, file.size - len(MAGIC) - 4) != expected):
        raise _DamagedSummaryError(DAMAGED_SUMMARY)
    index, statistics = Index(), None
    for opcode, content in _records(file, start, footer):
        if opcode == Opcode.SCHEMA:
            schema = mcap_records.schema(content)
            index.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = mcap_records.channel(content)
            index.channels[channel.id] = channel
        elif opcode == Opcode.CHUNK_INDEX:
            index.blocks.append(mcap_records.chunk_index(content))
        elif opcode == Opcode.STATISTICS:
            statistics = mcap_records.statistics(content)
            index.counts.update(statistics.channel_message_counts)
    if statistics is None or not _is_complete(index, statistics):
        return None
    if not _agrees(file, index):
        raise _DamagedSummaryError(CONTRADICTED)
    return index


def _records(file: RawFile, at: int, stop: int) -> Iterator[tuple[int, bytes]]:
    while at < stop:
        opcode, length = record_at(file, at)
        if length > stop - at - HEAD:
            raise RecordError(f"the record at byte {at} reaches into the footer")
        yield opcode, file.read(at + HEAD, length)
        at += HEAD + length


def _is_complete(index: Index, statistics: Statistics) -> bool:
    """Whether the summary says all that reading needs; every part of it may be missing."""
    if statistics.chunk_count != len(index.blocks) or (statistics.message_count and not index.blocks):
        return False
    named = set(index.counts)
    for block in index.blocks:
        named |= block.topics or set()
    known = {0, *index.schemas}
    return (
        all(number in index.channels and index.channels[number].schema_id in known for number in named)
        and sum(index.counts.values()) == statistics.message_count
        and all(block.end <= LAST_TIME for block in index.blocks)
    )


def _agrees(file: RawFile, index: Index) -> bool:
    """Whether chunks are where the index has them; of many, three are looked at."""
    blocks = index.blocks
    for block in [blocks[i] for i in sorted({0, len(blocks) // 2, len(blocks) - 1})] if blocks else []:
        try:
            chunk = chunk_at(file, block.offset)
        except (RecordError, CutError):
            return False
        if (chunk.stop, chunk.start, chunk.end) != (block.stop, block.start, block.end):
            return False
    return True
