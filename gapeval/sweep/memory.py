"""Steps done once: equal step and equal arguments give the result that is there already."""

import time
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class Memory:
    """Remembers the steps of one frame, and how long each took.

    Arguments are compared by equality where they are plain values, by identity where they hold arrays:
    since results are remembered too, equal steps hand on identical arrays.
    """

    def __init__(self) -> None:
        self._results: dict[Any, Any] = {}
        self._spent: dict[str, list[float]] = {}

    def __call__(self, step: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        key = (step, args, tuple(kwargs.items()))
        if key not in self._results:
            begin = time.perf_counter()
            self._results[key] = step(*args, **kwargs)
            self._spent.setdefault(step.__name__, []).append(time.perf_counter() - begin)
        result: T = self._results[key]
        return result

    @property
    def spent(self) -> dict[str, list[float]]:
        """Seconds of each time a step was really done, by its name."""
        return self._spent
