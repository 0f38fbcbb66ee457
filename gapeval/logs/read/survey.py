"""One pass through a log: everything but the points of its clouds."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gapeval.logs.read.container import Container, Topic
from gapeval.logs.read.content import UndecodableError, head, pose, transforms
from gapeval.logs.read.opening import open_container
from gapeval.logs.read.samples import Samples, add_transforms

Progress = Callable[[int, int], None]

UNDECODABLE = "message cannot be decoded"


@dataclass(frozen=True, slots=True, eq=False)
class CloudHeaders:
    """What the headers of a topic's clouds say, in the order of the log.

    stamps: (n,) header stamps [ns]; bag_times: (n,) [ns]; ranks: (n,) place among the messages of the topic
    with the same bag time; indices: (n,) place among all messages of the topic; frames: (n,) frame_id.
    undecodable: bag times of the messages that are no clouds; why: an example.
    """

    stamps: NDArray[np.int64]
    bag_times: NDArray[np.int64]
    ranks: NDArray[np.int64]
    indices: NDArray[np.int64]
    frames: tuple[str, ...]
    undecodable: tuple[int, ...] = ()
    why: str = ""

    @property
    def total(self) -> int:
        return len(self.stamps) + len(self.undecodable)


@dataclass(slots=True)
class _Rows:
    rows: list[tuple[int, int, int, int]] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)
    undecodable: list[int] = field(default_factory=list)
    why: str = ""
    read: int = 0
    last: int | None = None
    rank: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    headers: CloudHeaders
    samples: Samples
    notices: tuple[str, ...]


def take_survey(
    container: Container,
    cloud_topic: str | None,
    tf: tuple[str, ...],
    poses: tuple[str, ...],
    progress: Progress | None,
) -> Survey:
    """Reads tf, poses and the headers of the clouds; messages that cannot be decoded are counted."""
    names = {name for name in (cloud_topic, *tf, *poses) if name is not None}
    expected = {topic.name: 0 for topic in container.topics if topic.name in names}
    for topic in container.topics:
        if topic.name in names:
            expected[topic.name] += topic.count
    total = sum(expected.values())
    clouds, samples = _Rows(), Samples()
    read: Counter[str] = Counter()
    broken: Counter[str] = Counter()
    for done, (topic, time, raw) in enumerate(container.messages(names, None, None), start=1):
        read[topic.name] += 1
        try:
            if topic.name == cloud_topic:
                _add_cloud(clouds, topic, time, raw)
            elif topic.name in tf:
                add_transforms(samples, topic.name, transforms(topic, raw))
            else:
                add_transforms(samples, topic.name, [pose(topic, raw)])
        except UndecodableError:
            broken[topic.name] += 1
        if progress is not None:
            progress(done, max(total, done))
    return Survey(_headers(clouds), samples, _notices(expected, read, broken))


def read_poses(path: Path, topic: str) -> Samples:
    """The samples of one pose topic, for a log whose tf turned out not to connect its frames."""
    samples = Samples()
    with open_container(path) as container:
        for found, _, raw in container.messages([topic], None, None):
            try:
                add_transforms(samples, topic, [pose(found, raw)])
            except UndecodableError:
                continue
    return samples


def ranked(
    messages: Iterator[tuple[Topic, int, bytes | memoryview]],
) -> Iterator[tuple[int, int, Topic, bytes | memoryview]]:
    """(bag time, rank among those with this bag time, topic, raw) of one topic's messages."""
    last, rank = None, 0
    for topic, time, raw in messages:
        rank = rank + 1 if time == last else 0
        last = time
        yield time, rank, topic, raw


def _add_cloud(clouds: _Rows, topic: Topic, time: int, raw: bytes | memoryview) -> None:
    clouds.rank = clouds.rank + 1 if time == clouds.last else 0
    clouds.last = time
    index = clouds.read
    clouds.read += 1
    try:
        found = head(topic, raw)
    except UndecodableError as error:
        clouds.undecodable.append(time)
        clouds.why = clouds.why or str(error)
        return
    clouds.rows.append((found.stamp, time, clouds.rank, index))
    clouds.frames.append(found.frame)


def _headers(clouds: _Rows) -> CloudHeaders:
    columns = np.array(clouds.rows, dtype=np.int64).reshape(-1, 4).T
    stamps, bag_times, ranks, indices = columns
    return CloudHeaders(
        stamps, bag_times, ranks, indices, tuple(clouds.frames), tuple(clouds.undecodable), clouds.why
    )


def _notices(expected: dict[str, int], read: Counter[str], broken: Counter[str]) -> tuple[str, ...]:
    notices = []
    for name in sorted(expected):
        if read[name] != expected[name]:
            notices.append(
                f"{name}: {read[name]} messages read, the log's own statistics say {expected[name]}"
            )
        if broken[name]:
            notices.append(
                f"{name}: {broken[name]} of {read[name]} messages cannot be decoded and are left out"
            )
    return tuple(notices)
