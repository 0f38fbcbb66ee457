"""Where everything is in a ROS 1 bag that does not say so: found by walking through its records.

A bag that was never closed or is cut, or whose index is damaged. Behind bytes that are no record, the walk
goes on at the next chunk.
"""

from dataclasses import dataclass

from gapeval.logs.read.container import Loss, Raw
from gapeval.logs.read.containers.blocks import LAST_TIME
from gapeval.logs.read.containers.losses import CUT, UNREADABLE_RECORDS, Losses, LostError
from gapeval.logs.read.containers.raw_file import PIECE, CutError, RawFile
from gapeval.logs.read.containers.ros1_chunk import (
    chunk_at,
    chunk_content,
    cut_content,
    indexes_behind,
    records,
)
from gapeval.logs.read.containers.ros1_message import message_head_of
from gapeval.logs.read.containers.ros1_records import (
    FIRST,
    Chunk,
    Index,
    Op,
    Record,
    RecordError,
    connection,
    number,
    record_at,
)

_CHUNK = b"\x04\x00\x00\x00op=\x05"
_FARTHEST = 64  # bytes from the start of a chunk's header to the field that tells it is one


@dataclass(slots=True)
class _Walk:
    file: RawFile
    losses: Losses
    index: Index
    last: int | None = None  # bag time seen [ns]
    lost: tuple[int, int] | None = None  # bytes behind which no message has been seen yet
    closed: bool = False  # whether there is an index, right or wrong
    cut: bool = False


def walked(file: RawFile, losses: Losses) -> Index:
    """The index of a bag by its records alone."""
    walk, at = _Walk(file, losses, Index()), len(FIRST)
    while at < file.size:
        at = _step(walk, at)
    _tell_gap(walk, None)
    if not (walk.closed or walk.cut):
        losses.add(Loss(file.path.name, CUT, _missing(file) or None, None, walk.last, None))
    return walk.index


def _missing(file: RawFile) -> int:
    """Bytes that the header of a bag says were there before its index, and that are not."""
    try:
        head = record_at(file, len(FIRST))
        return max(number(head.fields, b"index_pos", 8) - file.size, 0) if head.op == Op.BAG else 0
    except (RecordError, CutError):
        return 0


def _step(walk: _Walk, at: int) -> int:
    """Takes in what stands at a byte. Returns where to go on."""
    file = walk.file
    try:
        record = record_at(file, at)
        if record.op == Op.CHUNK:
            return _take_chunk(walk, record)
        if not _is_record(file, record.stop) and _next(file, at + 1) < record.stop:
            raise RecordError
        if record.op == Op.CONNECTION:
            _describe(walk.index, record.fields, file.read(record.data, record.stop - record.data))
        walk.closed |= record.op == Op.CHUNK_INFO
    except (RecordError, CutError):
        found = _next(file, at + 1)
        if found == file.size:
            _take_cut(walk, at)
        else:
            _add_gap(walk, at, found)
        return found
    return record.stop


def _is_record(file: RawFile, at: int) -> bool:
    """Whether a record begins here, or nothing is left."""
    if at == file.size:
        return True
    try:
        record_at(file, at)
    except (RecordError, CutError):
        return False
    return True


def _describe(index: Index, fields: dict[bytes, bytes], data: Raw) -> None:
    """Keeps a connection; the first of a number wins, since a later one should say the same."""
    try:
        owner, described = connection(fields, data)
    except RecordError:
        # Its messages are told when they turn out to be of no topic.
        return
    index.connections.setdefault(owner, described)


def _take_chunk(walk: _Walk, record: Record) -> int:
    """Takes in a chunk that is all there, by its index if that says all. Returns where to go on."""
    file = walk.file
    try:
        stop, indexes = indexes_behind(file, record.stop)
    except (RecordError, CutError):
        stop, indexes = record.stop, {}
    counts = {owner: len(entries) for owner, entries in indexes.items()}
    times = [when for entries in indexes.values() for when, _ in entries]
    if not times or not set(counts) <= set(walk.index.connections) or max(times) > LAST_TIME:
        try:
            content = chunk_content(file, *chunk_at(file, record.offset))
        except LostError as error:
            span = (min(times), max(times)) if times else (walk.last, None)
            size, count = record.stop - record.offset, len(times) or None
            walk.losses.add(Loss(file.path.name, error.reason, size, count, *span))
            return stop
        counts, times = _take_content(walk.index, content)
    _add(walk, record.offset, counts, times)
    return stop


def _take_content(index: Index, content: Raw) -> tuple[dict[int, int], list[int]]:
    """Takes in what a chunk describes. Returns its messages by connection, and their bag times."""
    counts: dict[int, int] = {}
    times = []
    for fields, start, stop in records(content):
        try:
            head = message_head_of(fields)
        except RecordError:
            break
        if head is None:
            _describe(index, fields, content[start:stop])
        else:
            counts[head[0]] = counts.get(head[0], 0) + 1
            times.append(head[1])
    return counts, times


def _take_cut(walk: _Walk, at: int) -> None:
    """Takes in the whole messages of a chunk in which the file ends, and says that it does."""
    file = walk.file
    size = file.size - at
    content = cut_content(file, at)
    if content:
        counts, times = _take_content(walk.index, content)
        size = len(content) - max((stop for _, _, stop in records(content)), default=0)
        _add(walk, at, counts, times)
    _tell_gap(walk, None)
    walk.cut = True
    walk.losses.add(Loss(file.path.name, CUT, size + _missing(file), None, walk.last, None))


def _add(walk: _Walk, offset: int, counts: dict[int, int], times: list[int]) -> None:
    times = [when for when in times if when <= LAST_TIME]
    if not times:
        return
    walk.index.chunks.append(Chunk(offset, min(times), max(times), counts))
    _tell_gap(walk, min(times))
    walk.last = max(times) if walk.last is None else max(walk.last, *times)


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
        walk.losses.add(Loss(walk.file.path.name, UNREADABLE_RECORDS, stop - start, None, walk.last, until))
        walk.lost = None


def _next(file: RawFile, at: int) -> int:
    """The next byte where a chunk begins that is all there, else the file's size."""
    while at < file.size:
        piece = file.upto(at, PIECE + 2 * _FARTHEST)
        place = piece.find(_CHUNK)
        while place >= 0:
            for start in range(max(place - _FARTHEST, 0), place - 3):
                if piece[start + 2 : start + 4] == b"\0\0" and _is_chunk(file, at + start):
                    return at + start
            place = piece.find(_CHUNK, place + 1)
        at += PIECE
    return file.size


def _is_chunk(file: RawFile, at: int) -> bool:
    try:
        record, codec, _ = chunk_at(file, at)
    except (RecordError, CutError):
        return False
    return bool(codec) and _is_record(file, record.stop)
