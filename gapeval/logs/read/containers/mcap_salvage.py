"""Where everything is in an MCAP file that does not say so: found by walking through its records.

A file that was never closed or is cut, or whose summary is missing or wrong. Behind bytes that are no record,
the walk goes on at the next ones that are.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from mcap.opcode import Opcode

from gapeval.logs.read.container import Loss, Raw
from gapeval.logs.read.containers import mcap_records
from gapeval.logs.read.containers.blocks import LAST_TIME
from gapeval.logs.read.containers.losses import CUT, UNREADABLE_RECORDS, Losses, LostError
from gapeval.logs.read.containers.mcap_chunk import chunk_content, records
from gapeval.logs.read.containers.mcap_records import (
    FOOTER,
    HEAD,
    LAST_OPCODE,
    MAGIC,
    MESSAGE_HEAD,
    Block,
    Chunk,
    Index,
    RecordError,
    chunk_at,
    data_checksum,
    message_index_at,
    record_at,
)
from gapeval.logs.read.containers.raw_file import PIECE, CutError, RawFile

# What may be a chunk, or a message outside of one; each is then looked at.
_CHUNK = re.compile(rb"\x06.{6}\x00\x00.{28}(?:\x00{4}|\x03\x00\x00\x00lz4|\x04\x00\x00\x00zstd)", re.DOTALL)
_MESSAGE = re.compile(rb"\x05.{4}\x00{4}.{2}", re.DOTALL)
_OVERLAP = 64
_DAY = 86_400_000_000_000  # ns
_UNTOLD = "the checksum (CRC) of its data is wrong"


@dataclass(slots=True)
class _Walk:
    file: RawFile
    losses: Losses
    index: Index
    first: int | None = None  # bag times seen [ns]
    last: int | None = None
    lost: tuple[int, int] | None = None  # bytes behind which no message has been seen yet
    closed: bool = False  # whether it has a footer
    cut: bool = False
    unchecked: bool = False  # whether any data has no checksum but that of the whole
    checksum: int = 0


def walked(file: RawFile, losses: Losses) -> Index:
    """The index of a file by its records alone."""
    walk = _Walk(file, losses, Index(is_walked=True))
    at = len(MAGIC)
    while at < file.size:
        at = _step(walk, at)
    _tell_gap(walk, None)
    if not (walk.closed or walk.cut):
        losses.add(Loss(file.path.name, CUT, None, None, walk.last, None))
    if walk.checksum and walk.unchecked and walk.checksum != data_checksum(file):
        walk.index.notices += (_UNTOLD,)
    return walk.index


def _step(walk: _Walk, at: int) -> int:
    """Takes in what stands at a byte. Returns where to go on."""
    file = walk.file
    if file.upto(at, len(MAGIC)) == MAGIC:
        return at + len(MAGIC)
    try:
        opcode, length = record_at(file, at)
        stop = at + HEAD + length
        if opcode == Opcode.CHUNK:
            return _take_chunk(walk, chunk_at(file, at))
        if opcode == 0 or (not _is_record(file, stop) and _next(walk, at + 1) < stop):
            raise RecordError
        _take(walk, opcode, at, stop)
    except (RecordError, CutError):
        found = _next(walk, at + 1)
        if found < file.size:
            _add_gap(walk, at, found)
        else:
            _take_cut(walk, at)
        return found
    return stop


def _is_record(file: RawFile, at: int) -> bool:
    """Whether a record may begin here, or nothing is left."""
    if at >= file.size or file.upto(at, len(MAGIC)) == MAGIC:
        return True
    try:
        opcode, _ = record_at(file, at)
    except CutError:
        return False
    return 0 < opcode <= Opcode.DATA_END or opcode > LAST_OPCODE


def _take(walk: _Walk, opcode: int, at: int, stop: int) -> None:
    """Takes in a record that is no chunk. Raises RecordError."""
    file, start = walk.file, at + HEAD
    if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
        _note(walk.index, opcode, file.read(start, stop - start))
    elif opcode == Opcode.MESSAGE:
        if stop - start < MESSAGE_HEAD.size:
            raise RecordError("a message that is too short")
        channel, _, time, _ = MESSAGE_HEAD.unpack(file.read(start, MESSAGE_HEAD.size))
        walk.unchecked = True
        walk.index.counts[channel] += 1
        _add(walk, Block(False, at, stop, time, time, frozenset({channel}), 1))
    elif opcode == Opcode.DATA_END and stop - start >= 4:
        walk.checksum = int.from_bytes(file.read(start, 4), "little")
    elif opcode == Opcode.FOOTER:
        if stop - start != FOOTER:
            raise RecordError("a footer of odd length")
        walk.closed = True


def _take_chunk(walk: _Walk, chunk: Chunk) -> int:
    """Takes in a chunk that is all there, by its message indexes if these say all. Returns where to go on."""
    file, index = walk.file, walk.index
    if chunk.stop > file.size:
        raise CutError
    walk.unchecked |= not chunk.crc
    stop, indexes = _message_indexes(file, chunk)
    counts = Counter({channel: len(times) for channel, times in indexes.items()})
    times = [time for found in indexes.values() for time in found]
    # What the indexes leave open, or have otherwise than the chunk itself, the messages say.
    if (
        not times
        or not set(counts) <= set(index.channels)
        or (min(times), max(times)) != (chunk.start, chunk.end)
    ):
        try:
            counts, times = _take_content(index, chunk_content(file, chunk))
        except LostError as error:
            size, span = chunk.stop - chunk.offset, (chunk.start, chunk.end)
            walk.losses.add(Loss(file.path.name, error.reason, size, len(times) or None, *span))
            _tell_gap(walk, chunk.start)
            return stop
    index.counts.update(counts)
    if times:
        _add(walk, _block(chunk.offset, chunk.stop, counts, times))
    return stop


def _block(offset: int, stop: int, counts: Counter[int], times: list[int]) -> Block:
    return Block(True, offset, stop, min(times), max(times), frozenset(counts), len(times))


def _message_indexes(file: RawFile, chunk: Chunk) -> tuple[int, dict[int, list[int]]]:
    """Where the message indexes behind a chunk end, and bag times by channel, if all are right."""
    at, found = chunk.stop, {}
    try:
        while at < file.size and file.upto(at, 1) == bytes([Opcode.MESSAGE_INDEX]):
            _, length = record_at(file, at)
            channel, entries = message_index_at(file, at)
            if any(offset >= chunk.size for _, offset in entries) or channel in found:
                return chunk.stop, {}
            found[channel] = [time for time, _ in entries]
            at += HEAD + length
    except (RecordError, CutError):
        return chunk.stop, {}
    # The last one of a cut file may have others missing behind it.
    return (at, found) if at < file.size else (at, {})


def _take_content(index: Index, content: Raw) -> tuple[Counter[int], list[int]]:
    """Takes in what a chunk describes. Returns its messages by channel, and their bag times."""
    seen: Counter[int] = Counter()
    times = []
    for opcode, start, stop in records(content):
        if opcode == Opcode.MESSAGE and stop - start >= MESSAGE_HEAD.size:
            channel, _, time, _ = MESSAGE_HEAD.unpack_from(content, start)
            seen[channel] += 1
            times.append(time)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            try:
                _note(index, opcode, content[start:stop])
            except RecordError:
                # Its messages are told when they turn out to be of no topic.
                continue
    return seen, times


def _take_cut(walk: _Walk, at: int) -> None:
    """Takes in the whole messages of a chunk in which the file ends, and says that it does."""
    file = walk.file
    size = file.size - at
    try:
        chunk = chunk_at(file, at)
        if not chunk.compression:
            content = file.upto(chunk.data, chunk.length)
            seen, times = _take_content(walk.index, content)
            if seen:
                walk.index.counts.update(seen)
                _add(walk, _block(at, file.size, seen, times))
            size = sum(stop - start for opcode, start, stop in records(content) if opcode == -1)
    except (RecordError, CutError):
        pass
    _tell_gap(walk, None)
    walk.cut = True
    walk.losses.add(Loss(file.path.name, CUT, size, None, walk.last, None))


def _note(index: Index, opcode: int, content: Raw) -> None:
    """Keeps a schema or channel; the first of a number wins, since a later one should say the same."""
    if opcode == Opcode.SCHEMA:
        schema = mcap_records.schema(content)
        index.schemas.setdefault(schema.id, schema)
    else:
        channel = mcap_records.channel(content)
        index.channels.setdefault(channel.id, channel)


def _add(walk: _Walk, block: Block) -> None:
    if block.end > LAST_TIME:
        raise RecordError("a bag time that no log has")
    walk.index.blocks.append(block)
    _tell_gap(walk, block.start)
    walk.first = block.start if walk.first is None else min(walk.first, block.start)
    walk.last = block.end if walk.last is None else max(walk.last, block.end)


def _add_gap(walk: _Walk, start: int, stop: int) -> None:
    if walk.lost is not None and walk.lost[1] == start:
        start = walk.lost[0]
    else:
        _tell_gap(walk, None)
    walk.lost = (start, stop)


def _tell_gap(walk: _Walk, until: int | None) -> None:
    """Says what was lost before this bag time."""
    if walk.lost is not None:
        start, stop = walk.lost
        name = walk.file.path.name
        walk.losses.add(Loss(name, UNREADABLE_RECORDS, stop - start, None, walk.last, until))
        walk.lost = None


def _next(walk: _Walk, at: int) -> int:
    """The next byte where a chunk begins, or, in a file without chunks, a message; else the file's size."""
    file = walk.file
    has_chunks = any(block.is_chunk for block in walk.index.blocks[:1])
    while at < file.size:
        piece = file.upto(at, PIECE + _OVERLAP)
        chunks = (at + place for place in _places(_CHUNK, piece) if _is_chunk(file, at + place))
        found = next(chunks, file.size)
        if not has_chunks:
            messages = (at + place for place in _places(_MESSAGE, piece) if _is_message(walk, at + place))
            found = min(found, next(messages, file.size))
        if found < file.size:
            return found
        at += PIECE
    return file.size


def _places(pattern: re.Pattern[bytes], piece: bytes) -> Iterator[int]:
    """Where a pattern begins, also inside of what matched before."""
    position = 0
    while match := pattern.search(piece, position):
        yield match.start()
        position = match.start() + 1


def _is_chunk(file: RawFile, at: int) -> bool:
    try:
        chunk = chunk_at(file, at)
    except (RecordError, CutError):
        return False
    return chunk.stop <= file.size and _is_record(file, chunk.stop)


def _is_message(walk: _Walk, at: int) -> bool:
    """Whether here is a message of a channel that is known, at a time that fits, and more behind it."""
    file = walk.file
    try:
        opcode, length = record_at(file, at)
        if opcode != Opcode.MESSAGE or length < MESSAGE_HEAD.size or not _is_record(file, at + HEAD + length):
            return False
        channel, _, time, _ = MESSAGE_HEAD.unpack(file.read(at + HEAD, MESSAGE_HEAD.size))
    except CutError:
        return False
    first, last = walk.first or time, walk.last or time
    return channel in walk.index.channels and first - _DAY <= time <= last + _DAY
