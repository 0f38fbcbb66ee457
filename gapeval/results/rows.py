"""Rows of the files that have one for each frame and configuration, as text: made where it is evaluated."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np

from gapeval.frame import FloatArray
from gapeval.results import tables
from gapeval.scoring.metrics import SUMS, WITHOUT_LABELS
from gapeval.sweep.evaluation import Answers

T = TypeVar("T")
COUNTS = [str(count) for count in range(1000)]
SCORED = tuple(SUMS).index("scored_frames")


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows of one frame in each file, those of one configuration in one text."""

    frames: list[str]
    labels: list[str]
    gaps: list[str]


def rows_of(log: str, stamp: int, ids: Sequence[str], answers: Answers) -> Rows:
    """The rows of one frame under the configurations with these ids."""
    heads = [f"{quoted(log)},{stamp},{quoted(name)}," for name in ids]
    fallbacks = map(quoted, answers.fallbacks)
    pose = ",".join(map(_field, tables.pose_row(answers.quality)))
    frames = [
        f"{head}{fallback},{pose},{sums}\n"
        for head, fallback, sums in zip(heads, fallbacks, _sums(answers.sums), strict=True)
    ]
    return Rows(
        frames,
        _several(heads, answers.labels, tables.label_rows),
        _several(heads, answers.gaps, tables.gap_rows),
    )


def _sums(sums: FloatArray) -> Iterable[str]:
    """The sums (C, len(SUMS)) of each configuration, column by column: most columns hold one value."""
    shown = SUMS if sums[:, SCORED].any() else WITHOUT_LABELS
    bits = np.ascontiguousarray(sums).view(np.int64)
    constant = (bits == bits[:1]).all(axis=0).tolist()
    columns: list[Iterable[str]] = []
    for index, name in enumerate(SUMS):
        if name not in shown:
            columns.append([""] * len(sums))
        elif constant[index]:
            columns.append(_texts(name, sums[:1, index]) * len(sums))
        else:
            columns.append(_texts(name, sums[:, index]))
    return map(",".join, zip(*columns, strict=True))


def _texts(name: str, column: FloatArray) -> list[str]:
    if tables.is_real(name):
        return list(map(repr, column.tolist()))
    counts = column.astype(np.int64).tolist()
    return list(map(COUNTS.__getitem__ if max(counts) < len(COUNTS) else str, counts))


def _several(
    heads: Sequence[str],
    found: Sequence[tuple[T, ...]],
    rows: Callable[[Iterable[T]], Iterable[Iterable[object]]],
) -> list[str]:
    """Several rows, or none, for each configuration; equal answers are often the same object."""
    known: dict[int, list[str]] = {}
    texts = []
    for head, one in zip(heads, found, strict=True):
        if id(one) not in known:
            known[id(one)] = [",".join(map(_field, row)) + "\n" for row in rows(one)]
        texts.append("".join([head + row for row in known[id(one)]]))
    return texts


def _field(value: object) -> str:
    if type(value) is float and value:  # a zero may have a sign, which equal floats would share
        return _real(value)
    return quoted(value) if isinstance(value, str) else str(tables.cell(value))


# Of a label or gap, most figures are the same under many configurations.
_real = lru_cache(1 << 14)(repr)


@lru_cache(4096)
def quoted(text: str) -> str:
    """A text as it stands in a CSV file."""
    if not text:
        return ""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow([text])
    return line.getvalue()[:-1]
