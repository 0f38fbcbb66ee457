"""ROS 1 bags of version 2.0: plain, lz4 and bz2 chunks, whole or broken."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from gapeval.errors import LogError
from gapeval.logs.read.container import Container, Topic, library_errors, merged_topics, printable, ros2_type
from gapeval.logs.read.containers.blocks import BlockLog, undescribed
from gapeval.logs.read.containers.losses import Losses
from gapeval.logs.read.containers.raw_file import CutError, RawFile, raw_file
from gapeval.logs.read.containers.ros1_chunk import chunk_at, read_chunk, read_heads
from gapeval.logs.read.containers.ros1_index import read_index
from gapeval.logs.read.containers.ros1_records import FIRST, MAGIC, Chunk, Connection, Index, RecordError
from gapeval.logs.read.containers.ros1_salvage import walked

KIND = "ROS 1 bag"
ADVICE = "record it again"


@contextmanager
def open_ros1_bag(path: Path) -> Iterator[Container]:
    """A ROS 1 bag. Raises LogError where it is encrypted or of version 1, or nothing of it can be read."""
    losses = Losses()
    with raw_file(path) as file:
        _check_version(file)
        with library_errors(path, KIND, ADVICE):
            index = read_index(file, losses)
            blocks, topics = _described(file, losses, index)
        if losses.found and not blocks:
            reason = losses.found[0].reason
            raise LogError(f"{path}: damaged {KIND} ({reason}), of which nothing can be read; {ADVICE}")
        log = BlockLog(
            file=file,
            kind=KIND,
            blocks=blocks,
            topics=topics,
            losses=losses,
            read=partial(read_chunk, file),
            read_heads=partial(read_heads, file),
            unpack=lambda raw: raw,
            walk=lambda: _described(file, losses, walked(file, losses)),
            is_walked=bool(index.notices),
            # bz2 takes 50 times as long as lz4, and reading plain bytes is all there is to those.
            is_costly=_codec(file, blocks) == "bz2",
            is_plain=_codec(file, blocks) == "none",
        )
        yield Container(
            kind=KIND,
            topics=merged_topics(topics.values()),
            start=log.start,
            end=log.end,
            messages=log.messages,
            heads=log.heads,
            notices=index.notices,
            losses=losses.found,
        )


def _codec(file: RawFile, chunks: list[Chunk]) -> str:
    """How the first chunk is compressed, and so the others are."""
    try:
        return chunk_at(file, chunks[0].offset)[1] if chunks else ""
    except (RecordError, CutError):
        return ""


def _check_version(file: RawFile) -> None:
    first = file.upto(0, len(FIRST))
    if first != FIRST:
        shown = first.removeprefix(MAGIC).partition(b"\n")[0][:8].decode("ascii", "replace")
        version = shown if shown.isprintable() else "?"
        raise LogError(f"{file.path}: ROS bag of version {version}; convert it to 2.0 with `rosbag fix`")


def _described(file: RawFile, losses: Losses, index: Index) -> tuple[list[Chunk], dict[int, Topic]]:
    """The chunks that hold anything, and the topics; says which messages are of none."""
    counts = index.counts
    chunks = [chunk for chunk in index.chunks if chunk.counts]
    for loss in undescribed(file, counts, chunks, index.connections):
        losses.add(loss)
    topics = {owner: _topic(found, counts[owner]) for owner, found in index.connections.items()}
    return chunks, topics


def _topic(connection: Connection, count: int) -> Topic:
    text = connection.definition
    # `//a//b/` and `/a/b` are the same topic.
    name = "/" * connection.topic.startswith("/") + "/".join(
        part for part in connection.topic.split("/") if part
    )
    kind = ros2_type(printable(connection.type))
    return Topic(printable(name), kind, count, "ros1", text, "msg" if text.strip() else "")
