"""All frames of all logs, in order, by one process or by many."""

import signal
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from threading import current_thread, main_thread

import cv2

from gapeval.errors import GapevalError
from gapeval.frame import Frame
from gapeval.labels import Labels
from gapeval.logs.read import Recording, frame_digest, read_frames
from gapeval.sweep.evaluation import Answers, Question, evaluate

LARGEST_UNIT = 16  # frames; small enough for a live progress bar
UNITS_PER_WORKER = 4


@dataclass(frozen=True, slots=True)
class Task:
    """A whole sweep. labels: of each recording, or None."""

    recordings: tuple[Recording, ...]
    labels: tuple[Labels | None, ...]
    question: Question


@dataclass(frozen=True, slots=True)
class Unit:
    """Frames [first, last) of a recording."""

    recording: int
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class EvaluatedFrame:
    """One frame of a recording: its answers, or why it was refused when it was read.

    points, dropped: how many the cloud has, and how many of it were left out. spent: seconds of each time
    that a step was done, by its name.
    """

    recording: int
    stamp: int
    refusal: str = ""
    digest: bytes = b""
    points: int = 0
    dropped: int = 0
    answers: Answers | None = None
    spent: dict[str, list[float]] = field(default_factory=dict)


def run(task: Task, jobs: int) -> Iterator[EvaluatedFrame]:
    """The frames of all recordings, in order of recording and stamp, whatever the number of processes."""
    one_thread()
    units = split(task, jobs)
    if jobs == 1 or len(units) == 1:
        for unit in units:
            yield from run_unit(task, unit)
        return
    for frames in _run_in_processes(task, units, min(jobs, len(units))):
        yield from frames


def split(task: Task, jobs: int) -> list[Unit]:
    """Units small enough that all workers have something to do until the end."""
    total = sum(len(recording.scans) for recording in task.recordings)
    size = max(1, min(LARGEST_UNIT, -(-total // (jobs * UNITS_PER_WORKER))))
    return [
        Unit(index, first, min(first + size, len(recording.scans)))
        for index, recording in enumerate(task.recordings)
        for first in range(0, len(recording.scans), size)
    ]


def run_unit(task: Task, unit: Unit) -> Iterator[EvaluatedFrame]:
    """Read and evaluate the frames of one unit."""
    recording, labels = task.recordings[unit.recording], task.labels[unit.recording]
    begin = time.perf_counter()
    for frame in read_frames(recording, unit.first, unit.last):
        read = time.perf_counter() - begin
        if isinstance(frame, Frame):
            answers, spent = evaluate(frame, task.question, labels, recording.robot_frame)
            yield EvaluatedFrame(
                recording=unit.recording,
                stamp=frame.stamp,
                digest=frame_digest(frame),
                points=len(frame.points) + frame.dropped,
                dropped=frame.dropped,
                answers=answers,
                spent={"read": [read]} | spent,
            )
        else:
            yield EvaluatedFrame(unit.recording, frame.stamp, refusal=str(frame))
        begin = time.perf_counter()


def _run_in_processes(task: Task, units: list[Unit], jobs: int) -> Iterator[list[EvaluatedFrame]]:
    """Results in the order of the units; only so many units wait at a time that memory stays flat."""
    # Spawned: OpenCV hangs in processes that were forked.
    pool = ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_begin_worker, initargs=(task,))
    pending: deque[Future[list[EvaluatedFrame]]] = deque()
    waiting = iter(units)
    try:
        for unit in waiting:
            pending.append(_submit(pool, unit))
            if len(pending) > 2 * jobs:
                yield pending.popleft().result()
        while pending:
            yield pending.popleft().result()
    except BrokenProcessPool as error:
        raise GapevalError("a worker process died, perhaps for want of memory; use fewer --jobs") from error
    finally:
        # Workers end the frames that they are at: a pool whose workers are killed can hang for good.
        pool.shutdown(wait=True, cancel_futures=True)


def _submit(pool: ProcessPoolExecutor, unit: Unit) -> Future[list[EvaluatedFrame]]:
    """Ctrl-C waits until the pool is in order again, and never reaches a worker that this starts."""
    if current_thread() is not main_thread():
        return pool.submit(_work, unit)
    interrupts: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which a new process inherits
    try:
        return pool.submit(_work, unit)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, handler)
        if interrupts:
            raise KeyboardInterrupt


_task: Task  # of a worker process


def _begin_worker(task: Task) -> None:
    global _task
    _task = task
    one_thread()


def _work(unit: Unit) -> list[EvaluatedFrame]:
    return list(run_unit(_task, unit))


def one_thread() -> None:
    """One thread per process: with many frames, processes share the cores better."""
    cv2.setNumThreads(1)
