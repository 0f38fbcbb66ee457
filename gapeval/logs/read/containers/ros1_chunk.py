"""What is in a chunk of a ROS 1 bag."""

from collections.abc import Collection, Iterator

from gapeval.logs.read.container import HEAD, Loss, Raw
from gapeval.logs.read.containers.blocks import Found, MisplacedError, Read
from gapeval.logs.read.containers.compression import BombError, DamagedError, decompressed_chunk
from gapeval.logs.read.containers.losses import (
    BAD_CHUNK,
    BAD_CHUNK_RECORDS,
    BOMB,
    UNKNOWN_COMPRESSION,
    LostError,
)
from gapeval.logs.read.containers.raw_file import CutError, RawFile, Window
from gapeval.logs.read.containers.ros1_records import (
    LONGEST_HEADER,
    Chunk,
    Op,
    Record,
    RecordError,
    header_fields,
    index_entries,
    number,
    record_at,
    time,
)

CODECS = ("none", "lz4", "bz2")
# A message's header as roscpp and rosbag write it, and as rosbags does; then its fields are at these places.
_FIELDS = {
    (b"\x09\x00\x00\x00conn=", b"\x04\x00\x00\x00op=\x02\x0d\x00\x00\x00time="): (9, 13, 30),
    (b"\x04\x00\x00\x00op=\x02\x09\x00\x00\x00conn=", b"\x0d\x00\x00\x00time="): (17, 21, 30),
}
_USUAL = 38  # bytes of such a header


def chunk_at(file: RawFile, offset: int) -> tuple[Record, str, int]:
    """The record of a chunk, its compression and its size without. Raises RecordError or CutError."""
    record = record_at(file, offset)
    if record.op != Op.CHUNK:
        raise RecordError(f"no chunk at byte {offset}")
    codec = record.fields.get(b"compression", b"").decode("ascii", "replace")
    return record, codec, number(record.fields, b"size", 4)


def chunk_content(file: RawFile, record: Record, codec: str, size: int) -> Raw:
    """The bytes of a chunk. Raises LostError."""
    if codec not in CODECS:
        raise LostError(UNKNOWN_COMPRESSION)
    data = file.read(record.data, record.stop - record.data)
    try:
        return data if codec == "none" else decompressed_chunk(data, codec, size)
    except BombError as error:
        raise LostError(BOMB) from error
    except DamagedError as error:
        raise LostError(BAD_CHUNK) from error


def records(content: Raw) -> Iterator[tuple[dict[bytes, bytes], int, int]]:
    """(fields, start, stop) of every record in a chunk, up to the first that is none."""
    at, end = 0, len(content)
    while at < end:
        size = int.from_bytes(content[at : at + 4], "little")
        start = at + size + 8
        stop = start + int.from_bytes(content[start - 4 : start], "little")
        if stop > end or start > end:
            return
        try:
            fields = header_fields(content[at + 4 : start - 4])
        except RecordError:
            return
        yield fields, start, stop
        at = stop


def message_head(head: Raw) -> tuple[int, int] | None:
    """Connection and bag time by the header of a record in a chunk; None where it is not a message's.

    Raises RecordError.
    """
    if len(head) == _USUAL:
        content = bytes(head)
        for (first, second), (conn, middle, when) in _FIELDS.items():
            if content.startswith(first) and content[middle:when] == second:
                seconds = int.from_bytes(content[when : when + 4], "little")
                nanoseconds = int.from_bytes(content[when + 4 :], "little")
                owner = int.from_bytes(content[conn : conn + 4], "little")
                return owner, seconds * 1_000_000_000 + nanoseconds
    return message_head_of(header_fields(head))


def message_head_of(fields: dict[bytes, bytes]) -> tuple[int, int] | None:
    """The same by the header's fields."""
    op = number(fields, b"op", 1)
    if op == Op.CONNECTION:
        return None
    if op != Op.MESSAGE:
        raise RecordError(f"a record of kind {op} in a chunk")
    return number(fields, b"conn", 4), time(fields, b"time")


def messages_in(
    content: Raw, at: int, wanted: Collection[int], low: int, high: int
) -> tuple[list[Found], int]:
    """Messages of the connections with low <= bag time < high, and where the content stops making sense.

    at: where to begin. Views of the content, not copies.
    """
    found: list[Found] = []
    view, end, from_bytes = memoryview(content), len(content), int.from_bytes
    while at + 8 <= end:
        start = at + from_bytes(view[at : at + 4], "little") + 8
        if start > end:
            break
        stop = start + from_bytes(view[start - 4 : start], "little")
        if stop > end:
            break
        try:
            head = message_head(view[at + 4 : start - 4])
        except RecordError:
            break
        if head is not None and head[0] in wanted and low <= head[1] < high:
            found.append((head[1], at, head[0], view[start:stop]))
        at = stop
    return found, at


