"""The sqlite3 storage of rosbag2: one `.db3` file."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from gapeval.errors import LogError
from gapeval.logs.read.compression import decompressed
from gapeval.logs.read.container import Container, Message, Topic, library_errors, merged_topics, whole_heads

KIND = "rosbag2 sqlite3"
MAGIC = b"SQLite format 3\0"
ADVICE = "`ros2 bag convert`, or sqlite3's `.recover`, may save what is left"


@contextmanager
def open_sqlite_file(path: Path) -> Iterator[Container]:
    """A `.db3` file. Raises LogError for one that is damaged, or has messages in a `-wal` file beside it."""
    _check_write_ahead_log(path)
    # The library puts the path into a URI as it is, where `?`, `#` and `%` would have a meaning.
    reader = Sqlite3Reader(Path(quote(str(path))))
    with library_errors(path, KIND, ADVICE):
        reader.open()
    try:
        # sqlite3 lets anything stand in any column.
        with library_errors(path, KIND, ADVICE):
            empty = not reader.metadata.message_count
            container = Container(
                kind=KIND,
                topics=merged_topics(_topic(connection) for connection in reader.connections),
                start=None if empty else int(reader.metadata.start_time),
                end=None if empty else int(reader.metadata.end_time) - 1,
                messages=partial(_messages, reader, path),
                heads=whole_heads(partial(_messages, reader, path)),
            )
        yield container
    finally:
        reader.close()


def _check_write_ahead_log(path: Path) -> None:
    # The library opens the file as immutable and would silently leave out what is in the -wal.
    wal = path.with_name(path.name + "-wal")
    if wal.exists() and wal.stat().st_size:
        mend = f"sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'"
        raise LogError(f"{path}: part of its messages is still in {wal.name}; fold it in with `{mend}`")


def _topic(connection: Connection) -> Topic:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    syntaxes: dict[MessageDefinitionFormat, Literal["msg", "idl"]] = {
        MessageDefinitionFormat.MSG: "msg",
        MessageDefinitionFormat.IDL: "idl",
    }
    return Topic(
        name=connection.topic,
        type=connection.msgtype,
        count=connection.msgcount,
        serialization=connection.ext.serialization_format,
        definition=connection.msgdef.data,
        syntax=syntaxes.get(connection.msgdef.format, ""),
    )


def _messages(
    reader: Sqlite3Reader, path: Path, names: Collection[str], start: int | None, stop: int | None
) -> Iterator[Message]:
    connections = [c for c in reader.connections if c.topic in names]
    if not connections:
        return
    topics = {c.id: _topic(c) for c in connections}
    with library_errors(path, KIND, ADVICE):
        for connection, time, data in reader.messages(connections, start, stop):
            yield topics[connection.id], int(time), decompressed(data)
