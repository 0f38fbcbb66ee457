"""What is in a chunk of a ROS 1 bag."""

from collections.abc import Callable, Collection, Iterator

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
from gapeval.logs.read.containers.ros1_message import message_head
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
)

CODECS = ("none", "lz4", "bz2")

Place = tuple[int, int, int]  # in the chunk, connection, bag time [ns]


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
        places = _located(file, record, chunk, wanted, low, high)
        if codec == "none" and places is not None:
            # What nobody asked for is not read.
            window = Window(file, record.stop, record.data)
            if (picked := _picked(window.at, record.stop - record.data, places, wanted)) is not None:
                return picked, []
        content = chunk_content(file, record, codec, size)
        if (
            places is not None
            and (picked := _picked(_slices(content), len(content), places, wanted)) is not None
        ):
            return picked, []
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
        places = _located(file, record, chunk, wanted, low, high)
        window = Window(file, record.stop, record.data)
        if (
            places is not None
            and (picked := _picked(window.at, record.stop - record.data, places, whole)) is not None
        ):
            return picked, []
        found, at = _plain_messages(file, record, wanted, whole, low, high)
        if at == record.stop:
            return found, []
    # Whatever is wrong with it shows again, and is told, when it is read whole.
    return read_chunk(file, chunk, wanted, low, high)


def _located(
    file: RawFile, record: Record, chunk: Chunk, wanted: Collection[int], low: int, high: int
) -> list[Place] | None:
    """Where the wanted messages are by the chunk's own index; None where that and the bag's do not agree."""
    if not chunk.is_indexed:
        return None
    counts: dict[int, int] = {}
    places: list[Place] = []
    at = record.stop
    try:
        while len(counts) < len(chunk.counts or ()):
            index = record_at(file, at)
            owner = number(index.fields, b"conn", 4)
            if index.op != Op.INDEX or owner in counts:
                return None
            counts[owner] = number(index.fields, b"count", 4)
            if owner in wanted:
                found = index_entries(file, index)[1]
                places += [(place, owner, when) for when, place in found if low <= when < high]
            at = index.stop
    except (RecordError, CutError):
        return None
    return sorted(places) if counts == chunk.counts else None


def _picked(
    get: Callable[[int, int], memoryview], end: int, places: list[Place], whole: Collection[int]
) -> list[Found] | None:
    """The messages at these places, heads of those not in `whole`; None where one of them is another.

    get: (place in the chunk, length) -> bytes, fewer where the chunk ends, which is at `end`.
    """
    found: list[Found] = []
    for at, owner, when in places:
        size = int.from_bytes(get(at, 4), "little")
        if size > LONGEST_HEADER:
            return None
        head = get(at + 4, size + 4)
        try:
            if message_head(head[:size]) != (owner, when):
                return None
        except RecordError:
            return None
        length, start = int.from_bytes(head[size:], "little"), at + size + 8
        asked = length if owner in whole else min(length, HEAD)
        data = get(start, asked)
        if len(head) != size + 4 or len(data) != asked or start + length > end:
            return None
        found.append((when, at, owner, data))
    return found


def _slices(content: Raw) -> Callable[[int, int], memoryview]:
    view = memoryview(content)
    return lambda at, length: view[at : at + length]


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
