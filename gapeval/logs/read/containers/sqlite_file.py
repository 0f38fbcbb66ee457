"""The sqlite3 storage of rosbag2: one `.db3` file, whole or broken."""

import shutil
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal
from urllib.parse import quote

from gapeval.errors import LogError
from gapeval.logs.read.container import (
    HEAD,
    Container,
    Loss,
    Message,
    Raw,
    Topic,
    library_errors,
    merged_topics,
    printable,
)
from gapeval.logs.read.containers.blocks import LAST_TIME
from gapeval.logs.read.containers.compression import MAGIC as ZSTD
from gapeval.logs.read.containers.compression import BombError, DamagedError, decompressed
from gapeval.logs.read.containers.losses import (
    BAD_MESSAGE,
    BOMB,
    INDEX_LIES,
    ODD_ROW,
    UNDESCRIBED,
    UNFINISHED_WAL,
    WAL_LEFT,
    Losses,
)
from gapeval.logs.read.containers.raw_file import raw_file
from gapeval.logs.read.containers.sqlite_salvage import Described, Salvaged, is_cut, read_payload, salvaged
from gapeval.logs.read.containers.sqlite_wal import read_wal

KIND = "rosbag2 sqlite3"
MAGIC = b"SQLite format 3\0"
ADVICE = "record it again"
CACHE = 16  # pages
COPIED = 1 << 28  # bytes of a database that is copied to read it with its -wal
DAMAGED = "the database is damaged, so its pages were read one by one"

Fetch = Callable[[int, int], Raw]  # rowid and length of a message -> its data, or as much as is needed of it
Place = tuple[int, int]  # bag time [ns] and rowid


@dataclass(slots=True)
class _Log:
    """An open database. salvaged: its rows as its pages have them, once it turns out to be damaged."""

    path: Path
    database: sqlite3.Connection | None
    topics: dict[int, Topic]
    losses: Losses
    salvaged: Salvaged | None = None


@contextmanager
def open_sqlite_file(path: Path) -> Iterator[Container]:
    """A `.db3` file, with what is still in a `-wal` file beside it; neither is changed.

    Raises LogError where nothing of it can be read.
    """
    losses = Losses()
    with ExitStack() as stack:
        notices: tuple[str, ...] = ()
        with library_errors(path, KIND, ADVICE):
            database = stack.enter_context(_database(path, losses))
            log = _Log(path, database, {}, losses)
            try:
                _check_size(path)
                described, counts, start, end = _read_topics(database)
            except (sqlite3.Error, ValueError, TypeError) as error:
                # sqlite3 lets anything stand in any column.
                described, counts, start, end = _salvage(log, str(error))
                notices = (DAMAGED,)
            log.topics = _topics(described, counts)
            _tell_undescribed(log, counts)
        yield Container(
            kind=KIND,
            topics=merged_topics(log.topics.values()),
            start=start,
            end=end,
            messages=lambda names, start, stop: _in_order(log, names, names, start, stop),
            heads=lambda names, whole, start, stop: _in_order(log, {*names, *whole}, whole, start, stop),
            notices=notices,
            losses=losses.found,
        )


@contextmanager
def _database(path: Path, losses: Losses) -> Iterator[sqlite3.Connection]:
    """A connection that writes nothing at all."""
    wal = path.with_name(path.name + "-wal")
    with ExitStack() as stack:
        written = read_wal(wal) if wal.exists() and wal.stat().st_size else None
        if written is not None and written.left_over:
            losses.add(Loss(wal.name, UNFINISHED_WAL, written.left_over))
        if written is None or not written.finished:
            # sqlite takes away a -wal in which nothing is finished, also from whoever is still writing it.
            database = stack.enter_context(closing(_connected(path, "immutable=1")))
        elif path.stat().st_size + written.size <= COPIED:
            database = stack.enter_context(_copied(path, wal))
        else:
            try:
                # Opened as immutable, what is in the -wal would be missing. Alone with the file, and without
                # locks, sqlite keeps the index of the -wal in memory and not in a file beside it.
                database = stack.enter_context(closing(_connected(path, "mode=ro&vfs=unix-none")))
                database.execute("PRAGMA locking_mode=EXCLUSIVE").fetchall()
                database.execute("SELECT count(*) FROM sqlite_master").fetchall()
            except sqlite3.OperationalError:
                # Not everywhere is such a way to files.
                database = stack.enter_context(_copied(path, wal))
        database.text_factory = lambda text: text.decode("utf-8", "replace")
        yield database


