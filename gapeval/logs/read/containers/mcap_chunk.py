"""What is in a chunk of an MCAP file."""

import zlib
from collections.abc import Collection, Iterator

from mcap.opcode import Opcode

from gapeval.logs.read.container import HEAD, Loss, Raw
from gapeval.logs.read.containers.blocks import Found, MisplacedError, Read
from gapeval.logs.read.containers.compression import MAGIC as ZSTD
from gapeval.logs.read.containers.compression import BombError, DamagedError, decompressed_chunk
from gapeval.logs.read.containers.losses import (
    BAD_CHECKSUM,
    BAD_CHUNK,
    BAD_CHUNK_RECORDS,
    BOMB,
    CUT,
    UNKNOWN_COMPRESSION,
    LostError,
)
from gapeval.logs.read.containers.mcap_records import (
    CODECS,
    RECORD_AND_MESSAGE_HEAD,
    RECORD_HEAD,
    Block,
    Chunk,
    RecordError,
    chunk_at,
)
from gapeval.logs.read.containers.mcap_records import HEAD as RECORD
from gapeval.logs.read.containers.raw_file import CutError, RawFile, Window

BEFORE_DATA = RECORD_AND_MESSAGE_HEAD.size


def chunk_content(file: RawFile, chunk: Chunk) -> Raw:
    """The bytes of a chunk, checked against its CRC. Raises LostError."""
    if chunk.compression not in CODECS:
        raise LostError(UNKNOWN_COMPRESSION)
    try:
        content = decompressed_chunk(file.read(chunk.data, chunk.length), chunk.compression, chunk.size)
    except BombError as error:
        raise LostError(BOMB) from error
    except DamagedError as error:
        raise LostError(BAD_CHUNK) from error
    except CutError as error:
        raise LostError(CUT) from error
    if chunk.crc and zlib.crc32(content) != chunk.crc:
        raise LostError(BAD_CHECKSUM)
    return content


def records(content: Raw) -> Iterator[tuple[int, int, int]]:
    """(opcode, start, stop) of the content of every whole record; what is left at the end has opcode -1."""
    at, end = 0, len(content)
    while at + RECORD <= end:
        opcode, length = RECORD_HEAD.unpack_from(content, at)
        if length > end - at - RECORD:
            break
        yield opcode, at + RECORD, at + RECORD + length
        at += RECORD + length
    if at < end:
        yield -1, at, end


def messages_in(content: Raw, wanted: Collection[int], low: int, high: int) -> tuple[list[Found], int]:
    """Messages of the channels with low <= bag time < high, and where the content stops making sense.

    Views of the content, not copies.
    """
    found: list[Found] = []
    view, at, end = memoryview(content), 0, len(content)
    unpack, from_bytes = RECORD_AND_MESSAGE_HEAD.unpack_from, int.from_bytes
    while at + RECORD <= end:
        if view[at] != Opcode.MESSAGE:
            stop = at + RECORD + from_bytes(view[at + 1 : at + RECORD], "little")
            if stop > end:
                break
        else:
            if at + BEFORE_DATA > end:
                break
            _, length, channel, _, time, _ = unpack(view, at)
            stop = at + RECORD + length
            if stop > end or stop < at + BEFORE_DATA:
                break
            if channel in wanted and low <= time < high:
                found.append((time, at, channel, view[at + BEFORE_DATA : stop]))
        at = stop
    return found, at


def read_block(file: RawFile, block: Block, wanted: Collection[int], low: int, high: int) -> Read:
    """The messages in a block, and what of it was lost. Raises MisplacedError where no such block is."""
    if not block.is_chunk:
        content: Raw = file.read(block.offset, block.stop - block.offset)
        return messages_in(content, wanted, low, high)[0], []
    try:
        chunk = chunk_at(file, block.offset)
    except (RecordError, CutError) as error:
        raise MisplacedError from error
    if chunk.stop > file.size:
        return _read_cut(file, chunk, wanted, low, high)
    if block.stop != chunk.stop:
        raise MisplacedError
    try:
        content = chunk_content(file, chunk)
    except LostError as error:
        return [], [_loss(file, block, error.reason, chunk.stop - chunk.offset, block.count)]
    found, stop = messages_in(content, wanted, low, high)
    if stop == len(content):
        return found, []
    return found, [_loss(file, block, BAD_CHUNK_RECORDS, len(content) - stop, None)]


def read_heads(
    file: RawFile, block: Block, wanted: Collection[int], whole: Collection[int], low: int, high: int
) -> Read:
    """Like read_block, where a chunk without compression is read only where its messages begin."""
    if block.is_chunk:
        try:
            chunk = chunk_at(file, block.offset)
        except (RecordError, CutError) as error:
            raise MisplacedError from error
        if not chunk.compression and chunk.stop == block.stop <= file.size and chunk.size == chunk.length:
            found, at = _heads(file, chunk, wanted, whole, low, high)
            if at == chunk.stop:
                return found, []
    # Whatever is wrong with it shows again, and is told, when it is read whole.
    return read_block(file, block, wanted, low, high)


def _heads(
    file: RawFile, chunk: Chunk, wanted: Collection[int], whole: Collection[int], low: int, high: int
) -> tuple[list[Found], int]:
    """Heads out of a plain chunk, and where in the file it stops making sense."""
    found: list[Found] = []
    window, at = Window(file, chunk.stop), chunk.data
    while at + RECORD <= chunk.stop:
        head = window.at(at, BEFORE_DATA)
        opcode, length = RECORD_HEAD.unpack_from(head)
        stop = at + RECORD + length
        if stop > chunk.stop:
            break
        if opcode == Opcode.MESSAGE:
            if length < BEFORE_DATA - RECORD:
                break
            _, _, channel, _, time, _ = RECORD_AND_MESSAGE_HEAD.unpack(head)
            if channel in wanted and low <= time < high:
                start, size = at + BEFORE_DATA, stop - at - BEFORE_DATA
                data = window.at(start, min(size, HEAD))
                if size > HEAD and (channel in whole or data[:4] == ZSTD):
                    data = memoryview(file.read(start, size))
                found.append((time, at - chunk.data, channel, data))
        at = stop
    return found, at


def _read_cut(file: RawFile, chunk: Chunk, wanted: Collection[int], low: int, high: int) -> Read:
    """What is whole of the last chunk of a file that was cut, which has no checksum any more."""
    if chunk.compression:
        return [], []
    content = file.upto(chunk.data, chunk.length)
    return messages_in(content, wanted, low, high)[0], []


def _loss(file: RawFile, block: Block, reason: str, size: int, count: int | None) -> Loss:
    return Loss(file.path.name, reason, size, count, block.start, block.end)