def read_chunk(file: RawFile, chunk: Chunk, wanted: Collection[int], low: int, high: int) -> Read:
    """The messages in a chunk, and what of it was lost. Raises MisplacedError where no such chunk is."""
    try:
        record, codec, size = chunk_at(file, chunk.offset)
        if codec == "none":
            # What nobody asked for is not read.
            found, at = _plain_messages(file, record, wanted, wanted, low, high)
            if at == record.stop:
                return found, []
        content = chunk_content(file, record, codec, size)
    except LostError as error:
        count = None if chunk.counts is None else sum(chunk.counts.values())
        return [], [_loss(file, chunk, error.reason, record.stop - record.offset, count)]
    except CutError:
        content, codec = cut_content(file, chunk.offset), ""
    except RecordError as error:
        raise MisplacedError from error
    found, at = messages_in(content, 0, wanted, low, high)
    losses: list[Loss] = []
    while at < len(content) and codec:
        # The index of the chunk, where that is whole, says where it goes on.
        onward = min((place for place in _places(file, record, content) if place > at), default=len(content))
        losses.append(_loss(file, chunk, BAD_CHUNK_RECORDS, onward - at, None))
        more, at = messages_in(content, onward, wanted, low, high)
        found += more
    return found, losses


def read_heads(
    file: RawFile, chunk: Chunk, wanted: Collection[int], whole: Collection[int], low: int, high: int
) -> Read:
    """Like read_chunk, where a chunk without compression is read only where its messages begin."""
    try:
        record, codec, _ = chunk_at(file, chunk.offset)
    except RecordError as error:
        raise MisplacedError from error
    except CutError:
        codec = ""
    if codec == "none":
        found, at = _plain_messages(file, record, wanted, whole, low, high)
        if at == record.stop:
            return found, []
    # Whatever is wrong with it shows again, and is told, when it is read whole.
    return read_chunk(file, chunk, wanted, low, high)


def _plain_messages(
    file: RawFile, record: Record, wanted: Collection[int], whole: Collection[int], low: int, high: int
) -> tuple[list[Found], int]:
    """Messages of a plain chunk, heads of those not in `whole`, and where in the file it makes no sense."""
    found: list[Found] = []
    window, at, from_bytes = Window(file, record.stop), record.data, int.from_bytes
    while at + 8 <= record.stop:
        start = at + from_bytes(window.at(at, 4), "little") + 8
        if start > record.stop or start - at > LONGEST_HEADER:
            break
        fields = window.at(at + 4, start - at - 4)
        size = from_bytes(fields[-4:], "little")
        if start + size > record.stop:
            break
        try:
            head = message_head(fields[:-4])
        except RecordError:
            break
        if head is not None and head[0] in wanted and low <= head[1] < high:
            enough = size if head[0] in whole else min(size, HEAD)
            data = (
                window.at(start, min(enough, HEAD)) if enough <= HEAD else memoryview(file.read(start, size))
            )
            found.append((head[1], at - record.data, head[0], data))
        at = start + size
    return found, at


def indexes_behind(file: RawFile, at: int) -> tuple[int, dict[int, list[tuple[int, int]]]]:
    """Where the index records at a byte end, and (bag time, offset) of the messages of each connection.

    Raises RecordError or CutError where one of them is damaged.
    """
    found: dict[int, list[tuple[int, int]]] = {}
    while at < file.size:
        record = record_at(file, at)
        if record.op != Op.INDEX:
            break
        owner, entries = index_entries(file, record)
        found.setdefault(owner, []).extend(entries)
        at = record.stop
    return at, found


def _places(file: RawFile, record: Record, content: Raw) -> list[int]:
    """Where messages begin by the chunk's own index, as far as that is right."""
    try:
        _, indexes = indexes_behind(file, record.stop)
    except (RecordError, CutError):
        return []
    places = []
    for owner, entries in indexes.items():
        for when, at in entries:
            start = at + int.from_bytes(content[at : at + 4], "little") + 8
            try:
                if start <= len(content) and message_head(content[at + 4 : start - 4]) == (owner, when):
                    places.append(at)
            except RecordError:
                continue
    return places


def cut_content(file: RawFile, at: int) -> Raw:
    """What is there of the chunk in which the file ends; of a compressed one nothing."""
    head = file.upto(at, 512)
    size = int.from_bytes(head[:4], "little")
    if size + 8 > len(head):
        return b""
    try:
        fields = header_fields(head[4 : 4 + size])
    except RecordError:
        return b""
    is_plain = fields.get(b"op") == bytes([Op.CHUNK]) and fields.get(b"compression") == b"none"
    return file.upto(at + size + 8, file.size) if is_plain else b""


def _loss(file: RawFile, chunk: Chunk, reason: str, size: int, count: int | None) -> Loss:
    return Loss(file.path.name, reason, size, count, chunk.start, chunk.end)
