"""Logs of blocks (chunks, mostly): messages out of these, in the order of their bag times."""

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from gapeval.errors import LogError
from gapeval.logs.read.container import Loss, Message, Raw, Topic, library_errors
from gapeval.logs.read.containers.ahead import ahead, in_turn
from gapeval.logs.read.containers.compression import BombError, DamagedError
from gapeval.logs.read.containers.losses import BAD_MESSAGE, BOMB, INDEX_LIES, UNDESCRIBED, Losses
from gapeval.logs.read.containers.raw_file import RawFile

LAST_TIME = (1 << 63) - 1  # bag times are int64

Found = tuple[int, int, int, Raw]  # bag time [ns], place in the block, number of the topic, data
Read = tuple[list[Found], list[Loss]]
Key = tuple[int, int, int]  # bag time, offset of the block, place in it


class Span(Protocol):
    """Where a block stands in the file, its first and last bag time [ns], and its messages by topic."""

    @property
    def offset(self) -> int: ...
    @property
    def start(self) -> int: ...
    @property
    def end(self) -> int: ...
    @property
    def topics(self) -> Collection[int] | None: ...


Block = TypeVar("Block", bound=Span)


class MisplacedError(Exception):
    """The index says otherwise than the bytes it points to."""


@dataclass(slots=True)
class BlockLog(Generic[Block]):
    """An open file of blocks.

    topics: by number. read: (block, numbers, low, high) -> the messages with low <= bag time < high, and what
    was lost; read_heads: (block, numbers, those needed whole, low, high) -> the same with heads.
    unpack: a message as it was before it was compressed. walk: blocks and topics by the bytes alone, for when
    the index turns out to be wrong; is_walked: whether they are.
    is_costly: whether threads are to read whole blocks ahead; is_plain: whether heads cost next to nothing.
    """

    file: RawFile
    kind: str
    blocks: list[Block]
    topics: dict[int, Topic]
    losses: Losses
    read: Callable[[Block, Collection[int], int, int], Read]
    read_heads: Callable[[Block, Collection[int], Collection[int], int, int], Read]
    unpack: Callable[[Raw], Raw]
    walk: Callable[[], tuple[list[Block], dict[int, Topic]]]
    is_walked: bool
    is_costly: bool
    is_plain: bool

    @property
    def start(self) -> int | None:
        return min((block.start for block in self.blocks), default=None)

    @property
    def end(self) -> int | None:
        return max((block.end for block in self.blocks), default=None)

    def messages(self, names: Collection[str], start: int | None, stop: int | None) -> Iterator[Message]:
        """As in Container."""
        return _in_order(self, names, start, stop, self.is_costly, lambda _: self.read)

    def heads(
        self, names: Collection[str], whole: Collection[str], start: int | None, stop: int | None
    ) -> Iterator[Message]:
        """As in Container."""

        def reading(wanted: dict[int, Topic]) -> Callable[[Block, Collection[int], int, int], Read]:
            complete = {number for number, topic in wanted.items() if topic.name in whole}
            return lambda block, numbers, low, high: self.read_heads(block, numbers, complete, low, high)

        return _in_order(self, {*names, *whole}, start, stop, self.is_costly and not self.is_plain, reading)


def undescribed(
    file: RawFile, counts: dict[int, int], blocks: Iterable[Span], known: Collection[int]
) -> list[Loss]:
    """Messages of topics that the file does not describe are lost: nobody knows what they are."""
    losses, every = [], list(blocks)
    for number in sorted(set(counts) - set(known)):
        spans = [(block.start, block.end) for block in every if block.topics and number in block.topics]
        start = min((start for start, _ in spans), default=None)
        end = max((end for _, end in spans), default=None)
        losses.append(Loss(file.path.name, UNDESCRIBED, None, counts[number], start, end))
    return losses


def _in_order(
    log: BlockLog[Block],
    names: Collection[str],
    start: int | None,
    stop: int | None,
    is_costly: bool,
    reading: Callable[[dict[int, Topic]], Callable[[Block, Collection[int], int, int], Read]],
) -> Iterator[Message]:
    low = -1 if start is None else start
    # Later ones than this are missing from the count of messages, which is told.
    high = LAST_TIME + 1 if stop is None else stop
    last = (-1, -1, -1)  # of the last message that was given
    while True:
        wanted = {number: topic for number, topic in log.topics.items() if topic.name in names}
        read = reading(wanted)
        with library_errors(log.file.path, log.kind, "record it again"):
            try:
                for key, number, raw in _run(log, read, wanted, low, high, is_costly):
                    if key <= last:
                        continue
                    last = key
                    whole = _unpacked(log, key[0], raw)
                    if whole is not None:
                        yield wanted[number], key[0], whole
                return
            except MisplacedError as error:
                if log.is_walked:
                    raise LogError(f"{log.file.path}: changed while it was read; read it again") from error
                log.losses.add(Loss(log.file.path.name, INDEX_LIES))
                log.blocks, topics = log.walk()
                log.topics |= {number: topic for number, topic in topics.items() if number not in log.topics}
                log.is_walked = True


def _run(
    log: BlockLog[Block],
    read: Callable[[Block, Collection[int], int, int], Read],
    wanted: dict[int, Topic],
    low: int,
    high: int,
    is_costly: bool,
) -> Iterator[tuple[Key, int, Raw]]:
    """Blocks are opened in the order of their start; a message waits for the blocks that begin before it."""
    blocks = [b for b in log.blocks if b.end >= low and b.start < high and _holds(log, b, wanted)]
    blocks.sort(key=lambda block: (block.start, block.offset))
    heap: list[tuple[int, int, int, int, Raw]] = []
    prepared = ahead if is_costly else in_turn
    with prepared(lambda block: read(block, wanted.keys(), low, high), blocks) as loaded:
        for block, (found, losses) in loaded:
            for loss in losses:
                log.losses.add(loss)
            if not log.is_walked and any(not block.start <= item[0] <= block.end for item in found):
                raise MisplacedError
            while heap and heap[0][:2] < (block.start, block.offset):
                time, offset, place, number, raw = heapq.heappop(heap)
                yield (time, offset, place), number, raw
            for time, place, number, raw in found:
                heapq.heappush(heap, (time, block.offset, place, number, raw))
    while heap:
        time, offset, place, number, raw = heapq.heappop(heap)
        yield (time, offset, place), number, raw


def _holds(log: BlockLog[Block], block: Block, wanted: Collection[int]) -> bool:
    # Of a file that contradicts itself only the messages are believed.
    return log.is_walked or block.topics is None or any(number in wanted for number in block.topics)


def _unpacked(log: BlockLog[Block], time: int, raw: Raw) -> Raw | None:
    try:
        return log.unpack(raw)
    except (BombError, DamagedError) as error:
        reason = BOMB if isinstance(error, BombError) else BAD_MESSAGE
        log.losses.add(Loss(log.file.path.name, reason, len(raw), 1, time, time))
        return None
