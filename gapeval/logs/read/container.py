"""What every kind of log file offers: topics, and raw messages in the order of their bag times."""

import heapq
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from gapeval.errors import LogError

Raw = bytes | memoryview
HEAD = 1024  # bytes; a ROS header with the longest frame name that anybody uses


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of one type.

    type: in the spelling of ROS 2, `sensor_msgs/msg/PointCloud2`; names that are not of ROS stay as they are.
    count: messages, by the log's own statistics.
    serialization: `ros1`, `cdr`, or what else the log says, such as `protobuf`.
    definition: text of the message definition, empty where the log has none; syntax: `msg`, `idl` or empty.
    schema: what describes the messages of other encodings than ROS's own, as it stands in the log.
    """

    name: str
    type: str
    count: int
    serialization: str
    definition: str = ""
    syntax: Literal["msg", "idl", ""] = ""
    schema: bytes = b""


@dataclass(frozen=True, slots=True)
class Loss:
    """A part of a log that cannot be read.

    file: its name; bytes: how many of it; messages: how many were in it; start, end: bag times around it
    [ns]; None each where that is not known. reason: in words, without any of these.
    """

    file: str
    reason: str
    bytes: int | None = None
    messages: int | None = None
    start: int | None = None
    end: int | None = None

    def __str__(self) -> str:
        parts = [] if self.messages is None else [f"{self.messages} messages"]
        parts += [] if self.bytes is None else [f"{self.bytes} bytes"]
        if self.start is not None and self.end is not None:
            parts.append(f"{(self.end - self.start) / 1e9:.1f} s at {self.start / 1e9:.3f}")
        amount = f" ({', '.join(parts)})" if parts else ""
        return f"{self.file}: {self.reason}{amount}"


Message = tuple[Topic, int, Raw]
Messages = Callable[[Collection[str], int | None, int | None], Iterator[Message]]
Heads = Callable[[Collection[str], Collection[str], int | None, int | None], Iterator[Message]]


@dataclass(frozen=True, slots=True)
class Container:
    """An open log.

    start, end: first and last bag time [ns]; None without messages, or where only reading would tell.
    messages: (topic names, start, stop) -> messages with start <= bag time < stop, in the order of their bag
    times, ties always in the same order. Raises LogError where the file turns out to be damaged beyond use.
    heads: (topic names of which heads suffice, topic names that are needed whole, start, stop) -> the same
    messages in the same order; of the former only the first HEAD bytes need be there, so a message shorter
    than HEAD comes whole. A checksum over more than what is read is not looked at.
    losses: what cannot be read, each once; grows while messages are read.
    """

    kind: str
    topics: tuple[Topic, ...]
    start: int | None
    end: int | None
    messages: Messages
    heads: Heads
    notices: tuple[str, ...] = ()
    losses: list[Loss] = field(default_factory=list)


def whole_heads(messages: Messages) -> Heads:
    """Heads where nothing is cheaper than whole messages."""

    def heads(
        names: Collection[str], whole: Collection[str], start: int | None, stop: int | None
    ) -> Iterator[Message]:
        return messages({*names, *whole}, start, stop)

    return heads


@contextmanager
def library_errors(path: Path, kind: str, advice: str) -> Iterator[None]:
    """Whatever the libraries raise on an odd file (KeyError, AssertionError, ...) as one LogError."""
    try:
        yield
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:
        text = " ".join(str(error).split())
        reason = f"{type(error).__name__}: {text[:200]}" if text else type(error).__name__
        if isinstance(error, AssertionError):
            reason = "its parts contradict each other"
        raise LogError(f"{path}: damaged {kind} ({reason}); {advice}") from error


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Puts the log's path in front of a LogError that does not know it."""
    try:
        yield
    except LogError as error:
        if str(error).startswith(f"{path}"):
            raise
        raise LogError(f"{path}: {error}") from error


def ros2_type(name: str) -> str:
    """`sensor_msgs/PointCloud2` -> `sensor_msgs/msg/PointCloud2`; anything else stays as it is."""
    package, slash, rest = name.partition("/")
    return f"{package}/msg/{rest}" if slash and "/" not in rest else name


def ros1_type(name: str) -> str:
    """The short spelling that both ROS 1 users and error lines use: `sensor_msgs/PointCloud2`."""
    return name.replace("/msg/", "/")


def printable(name: str) -> str:
    """A name out of a file as it may stand in a line: damaged ones hold anything, line breaks too."""
    return name if name.isprintable() else "".join(c if c.isprintable() else "\ufffd" for c in name)


def merged_topics(topics: Iterable[Topic]) -> tuple[Topic, ...]:
    """One topic for every name and type, counts added, the first definition that is there; sorted by name."""
    merged: dict[tuple[str, str, str], Topic] = {}
    for topic in topics:
        key = (topic.name, topic.type, topic.serialization)
        known = merged.get(key)
        if known is None:
            merged[key] = topic
        else:
            source = known if known.definition or known.schema else topic
            merged[key] = replace(source, count=known.count + topic.count)
    return tuple(merged[key] for key in sorted(merged))


@dataclass(frozen=True, slots=True)
class Source:
    """Messages that are opened only when their time has come; start: not later than their first bag time."""

    start: int
    messages: Callable[[], Iterator[Message]]


def in_time_order(sources: Iterable[Source]) -> Iterator[Message]:
    """Messages of sources that each are in order; a source is not opened before its start is reached."""
    waiting = list(sources)
    heap: list[tuple[int, int, Message | None]] = [(s.start, i, None) for i, s in enumerate(waiting)]
    heapq.heapify(heap)
    opened: dict[int, Iterator[Message]] = {}
    while heap:
        _, index, message = heapq.heappop(heap)
        if message is not None:
            yield message
        if index not in opened:
            opened[index] = waiting[index].messages()
        following = next(opened[index], None)
        if following is not None:
            heapq.heappush(heap, (following[1], index, following))
