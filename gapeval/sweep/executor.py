"""Units to workers and back: in this process, or in several. A cluster's workers are in `cluster`."""

import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread, current_thread, main_thread
from typing import Any, Generic, TypeVar

import cv2

from gapeval.errors import GapevalError
from gapeval.files import write_whole

T = TypeVar("T")  # what all units have in common: for a sweep, its Task
U = TypeVar("U")  # a unit
Stopped = Callable[[], bool]
Work = Callable[[T, U, Stopped], bytes]
Submit = Callable[[U], "Future[bytes]"]


@dataclass(frozen=True, slots=True)
class Workers(Generic[U]):
    """Who does the work. begin: ready to be given units until it is left; at_once: units in their hands."""

    begin: Callable[[], AbstractContextManager[Submit[U]]]
    at_once: int


@dataclass(frozen=True, slots=True, eq=False)
class Finished(Generic[U]):
    """What became of a unit: what the work made of it, or why there is nothing."""

    unit: U
    made: bytes = b""
    error: Exception | None = None


class WorkerDiedError(GapevalError):
    """A unit after which its worker was gone."""


class WrongWorkersError(GapevalError):
    """Of the workers, not of the unit: the sweep must not go on with them."""


def results(workers: Workers[U], units: Sequence[U]) -> Generator[Finished[U], None, None]:
    """Each unit as it is finished; only so many are in hands at a time that memory stays flat.

    Where a worker dies, the units that it may have died of are given to others one at a time, until one
    is alone with a worker that dies: that one has failed.
    """
    waiting, suspects = deque(units), deque[U]()
    while waiting or suspects:
        with workers.begin() as submit:
            if not suspects:
                suspects.extend((yield from _work_off(submit, waiting, workers.at_once)))
            elif lost := (yield from _work_off(submit, suspects, 1)):
                died = WorkerDiedError("its worker died, perhaps for want of memory; use fewer --jobs")
                yield Finished(lost[0], error=died)
                waiting.extendleft(reversed(suspects))
                suspects.clear()


def _work_off(submit: Submit[U], waiting: deque[U], at_once: int) -> Generator[Finished[U], None, list[U]]:
    """Until no unit is waiting or a worker dies; returns the units that were in hands then."""
    pending: dict[Future[bytes], U] = {}
    lost: list[U] = []
    while pending or (waiting and not lost):
        while waiting and not lost and len(pending) < at_once:
            unit = waiting.popleft()
            try:
                pending[submit(unit)] = unit
            except BrokenProcessPool:
                lost.append(unit)
        done, _ = wait(pending, return_when=FIRST_COMPLETED)
        for future in done:
            unit = pending.pop(future)
            error = future.exception()
            if isinstance(error, BrokenProcessPool):
                lost.append(unit)
            elif isinstance(error, WrongWorkersError):
                raise error
            elif isinstance(error, Exception):
                yield Finished(unit, error=error)
            else:
                yield Finished(unit, future.result())
    return lost


def in_this_process(work: Work[T, U], task: T) -> Workers[U]:
    """One unit at a time."""

    def submit(unit: U) -> "Future[bytes]":
        future: Future[bytes] = Future()
        try:
            future.set_result(work(task, unit, lambda: False))
        except Exception as error:
            future.set_exception(error)
        return future

    @contextmanager
    def begin() -> Iterator[Submit[U]]:
        one_thread()
        yield submit

    return Workers(begin, 1)


def on_this_machine(work: Work[T, U], task: T, jobs: int) -> Workers[U]:
    """In this process if it is to be one."""
    return in_processes(work, task, jobs) if jobs > 1 else in_this_process(work, task)


def in_processes(work: Work[T, U], task: T, jobs: int) -> Workers[U]:
    """So many processes. When it is left, they end with the frames that they are at."""

    @contextmanager
    def begin() -> Iterator[Submit[U]]:
        # Spawned: OpenCV hangs in processes that were forked. A plain byte: one that dies holds no lock.
        context = get_context("spawn")
        stop = context.RawValue("b", 0)
        with TemporaryDirectory() as folder, _one_interrupt():
            # By a file: what is told to a process at its start must fit in a pipe, or whoever tells it to one
            # that dies waits for good.
            order = Path(folder) / "order"
            write_whole(order, pickle.dumps((work, task)))
            pool = ProcessPoolExecutor(jobs, context, initializer=_begin_worker, initargs=(order, stop))
            try:
                yield lambda unit: _submit(pool, unit)
            finally:
                stop.value = 1
                # A pool whose workers are killed can hang for good.
                pool.shutdown(wait=True, cancel_futures=True)

    return Workers(begin, 2 * jobs)


@contextmanager
def _one_interrupt() -> Iterator[None]:
    """The first Ctrl-C interrupts; others do nothing until this is left, in good order."""
    if current_thread() is not main_thread():
        yield
        return

    def interrupt(number: int, _: object) -> None:
        signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _submit(pool: ProcessPoolExecutor, unit: Any) -> "Future[bytes]":
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
        if interrupts and callable(handler):
            handler(signal.SIGINT, None)


_own: tuple[Work[Any, Any], Any, Any]  # of a worker process


def _begin_worker(order: Path, stop: Any) -> None:
    global _own
    Thread(target=_end_with_parent, daemon=True).start()
    work, task = pickle.loads(order.read_bytes())  # our parent's
    _own = work, task, stop
    one_thread()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for units for good."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _work(unit: Any) -> bytes:
    work, task, stop = _own
    return work(task, unit, lambda: bool(stop.value))


def one_thread() -> None:
    """One thread per process: with many frames, processes share the cores better."""
    cv2.setNumThreads(1)
