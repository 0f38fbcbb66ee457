"""Equal work done once, and the time that each step took."""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
Row = TypeVar("Row", bound=tuple[Any, ...])


class Share:
    """Does each distinct step once.

    Arguments that are plain values are equal by value, those that hold arrays by identity: since equal
    steps give the same result, they hand on identical arrays.
    spent: seconds of each time a step was really done, by its name.
    """

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {}
        self._results: dict[Any, Any] = {}

    def __call__(self, step: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """The step's result, which may be there already."""
        key = (step, args, tuple(kwargs.items())) if kwargs else (step, args)
        if key not in self._results:
            begin = time.perf_counter()
            self._results[key] = step(*args, **kwargs)
            self._took(step, begin)
        result: T = self._results[key]
        return result

    def timed(self, step: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """A step that is never done twice."""
        begin = time.perf_counter()
        result = step(*args, **kwargs)
        self._took(step, begin)
        return result

    def together(self, step: Callable[[Sequence[Row]], Sequence[T]], rows: Iterable[Row]) -> list[T]:
        """A result for each row, from a step that takes all distinct rows at a time."""
        asked = list(rows)
        place: dict[Row, int] = {}
        places = [place.setdefault(row, len(place)) for row in asked]
        begin = time.perf_counter()
        results = step(list(place))
        self._took(step, begin)
        return [results[index] for index in places]

    def _took(self, step: Callable[..., object], begin: float) -> None:
        name: str = getattr(step, "__name__", "step")
        self.spent.setdefault(name, []).append(time.perf_counter() - begin)