@contextmanager
def _copied(path: Path, wal: Path) -> Iterator[sqlite3.Connection]:
    """A connection to a copy of a database and its -wal."""
    with TemporaryDirectory(prefix="gapeval-") as folder:
        copy = Path(folder, path.name)
        shutil.copyfile(path, copy)
        shutil.copyfile(wal, copy.with_name(wal.name))
        with closing(_connected(copy, "mode=rw")) as database:
            yield database


def _check_size(path: Path) -> None:
    """Raises ValueError for a file that is cut: sqlite reads zeros where the last page is not all there."""
    with raw_file(path) as file:
        if is_cut(file):
            raise ValueError("the file is cut")


def _connected(path: Path, options: str) -> sqlite3.Connection:
    # In a URI `?`, `#` and `%` would have a meaning.
    return sqlite3.connect(f"file:{quote(str(path.absolute()))}?{options}", uri=True, check_same_thread=False)


def _read_topics(
    database: sqlite3.Connection,
) -> tuple[Described, dict[int, int], int | None, int | None]:
    """What is described, messages by topic, first and last bag time [ns]."""
    described, counts = Described(), {}
    # Each page is looked at once; to keep them costs more than to read them.
    database.execute(f"PRAGMA cache_size = {CACHE}")
    for number, name, kind, serialization in database.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        described.topics[int(number)] = (str(name), str(kind), str(serialization))
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
        for kind, encoding, text in database.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions ORDER BY id"
        ):
            described.definitions.setdefault(str(kind), (str(encoding), str(text)))
    spans = []
    for number, count, first, last in database.execute(
        "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY topic_id"
    ):
        counts[int(number)] = int(count)
        spans.append((int(first), int(last)))
    start = min((first for first, _ in spans), default=None)
    return described, counts, start, max((last for _, last in spans), default=None)


def _salvage(log: _Log, why: str) -> tuple[Described, dict[int, int], int | None, int | None]:
    """Looks into the pages themselves. Raises LogError where they hold no message."""
    with raw_file(log.path) as file:
        log.salvaged = found = salvaged(file, log.losses)
    if not found.rows:
        reason = " ".join(why.split())
        raise LogError(f"{log.path}: damaged {KIND} ({reason}), of which nothing can be read; {ADVICE}")
    wal = log.path.with_name(log.path.name + "-wal")
    if wal.exists() and wal.stat().st_size:
        log.losses.add(Loss(wal.name, WAL_LEFT, wal.stat().st_size))
    counts: dict[int, int] = {}
    for row in found.rows:
        counts[row.topic] = counts.get(row.topic, 0) + 1
    return found.described, counts, found.rows[0].time, found.rows[-1].time


def _topics(described: Described, counts: dict[int, int]) -> dict[int, Topic]:
    syntaxes: dict[str, Literal["msg", "idl"]] = {"ros2msg": "msg", "ros2idl": "idl"}
    topics = {}
    for number, (name, kind, serialization) in described.topics.items():
        encoding, text = described.definitions.get(kind, ("", ""))
        syntax: Literal["msg", "idl", ""] = syntaxes.get(encoding, "") if text else ""
        topics[number] = Topic(
            printable(name),
            printable(kind),
            counts.get(number, 0),
            printable(serialization),
            text if syntax else "",
            syntax,
        )
    return topics


def _tell_undescribed(log: _Log, counts: dict[int, int]) -> None:
    for number in sorted(set(counts) - set(log.topics)):
        log.losses.add(Loss(log.path.name, UNDESCRIBED, None, counts[number]))


