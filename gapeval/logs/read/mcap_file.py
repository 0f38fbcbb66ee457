"""MCAP files: with or without chunks, with or without a summary, whole or broken; CRCs checked."""

import heapq
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from mcap.records import Channel, Schema

from gapeval.errors import LogError
from gapeval.logs.read.ahead import ahead
from gapeval.logs.read.compression import BombError, DamagedError, decompressed
from gapeval.logs.read.container import (
    Container,
    Loss,
    Message,
    Raw,
    Topic,
    library_errors,
    merged_topics,
    printable,
    ros2_type,
)
from gapeval.logs.read.losses import BAD_MESSAGE, BOMB, INDEX_LIES, UNDESCRIBED, Losses
from gapeval.logs.read.mcap_chunk import Found, MisplacedError, read_block, read_heads
from gapeval.logs.read.mcap_index import read_index
from gapeval.logs.read.mcap_records import LAST_TIME, Block, Index
from gapeval.logs.read.mcap_salvage import walked
from gapeval.logs.read.raw_file import RawFile, raw_file

KIND = "MCAP"
ADVICE = "record it again"

Load = Callable[[Block], tuple[list[Found], Loss | None]]


@dataclass(slots=True)
class _Log:
    """An open file. index: by the summary, until that turns out to be wrong."""

    file: RawFile
    index: Index
    topics: dict[int, Topic]
    losses: Losses


@contextmanager
def open_mcap_file(path: Path) -> Iterator[Container]:
    """An MCAP file. Raises LogError where nothing of it can be read.

    A file without a usable summary is walked through here, to learn what is where.
    """
    losses = Losses()
    with raw_file(path) as file:
        with library_errors(path, KIND, ADVICE):
            index = read_index(file, losses)
            log = _Log(file, index, _topics(index), losses)
            _tell_undescribed(log)
        if losses.found and not (index.channels and index.blocks):
            raise LogError(
                f"{path}: damaged MCAP ({losses.found[0].reason}), of which nothing can be read; {ADVICE}"
            )
        blocks = [block for block in index.blocks if block.channels is None or block.channels]
        yield Container(
            kind=KIND,
            topics=merged_topics(log.topics.values()),
            start=min((block.start for block in blocks), default=None),
            end=max((block.end for block in blocks), default=None),
            messages=partial(_messages, log),
            heads=partial(_heads, log),
            notices=index.notices,
            losses=losses.found,
        )


def _topics(index: Index) -> dict[int, Topic]:
    return {number: _topic(index, channel) for number, channel in index.channels.items()}


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
    )


def _tell_undescribed(log: _Log) -> None:
    """Messages of channels that the file does not describe are lost: nobody knows what they are."""
    for number in sorted(set(log.index.counts) - set(log.index.channels)):
        count = log.index.counts[number]
        spans = [(b.start, b.end) for b in log.index.blocks if b.channels and number in b.channels]
        start = min((start for start, _ in spans), default=None)
        end = max((end for _, end in spans), default=None)
        log.losses.add(Loss(log.file.path.name, UNDESCRIBED, None, count, start, end))


def _messages(log: _Log, names: Collection[str], start: int | None, stop: int | None) -> Iterator[Message]:
    def load(wanted: Collection[int], low: int, high: int) -> Load:
        return lambda block: read_block(log.file, block, wanted, low, high)

    return _in_order(log, names, start, stop, load)


def _heads(
    log: _Log, names: Collection[str], whole: Collection[str], start: int | None, stop: int | None
) -> Iterator[Message]:
    def load(wanted: Collection[int], low: int, high: int) -> Load:
        complete = {number for number in wanted if log.topics[number].name in whole}
        return lambda block: read_heads(log.file, block, wanted, complete, low, high)

    return _in_order(log, {*names, *whole}, start, stop, load)


def _in_order(
    log: _Log,
    names: Collection[str],
    start: int | None,
    stop: int | None,
    make: Callable[[Collection[int], int, int], Load],
) -> Iterator[Message]:
    """Blocks are opened in the order of their start; a message waits for the blocks that begin before it."""
    low = -1 if start is None else start
    # Later ones than this are missing from the count of messages, which is told.
    high = LAST_TIME + 1 if stop is None else stop
    last = (-1, -1, -1)  # time, block and place of the last message that was given
    while True:
        wanted = {number: topic for number, topic in log.topics.items() if topic.name in names}
        try:
            with library_errors(log.file.path, KIND, ADVICE):
                for key, channel, raw in _run(log, make(wanted.keys(), low, high), wanted, low, high):
                    if key <= last:
                        continue
                    last = key
                    whole = _decompressed(log, key[0], raw)
                    if whole is not None:
                        yield wanted[channel], key[0], whole
            return
        except MisplacedError:
            _walk_instead(log)


def _run(
    log: _Log, load: Load, wanted: Collection[int], low: int, high: int
) -> Iterator[tuple[tuple[int, int, int], int, Raw]]:
    """((bag time, block, place in it), channel, data) in their order."""
    blocks = [b for b in log.index.blocks if b.end >= low and b.start < high and _holds(b, wanted)]
    blocks.sort(key=lambda block: (block.start, block.offset))
    heap: list[tuple[int, int, int, int, Raw]] = []
    with ahead(load, blocks) as loaded:
        for block, (found, loss) in loaded:
            if loss is not None:
                log.losses.add(loss)
            while heap and heap[0][:2] < (block.start, block.offset):
                time, offset, place, channel, raw = heapq.heappop(heap)
                yield (time, offset, place), channel, raw
            for time, place, channel, raw in found:
                heapq.heappush(heap, (time, block.offset, place, channel, raw))
    while heap:
        time, offset, place, channel, raw = heapq.heappop(heap)
        yield (time, offset, place), channel, raw


def _holds(block: Block, wanted: Collection[int]) -> bool:
    return block.channels is None or any(number in wanted for number in block.channels)


def _decompressed(log: _Log, time: int, raw: Raw) -> Raw | None:
    try:
        return decompressed(raw)
    except (BombError, DamagedError) as error:
        reason = BOMB if isinstance(error, BombError) else BAD_MESSAGE
        log.losses.add(Loss(log.file.path.name, reason, len(raw), 1, time, time))
        return None


def _walk_instead(log: _Log) -> None:
    """Where the index turns out to be wrong: what is in the file counts."""
    log.losses.add(Loss(log.file.path.name, INDEX_LIES))
    log.index = walked(log.file, log.losses)
    log.topics |= {number: topic for number, topic in _topics(log.index).items() if number not in log.topics}
    _tell_undescribed(log)
