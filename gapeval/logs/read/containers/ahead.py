"""Work on what comes next while the last of it is used."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

THREADS = 2
AHEAD = 3  # pieces that are ready or being made, besides the one in use

Item = TypeVar("Item")
Made = TypeVar("Made")


@contextmanager
def ahead(make: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Iterator[tuple[Item, Made]]]:
    """(item, what is made of it), in order, made by threads: decompression and checksums let others run.

    What make raises is raised here, when its item's turn has come.
    """
    with ThreadPoolExecutor(THREADS) as executor:
        try:
            yield _made(executor, make, items)
        finally:
            executor.shutdown(cancel_futures=True)


@contextmanager
def in_turn(make: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Iterator[tuple[Item, Made]]]:
    """The same without threads, for what takes less than it takes to hand it over."""
    yield ((item, make(item)) for item in items)


def _made(
    executor: ThreadPoolExecutor, make: Callable[[Item], Made], items: Iterable[Item]
) -> Iterator[tuple[Item, Made]]:
    left = iter(items)
    waiting: deque[tuple[Item, Future[Made]]] = deque(
        (item, executor.submit(make, item)) for item in islice(left, AHEAD)
    )
    while waiting:
        item, future = waiting.popleft()
        made = future.result()
        waiting.extend((following, executor.submit(make, following)) for following in islice(left, 1))
        yield item, made
        # Not held here until the next is made.
        del made, future