def _in_order(
    log: _Log, names: Collection[str], whole: Collection[str], start: int | None, stop: int | None
) -> Iterator[Message]:
    """Messages by bag time and rowid; whole: names of those of which more than a head is needed."""
    wanted = {number: topic for number, topic in log.topics.items() if topic.name in names}
    low = 0 if start is None else max(start, 0)
    high = LAST_TIME if stop is None else stop - 1
    before: Place = (-1, -1)
    last: Place = (-1, -1)  # of the last message that was given; before: of the one before
    if log.salvaged is None:
        complete = {number for number, topic in wanted.items() if topic.name in whole}
        try:
            for place, number, data in _rows(log, wanted, complete, low, high):
                if place < last:
                    log.losses.add(Loss(log.path.name, INDEX_LIES))
                    raise sqlite3.DatabaseError("its index by time is out of order")
                before, last = last, place
                if (message := _message(log, wanted, place[0], number, data)) is not None:
                    yield message
            return
        except sqlite3.Error as error:
            # Beyond the damage the pages themselves are read; the last message may have been out of place.
            _salvage(log, str(error))
    with library_errors(log.path, KIND, ADVICE):
        for place, number, data in _salvaged_rows(log, wanted, low, high):
            if (
                place > before
                and place[1] != last[1]
                and (message := _message(log, wanted, place[0], number, data)) is not None
            ):
                yield message


def _message(log: _Log, wanted: dict[int, Topic], time: int, number: int, data: object) -> Message | None:
    if not isinstance(data, bytes):
        log.losses.add(Loss(log.path.name, ODD_ROW, None, 1, time, time))
        return None
    try:
        return wanted[number], time, decompressed(data)
    except (BombError, DamagedError) as error:
        reason = BOMB if isinstance(error, BombError) else BAD_MESSAGE
        log.losses.add(Loss(log.path.name, reason, len(data), 1, time, time))
        return None


def _rows(
    log: _Log, wanted: Collection[int], complete: Collection[int], low: int, high: int
) -> Iterator[tuple[Place, int, object]]:
    """(place, topic, data) of the wanted topics; a head of those that are not in `complete`."""
    assert log.database is not None
    if not wanted:
        return
    numbers = ",".join(str(number) for number in sorted(wanted))
    where = (
        f"FROM messages WHERE topic_id IN ({numbers}) AND timestamp BETWEEN ? AND ? ORDER BY timestamp, id"
    )
    if len(complete) == len(wanted) and _is_ordered(log.database):
        whole = log.database.execute(f"SELECT timestamp, id, topic_id, data {where}", (low, high))
        yield from (((time, row), number, data) for time, row, number, data in whole)
        return
    # The length of a blob is in its first page, and the rest of it stays unread.
    for time, row, number, length in log.database.execute(
        f"SELECT timestamp, id, topic_id, CASE typeof(data) WHEN 'blob' THEN length(data) END {where}",
        (low, high),
    ):
        data: object = None
        if length is not None:
            with log.database.blobopen("messages", "data", row, readonly=True) as blob:
                if number in complete or length <= HEAD:
                    data = blob.read()
                else:
                    data = blob.read(HEAD)
                    if data[:4] == ZSTD:
                        data += blob.read()
        yield (time, row), number, data


def _is_ordered(database: sqlite3.Connection) -> bool:
    """Whether there is an index by time; else sqlite would sort the messages with all that is in them."""
    for _, name, *_ in database.execute("PRAGMA index_list(messages)").fetchall():
        quoted = str(name).replace('"', '""')
        first = database.execute(f'PRAGMA index_info("{quoted}")').fetchone()
        if first is not None and first[2] == "timestamp":
            return True
    return False


def _salvaged_rows(
    log: _Log, wanted: Collection[int], low: int, high: int
) -> Iterator[tuple[Place, int, object]]:
    assert log.salvaged is not None
    with raw_file(log.path) as file:
        for row in log.salvaged.rows:
            if row.topic in wanted and low <= row.time <= high:
                data = read_payload(file, log.salvaged, row, log.losses)
                if data is not None:
                    yield (row.time, row.number), row.topic, data
