"""Rows of unequal lengths, kept in one array."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


def spans(first: IndexArray, count: IndexArray) -> tuple[IndexArray, IndexArray]:
    """All places first ... first + count - 1 of each span, one after the other, and which span each is of."""
    of = np.repeat(np.arange(len(count)), count)
    return np.arange(len(of)) + np.repeat(first - np.cumsum(count) + count, count), of


def sums(values: NDArray[Any], owner: IndexArray, count: int) -> FloatArray:
    """Sums of values (N, ...) over what each of `count` owns, one after the other, (count, ...)."""
    total = np.zeros((count, *values.shape[1:]))
    for place in np.ndindex(values.shape[1:]):
        total[:, *place] = np.bincount(owner, weights=values[:, *place], minlength=count)
    return total


def distinct(rows: Sequence[NDArray[np.object_]]) -> tuple[NDArray[np.object_], list[IndexArray]]:
    """The objects that rows hold, each once, known by identity; and of each row, which ones it holds."""
    number: dict[int, int] = {}
    found: list[object] = []
    which = []
    for row in rows:
        places = []
        for item in row:
            place = number.setdefault(id(item), len(found))
            if place == len(found):
                found.append(item)
            places.append(place)
        which.append(np.array(places, dtype=np.intp))
    objects = np.empty(len(found), dtype=object)
    objects[:] = found
    return objects, which
