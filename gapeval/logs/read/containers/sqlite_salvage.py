"""Messages out of the pages of a damaged sqlite3 database, whatever the tree over them says.

A row of a table stands in a leaf page; what does not fit goes on in a chain of overflow pages. The rows of
rosbag2's tables are known by the types of their columns.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

from gapeval.logs.read.container import Loss, Raw
from gapeval.logs.read.containers.blocks import LAST_TIME
from gapeval.logs.read.containers.losses import BROKEN_CHAIN, CUT_DATABASE, MISSING_ROWS, Losses
from gapeval.logs.read.containers.raw_file import CutError, RawFile

LEAF = 0x0D
HEADER = 100  # bytes before the first page's own header
USUAL_PAGE = 4096
INTEGERS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 8: 0, 9: 0}  # bytes by column type; 8 and 9 are 0 and 1
ENCODINGS = ("ros2msg", "ros2idl")


@dataclass(slots=True)
class Described:
    """topics: name, type and serialization by number; definitions: encoding and text by type."""

    topics: dict[int, tuple[str, str, str]] = field(default_factory=dict)
    definitions: dict[str, tuple[str, str]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Cell:
    """A row's bytes. start: of those in its leaf, in the file; local: how many; size: of all.

    number: its rowid; overflow: page of the next bytes, 0 for none.
    """

    number: int
    start: int
    local: int
    size: int
    overflow: int


@dataclass(frozen=True, slots=True)
class Row:
    """A message. number: its rowid; time: bag time [ns]; skip: bytes of the cell before its data."""

    time: int
    number: int
    topic: int
    cell: Cell
    skip: int


@dataclass(slots=True)
class Salvaged:
    """rows: by bag time and number. page: size of a page; usable: what of it may hold data [bytes]."""

    page: int
    usable: int
    described: Described = field(default_factory=Described)
    rows: list[Row] = field(default_factory=list)


def salvaged(file: RawFile, losses: Losses) -> Salvaged:
    """Everything that the pages hold; what is missing between the rows is told."""
    found = _layout(file)
    rows: dict[int, Row] = {}
    for at in range(0, file.size, found.page):
        page = file.upto(at, found.page)
        for cell in _cells(page, at, found, file.size):
            columns = _columns(page[cell.start - at : cell.start - at + cell.local], cell.size)
            if columns is None:
                continue
            if _is_message(columns):
                row = _message(page[cell.start - at :], cell, columns)
                if 0 <= row.time <= LAST_TIME:
                    rows.setdefault(cell.number, row)
            elif len(columns) >= 5 and all(_is_text(kind) for kind, _, _ in columns[1:]):
                _describe(file, found, cell, columns)
    _tell_missing(file, found, rows, losses)
    found.rows = sorted(rows.values(), key=lambda row: (row.time, row.number))
    return found


def is_cut(file: RawFile) -> bool:
    """Whether the file ends before its last page does, as far as its header says how many it has."""
    head, page = file.upto(0, HEADER), _layout(file).page
    # The number of pages counts only if it was written together with the last change.
    pages = int.from_bytes(head[28:32], "big") if head[24:28] == head[92:96] else 0
    return file.size % page != 0 or file.size < pages * page


def read_payload(file: RawFile, found: Salvaged, row: Row, losses: Losses) -> Raw | None:
    """A message's data; None, and a loss, where its pages do not hang together."""
    try:
        return _payload(file, found, row.cell)[row.skip :]
    except CutError:
        losses.add(Loss(file.path.name, BROKEN_CHAIN, row.cell.size, 1, row.time, row.time))
        return None


def _layout(file: RawFile) -> Salvaged:
    head = file.upto(0, HEADER)
    page = int.from_bytes(head[16:18], "big")
    page = 65536 if page == 1 else page
    if page < 512 or page & (page - 1):
        page = USUAL_PAGE
    reserved = head[20] if len(head) > 20 and head[20] <= 32 else 0
    return Salvaged(page, page - reserved)


def _cells(page: bytes, at: int, found: Salvaged, limit: int) -> Iterator[Cell]:
    """The cells of a leaf of a table; none of another page. limit: bytes that no row can have more of."""
    head = HEADER if at == 0 else 0
    if len(page) < head + 8 or page[head] != LEAF:
        return
    count = int.from_bytes(page[head + 3 : head + 5], "big")
    first = head + 8 + 2 * count
    if first > len(page):
        return
    for (place,) in struct.iter_unpack(">H", page[head + 8 : first]):
        try:
            size, start = _varint(page, place)
            number, start = _varint(page, start)
        except IndexError:
            continue
        local = _local(size, found.usable)
        stop = start + local + (4 if local < size else 0)
        if place < first or size > limit or stop > len(page):
            continue
        overflow = int.from_bytes(page[stop - 4 : stop], "big") if local < size else 0
        yield Cell(number, at + start, local, size, overflow)


