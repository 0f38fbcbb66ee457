"""MCAP files: with or without chunks, with or without a summary, whole or broken; CRCs checked."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Literal

from mcap.records import Channel, Schema

from gapeval.errors import LogError
from gapeval.logs.read.container import Container, Topic, library_errors, merged_topics, printable, ros2_type
from gapeval.logs.read.containers.blocks import BlockLog, undescribed
from gapeval.logs.read.containers.compression import decompressed
from gapeval.logs.read.containers.losses import Losses
from gapeval.logs.read.containers.mcap_chunk import read_block, read_heads
from gapeval.logs.read.containers.mcap_index import read_index
from gapeval.logs.read.containers.mcap_records import Block, Index, RecordError, chunk_at
from gapeval.logs.read.containers.mcap_salvage import walked
from gapeval.logs.read.containers.raw_file import CutError, RawFile, raw_file

KIND = "MCAP"
ADVICE = "record it again"


@contextmanager
def open_mcap_file(path: Path) -> Iterator[Container]:
    """An MCAP file. Raises LogError where nothing of it can be read.

    A file without a usable summary is walked through here, to learn what is where.
    """
    losses = Losses()
    with raw_file(path) as file:
        with library_errors(path, KIND, ADVICE):
            index = read_index(file, losses)
            blocks, topics = _described(file, losses, index)
        if losses.found and not (topics and blocks):
            reason = losses.found[0].reason
            raise LogError(f"{path}: damaged {KIND} ({reason}), of which nothing can be read; {ADVICE}")
        log = BlockLog(
            file=file,
            kind=KIND,
            blocks=blocks,
            topics=topics,
            losses=losses,
            read=partial(read_block, file),
            read_heads=partial(read_heads, file),
            unpack=decompressed,
            walk=lambda: _described(file, losses, walked(file, losses)),
            is_walked=index.is_walked,
            is_costly=True,
            is_plain=_is_plain(file, blocks),
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


def _is_plain(file: RawFile, blocks: list[Block]) -> bool:
    """Whether nothing is compressed, going by the first block."""
    try:
        return not (blocks and blocks[0].is_chunk and chunk_at(file, blocks[0].offset).compression)
    except (RecordError, CutError):
        return False


def _described(file: RawFile, losses: Losses, index: Index) -> tuple[list[Block], dict[int, Topic]]:
    """The blocks that may hold anything, and the topics; says which messages are of none."""
    blocks = [block for block in index.blocks if block.topics is None or block.topics]
    for loss in undescribed(file, index.counts, blocks, index.channels):
        losses.add(loss)
    return blocks, {number: _topic(index, channel) for number, channel in index.channels.items()}


def _topic(index: Index, channel: Channel) -> Topic:
    schema = index.schemas.get(channel.schema_id) or Schema(id=0, name="", encoding="", data=b"")
    is_ros = channel.message_encoding in ("cdr", "ros1")
    syntaxes: dict[str, Literal["msg", "idl"]] = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl"}
    syntax: Literal["msg", "idl", ""] = syntaxes.get(schema.encoding, "")
    name = printable(schema.name)
    return Topic(
        name=printable(channel.topic),
        type=ros2_type(name) if is_ros else name,
        count=index.counts.get(channel.id, 0),
        serialization=printable(channel.message_encoding),
        definition=schema.data.decode("utf-8", "replace") if syntax else "",
        syntax=syntax,
        schema=schema.data if schema.encoding == "protobuf" else b"",
    )
