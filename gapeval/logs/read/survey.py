"""One pass through a log: everything but the points of its clouds."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gapeval.logs.read.container import Container, Raw, Topic
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.laser import require_angles
from gapeval.logs.read.messages.content import head, laser_scan, role_of
from gapeval.logs.read.messages.message import UndecodableError
from gapeval.logs.read.samples import Samples, add_message, is_static_topic

Progress = Callable[[int, int], None]

UNDECODABLE = "message cannot be decoded"
BESIDE = 5 * 10**9  # ns; transforms may be recorded that long before or after what needs them


@dataclass(frozen=True, slots=True)
class Window:
    """Bag times [ns] of the clouds that are wanted; None: from the beginning, to the end."""

    start: int | None = None
    stop: int | None = None

    @property
    def beside(self) -> "Window":
        """The times of all that clouds in the window may need."""
        return Window(
            None if self.start is None else self.start - BESIDE,
            None if self.stop is None else self.stop + BESIDE,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Headers:
    """What the headers of the clouds say, in the order of the log; n of them.

    topics: (n,) places among the cloud topics. stamps: (n,) header stamps [ns]; bag_times: (n,) [ns]; ranks:
    (n,) place among the messages of the topic with the same bag time; indices: (n,) place among all messages
    of the topic. frames: (n,) frame_id.
    beams: (n,), of planar scans, and increments: (n,) [s] from beam to beam; else 0.
    undecodable: bag times of the messages that are no clouds; why: an example.
    """

    topics: NDArray[np.int64]
    stamps: NDArray[np.int64]
    bag_times: NDArray[np.int64]
    ranks: NDArray[np.int64]
    indices: NDArray[np.int64]
    frames: tuple[str, ...]
    beams: NDArray[np.int64]
    increments: NDArray[np.float64]
    undecodable: tuple[int, ...] = ()
    why: str = ""

    @property
    def total(self) -> int:
        return len(self.stamps) + len(self.undecodable)


@dataclass(slots=True)
class _Rows:
    rows: list[tuple[int, int, int, int, int, int]] = field(default_factory=list)
    increments: list[float] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)
    undecodable: list[int] = field(default_factory=list)
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """lacking: topic -> messages that the log's own statistics name and that were not there; broken: topic ->
    messages that cannot be decoded.
    """

    headers: Headers
    samples: Samples
    notices: tuple[str, ...]
    lacking: dict[str, int]
    broken: dict[str, int]


def take_survey(
    container: Container,
    cloud_topics: tuple[str, ...],
    others: tuple[str, ...],
    heads: tuple[str, ...],
    window: Window,
    progress: Progress | None,
) -> Survey:
    """Reads tf, poses and the headers of the clouds; messages that cannot be decoded are counted.

    others: topics of transforms and poses; of those that hold for all time, all that is there. heads: cloud
    topics of which only the heads are read, so that damage behind these is not found.
    """
    static = tuple(name for name in others if is_static_topic(name))
    moving = tuple(name for name in others if name not in static)
    expected = Counter[str]()
    for topic in container.topics:
        if topic.name in (*cloud_topics, *others):
            expected[topic.name] += topic.count
    clouds, samples = _Rows(), Samples()
    read, broken = Counter[str](), Counter[str]()

    def advance() -> None:
        done = read.total()
        if progress is not None:
            progress(done, max(expected.total(), done))

    def add_others(messages: Iterator[tuple[Topic, int, Raw]]) -> None:
        for topic, _, raw in messages:
            read[topic.name] += 1
            _add_other(samples, topic, raw, broken)
            advance()

    def read_all(names: tuple[str, ...], of: Window) -> Iterator[tuple[Topic, int, Raw]]:
        if not heads:  # with every checksum looked at
            return container.messages(names, of.start, of.stop)
        whole = [name for name in names if name not in heads]
        return container.heads([name for name in names if name in heads], whole, of.start, of.stop)

    if window == Window():
        messages = read_all((*cloud_topics, *others), window)
    else:
        add_others(read_all(static, Window(None, window.beside.stop)))
        add_others(read_all(moving, window.beside))
        messages = read_all(cloud_topics, window)
    for topic, time, rank, raw in ranked(messages):
        index = read[topic.name]
        read[topic.name] += 1
        if topic.name in cloud_topics:
            _add_cloud(clouds, cloud_topics.index(topic.name), (time, rank, index), topic, raw, broken)
        else:
            _add_other(samples, topic, raw, broken)
        advance()
    known = expected if window == Window() else read
    return Survey(_headers(clouds), samples, _notices(known, read), dict(known - read), dict(broken))


def read_samples(path: Path, topic: str, window: Window) -> Samples:
    """The samples of one topic, for a log whose other ones turned out not to be enough."""
    samples = Samples()
    with open_container(path) as container:
        beside = window.beside
        for found, _, raw in container.messages([topic], beside.start, beside.stop):
            _add_other(samples, found, raw, Counter())
    return samples


def ranked(messages: Iterator[tuple[Topic, int, Raw]]) -> Iterator[tuple[Topic, int, int, Raw]]:
    """Messages with their rank among those of the topic with the same bag time: (topic, time, rank, raw)."""
    last: dict[str, tuple[int, int]] = {}
    for topic, time, raw in messages:
        before = last.get(topic.name)
        rank = before[1] + 1 if before is not None and before[0] == time else 0
        last[topic.name] = time, rank
        yield topic, time, rank, raw


def _add_other(samples: Samples, topic: Topic, raw: Raw, broken: Counter[str]) -> None:
    try:
        add_message(samples, topic, raw)
    except UndecodableError:
        broken[topic.name] += 1


def _add_cloud(
    clouds: _Rows, number: int, place: tuple[int, int, int], topic: Topic, raw: Raw, broken: Counter[str]
) -> None:
    beams, increment = 0, 0.0
    try:
        if role_of(topic) == "laser":
            scan = laser_scan(topic, raw)
            require_angles(scan)
            stamp, frame = scan.stamp, scan.frame
            beams, increment = len(scan.ranges), scan.time_increment
        else:
            found = head(topic, raw)
            stamp, frame = found.stamp, found.frame
    except UndecodableError as error:
        clouds.undecodable.append(place[0])
        clouds.why = clouds.why or str(error)
        broken[topic.name] += 1
        return
    clouds.rows.append((number, stamp, *place, beams))
    clouds.increments.append(increment)
    clouds.frames.append(sys.intern(frame))  # there are few, and one of each message


def _headers(clouds: _Rows) -> Headers:
    columns = np.array(clouds.rows, dtype=np.int64).reshape(-1, 6).T
    topics, stamps, bag_times, ranks, indices, beams = columns
    return Headers(
        topics=topics,
        stamps=stamps,
        bag_times=bag_times,
        ranks=ranks,
        indices=indices,
        frames=tuple(clouds.frames),
        beams=beams,
        increments=np.array(clouds.increments, dtype=np.float64),
        undecodable=tuple(clouds.undecodable),
        why=clouds.why,
    )


def _notices(expected: Counter[str], read: Counter[str]) -> tuple[str, ...]:
    return tuple(
        f"{name}: {read[name]} messages read, the log's own statistics say {expected[name]}"
        for name in sorted(expected)
        if read[name] > expected[name]
    )