def _local(size: int, usable: int) -> int:
    """How many bytes of a row stand in its leaf."""
    most, least = usable - 35, (usable - 12) * 32 // 255 - 23
    if size <= most:
        return size
    local = least + (size - least) % (usable - 4)
    return local if local <= most else least


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number of sqlite's variable length, and where it ends. Raises IndexError."""
    value = 0
    for count in range(9):
        byte = data[at + count]
        if count == 8:
            return (value << 8) | byte, at + 9
        value = (value << 7) | (byte & 0x7F)
        if byte < 0x80:
            break
    return value, at + count + 1


def _columns(local: bytes, size: int) -> list[tuple[int, int, int]] | None:
    """(type, start, length) of each column; None where these do not add up to the row."""
    try:
        head, at = _varint(local, 0)
        kinds = []
        while at < head:
            kind, at = _varint(local, at)
            kinds.append(kind)
    except IndexError:
        return None
    columns, start = [], head
    for kind in kinds:
        length = (kind - 12) // 2 if kind >= 12 else INTEGERS.get(kind, 8 if kind == 7 else 0)
        columns.append((kind, start, length))
        start += length
    return columns if at == head and start == size else None


def _is_message(columns: list[tuple[int, int, int]]) -> bool:
    """NULL for the number, which is the rowid, then topic, time and a blob."""
    return (
        len(columns) == 4
        and columns[0][0] == 0
        and columns[1][0] in INTEGERS
        and columns[2][0] in INTEGERS
        and columns[3][0] >= 12
        and not _is_text(columns[3][0])
    )


def _is_text(kind: int) -> bool:
    return kind >= 13 and kind % 2 == 1


def _message(local: bytes, cell: Cell, columns: list[tuple[int, int, int]]) -> Row:
    topic, time = (_integer(local, column) for column in columns[1:3])
    return Row(time, cell.number, topic, cell, columns[3][1])


def _integer(local: bytes, column: tuple[int, int, int]) -> int:
    kind, start, length = column
    return kind - 8 if kind >= 8 else int.from_bytes(local[start : start + length], "big", signed=True)


def _describe(file: RawFile, found: Salvaged, cell: Cell, columns: list[tuple[int, int, int]]) -> None:
    """Takes in a row of texts: a topic, or a definition, which has an encoding where a topic has its type."""
    try:
        payload = _payload(file, found, cell)
    except CutError:
        return
    texts = [payload[start : start + length].decode("utf-8", "replace") for _, start, length in columns[1:]]
    if texts[1] in ENCODINGS:
        found.described.definitions.setdefault(texts[0], (texts[1], texts[2]))
    else:
        found.described.topics.setdefault(cell.number, (texts[0], texts[1], texts[2]))


def _payload(file: RawFile, found: Salvaged, cell: Cell) -> bytes:
    """All bytes of a row. Raises CutError where its chain of pages leaves the file or goes on behind it."""
    pieces, left, page = [file.read(cell.start, cell.local)], cell.size - cell.local, cell.overflow
    while left > 0:
        if page < 2:
            raise CutError("a chain of pages that ends too early")
        content = file.read((page - 1) * found.page, min(found.usable, left + 4))
        page = int.from_bytes(content[:4], "big")
        pieces.append(content[4:])
        left -= len(content) - 4
    if page:
        raise CutError("a chain of pages that goes on")
    return b"".join(pieces)


def _tell_missing(file: RawFile, found: Salvaged, rows: dict[int, Row], losses: Losses) -> None:
    """rosbag2 numbers messages without gaps: those between are lost. The end of the file may be as well."""
    name, last = file.path.name, 0
    for number in sorted(rows):
        if number > last + 1:
            before = rows[last].time if last else None
            losses.add(Loss(name, MISSING_ROWS, None, number - last - 1, before, rows[number].time))
        last = number
    if is_cut(file):
        # The header says how many pages there were.
        missing = int.from_bytes(file.upto(28, 4), "big") * found.page - file.size
        losses.add(
            Loss(
                name,
                CUT_DATABASE,
                missing if missing > 0 else None,
                None,
                rows[last].time if last else None,
                None,
            )
        )
