"""A sweep in units: a few frames of one log under some configurations, read once and evaluated in order."""

import threading
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

from gapeval.errors import LogError
from gapeval.frame import Frame
from gapeval.labels import Labels
from gapeval.logs.read import LOST, Recording, RefusedScan, is_costly_to_open, read_frames
from gapeval.sweep.evaluation import Answers, Question, evaluate
from gapeval.sweep.provenance import content_sample

UNITS = 64  # of a sweep; never by the number of workers, so that another number finds the same units
LARGEST_UNIT = 16  # frames; small enough that little is lost, and that a part fits in memory
# Of a log that each unit must read to its end: without an index, 3 s for each GB.
COSTLY_UNITS, LARGEST_COSTLY_UNIT = 16, 64


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A whole sweep. names: what each log is called in the results. labels: of each recording, or None.

    keys: what the parts of each recording are made from, see results.parts. contents: a sample of each log,
    by which it is noticed if that changes; none where it need not be.
    """

    recordings: tuple[Recording, ...]
    names: tuple[str, ...]
    labels: tuple[Labels | None, ...]
    question: Question
    keys: tuple[str, ...] = ()
    contents: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Span:
    """Frames [first, last) of a recording."""

    recording: int
    first: int
    last: int

    def __len__(self) -> int:
        return self.last - self.first


@dataclass(frozen=True, slots=True)
class Unit:
    """What one worker does at a time. configurations: their places in the task's."""

    span: Span
    configurations: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class EvaluatedFrame:
    """One frame of a recording: its answers, or why it was refused when it was read.

    points, dropped: how many the cloud has, and how many of it were left out. spent: seconds of each time
    that a step was done, by its name.
    """

    stamp: int
    refusal: str = ""
    digest: bytes = b""
    points: int = 0
    dropped: int = 0
    answers: Answers | None = None
    spent: dict[str, list[float]] = field(default_factory=dict)


class StoppedError(Exception):
    """The sweep was stopped in the middle of a unit."""


def split(task: Task) -> list[Span]:
    """All frames, in order, in spans that do not depend on the number of workers."""
    total = sum(len(recording.scans) for recording in task.recordings)
    usual = _size(total, UNITS, LARGEST_UNIT)
    spans = []
    for index, recording in enumerate(task.recordings):
        frames = len(recording.scans)
        costly = is_costly_to_open(recording.path)
        size = max(usual, _size(frames, COSTLY_UNITS, LARGEST_COSTLY_UNIT)) if costly else usual
        spans += [Span(index, first, min(first + size, frames)) for first in range(0, frames, size)]
    return spans


def _size(frames: int, units: int, largest: int) -> int:
    return max(1, min(largest, -(-frames // units)))


def run_unit(task: Task, unit: Unit, stopped: Callable[[], bool]) -> Iterator[EvaluatedFrame]:
    """Read and evaluate the frames of one unit.

    Raises StoppedError between two frames, and LogError if the log has changed meanwhile.
    """
    span, chosen = unit.span, task.question.configurations
    recording, labels = task.recordings[span.recording], task.labels[span.recording]
    question = replace(task.question, configurations=tuple(chosen[index] for index in unit.configurations))
    with closing(read_ahead(recording, span)) as frames:
        for frame, read in frames:
            if stopped():
                raise StoppedError
            if isinstance(frame, Frame):
                answers, spent = evaluate(frame, question, labels, recording.robot_frame)
                yield EvaluatedFrame(
                    stamp=frame.stamp,
                    digest=frame.digest,
                    points=len(frame.points) + frame.dropped,
                    dropped=frame.dropped,
                    answers=answers,
                    spent={"read": [read]} | spent,
                )
            elif frame.reason == LOST:
                raise _changed(recording)
            else:
                yield EvaluatedFrame(frame.stamp, refusal=str(frame))
    if task.contents and content_sample(recording.path) != task.contents[span.recording]:
        raise _changed(recording)


def _changed(recording: Recording) -> LogError:
    what = "has changed since the sweep began" if recording.path.exists() else "no such file any more"
    return LogError(f"{recording.path}: {what}; keep it as it is while it is swept")


def read_ahead(recording: Recording, span: Span) -> Generator[tuple[Frame | RefusedScan, float], None, None]:
    """The frames of a span and the seconds that each took to read: the next while one is worked at."""
    frames: Any = read_frames(recording, span.first, span.last)

    def read() -> tuple[Frame | RefusedScan, float] | None:
        begin = time.perf_counter()
        frame = next(frames, None)
        return None if frame is None else (frame, time.perf_counter() - begin)

    reader = _reader()
    following = reader.submit(read)
    try:
        while (item := following.result()) is not None:
            following = reader.submit(read)
            yield item
    finally:
        reader.submit(frames.close).result()  # the thread that opens a log must also close it


_own = threading.local()


def _reader() -> ThreadPoolExecutor:
    """One thread that reads for this one, for good: what a new thread allocates is slow at first."""
    if not hasattr(_own, "reader"):
        _own.reader = ThreadPoolExecutor(1)
    reader: ThreadPoolExecutor = _own.reader
    return reader
