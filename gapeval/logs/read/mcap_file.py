"""MCAP files: with or without chunks, with or without a summary, CRCs checked."""

import heapq
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Literal

from mcap.data_stream import ReadDataStream
from mcap.records import Channel, Chunk, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk

from gapeval.logs.read.compression import decompressed
from gapeval.logs.read.container import (
    Container,
    Message,
    Topic,
    library_errors,
    merged_topics,
    ros2_type,
    whole_heads,
)
from gapeval.logs.read.mcap_index import Block, Index, read_index, record_content

KIND = "MCAP"
ADVICE = "`mcap recover` saves what is whole"


@contextmanager
def open_mcap_file(path: Path) -> Iterator[Container]:
    """An MCAP file. Raises LogError for one that is cut or damaged.

    A file without a summary or chunk index is read once from end to end here, to learn what is where.
    """
    with library_errors(path, KIND, ADVICE):
        stream = path.open("rb")
    with stream:
        with library_errors(path, KIND, ADVICE):
            index = read_index(stream)
            topics = {number: _topic(index, channel) for number, channel in index.channels.items()}
        blocks = [block for block in index.blocks if block.channels is None or block.channels]
        yield Container(
            kind=KIND,
            topics=merged_topics(topics.values()),
            start=min((block.start for block in blocks), default=None),
            end=max((block.end for block in blocks), default=None),
            messages=partial(_messages, stream, path, index, topics),
            heads=whole_heads(partial(_messages, stream, path, index, topics)),
            notices=index.notices,
        )


def _topic(index: Index, channel: Channel) -> Topic:
    schema = index.schemas.get(channel.schema_id) or Schema(id=0, name="", encoding="", data=b"")
    is_ros = channel.message_encoding in ("cdr", "ros1")
    syntaxes: dict[str, Literal["msg", "idl"]] = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl"}
    syntax: Literal["msg", "idl", ""] = syntaxes.get(schema.encoding, "")
    return Topic(
        name=channel.topic,
        type=ros2_type(schema.name) if is_ros else schema.name,
        count=index.counts.get(channel.id, 0),
        serialization=channel.message_encoding,
        definition=schema.data.decode("utf-8", "replace") if syntax else "",
        syntax=syntax,
    )


def _messages(
    stream: BinaryIO,
    path: Path,
    index: Index,
    topics: dict[int, Topic],
    names: Collection[str],
    start: int | None,
    stop: int | None,
) -> Iterator[Message]:
    """Blocks are opened in the order of their start; a message waits for the blocks that begin before it."""
    wanted = {number: topic for number, topic in topics.items() if topic.name in names}
    low = -1 if start is None else start
    # Bag times are int64 from here on; later ones are missing from the count of messages, which is told.
    high = 1 << 63 if stop is None else stop
    heap: list[tuple[int, int, int, Block | McapMessage]] = [
        (block.start, block.offset, -1, block)
        for block in index.blocks
        if block.end >= low and block.start < high and _holds(block, wanted)
    ]
    heapq.heapify(heap)
    with library_errors(path, KIND, ADVICE):
        while heap:
            _, offset, _, item = heapq.heappop(heap)
            if isinstance(item, McapMessage):
                yield wanted[item.channel_id], item.log_time, decompressed(item.data)
                continue
            for position, message in enumerate(_block_messages(stream, item)):
                if message.channel_id in wanted and low <= message.log_time < high:
                    heapq.heappush(heap, (message.log_time, offset, position, message))


def _holds(block: Block, wanted: Collection[int]) -> bool:
    return block.channels is None or any(number in wanted for number in block.channels)


def _block_messages(stream: BinaryIO, block: Block) -> Iterator[McapMessage]:
    opcode, content = record_content(stream, block.offset)
    if opcode != block.opcode:
        raise ValueError(f"the index points to byte {block.offset}, where no such record is")
    data = ReadDataStream(BytesIO(content))
    if block.is_chunk:
        records = breakup_chunk(Chunk.read(data), validate_crc=True)
        yield from (record for record in records if isinstance(record, McapMessage))
    else:
        yield McapMessage.read(data, len(content))
