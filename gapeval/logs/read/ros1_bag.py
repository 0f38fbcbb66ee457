"""ROS 1 bags of version 2.0: plain, lz4 and bz2 chunks."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader

from gapeval.errors import LogError
from gapeval.logs.read.container import Container, Message, Topic, library_errors, merged_topics, whole_heads

KIND = "ROS 1 bag"
MAGIC = b"#ROSBAG V"


@contextmanager
def open_ros1_bag(path: Path) -> Iterator[Container]:
    """A ROS 1 bag. Raises LogError for one that is not indexed, damaged, encrypted or of version 1."""
    _check_header(path)
    with library_errors(path, KIND, f"`rosbag reindex {path.name}` may mend it"):
        reader = Reader(path)
        reader.open()
    try:
        with library_errors(path, KIND, f"`rosbag reindex {path.name}` may mend it"):
            empty = not reader.chunk_infos or not reader.message_count
            container = Container(
                kind=KIND,
                topics=merged_topics(_topic(reader, connection) for connection in reader.connections),
                start=None if empty else reader.start_time,
                end=None if empty else reader.end_time - 1,
                messages=partial(_messages, reader, path),
                heads=whole_heads(partial(_messages, reader, path)),
            )
        yield container
    finally:
        reader.close()


def _check_header(path: Path) -> None:
    """The two conditions that have a better answer than `damaged`."""
    with library_errors(path, KIND, "record it again"), path.open("rb") as file:
        head = file.read(4096)
    version = head.partition(b"\n")[0].removeprefix(MAGIC)
    if version != b"2.0":
        shown = version[:8].decode("ascii", "replace")
        raise LogError(f"{path}: ROS bag of version {shown}; convert it to 2.0 with `rosbag fix`")
    if b"index_pos=" + bytes(8) in head:
        advice = f"`rosbag reindex {path.name}` writes its index"
        raise LogError(f"{path}: this ROS 1 bag was never closed and has no index; {advice}")


def _topic(reader: Reader, connection: Connection) -> Topic:
    # The chunks' own counts: the index is what gets read, so that a difference between the two shows.
    count = sum(chunk.connection_counts.get(connection.id, 0) for chunk in reader.chunk_infos)
    text = connection.msgdef.data
    return Topic(connection.topic, connection.msgtype, count, "ros1", text, "msg" if text.strip() else "")


def _messages(
    reader: Reader, path: Path, names: Collection[str], start: int | None, stop: int | None
) -> Iterator[Message]:
    connections = [c for c in reader.connections if c.topic in names]
    if not connections:
        return
    topics = {c.id: _topic(reader, c) for c in connections}
    with library_errors(path, KIND, f"`rosbag reindex {path.name}` may mend it"):
        for connection, time, data in reader.messages(connections, start, stop):
            yield topics[connection.id], time, data
