"""Which labels were hit in a frame, looked up in labels.csv, which may be larger than memory."""

import csv
import mmap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gapeval.compare.outcome import LabelChange
from gapeval.errors import GapevalError
from gapeval.results.tables import LABEL_COLUMNS

States = Mapping[str, bool]  # of labels that were asked for, by id: whether they were hit
NOT_ASKED = "not asked for"
Key = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Line:
    key: Key
    cells: Sequence[str]


class LabelFile:
    """Its rows are in the order of logs, stamps and configurations, so that a frame is found by halving.

    logs, configurations: in that order.
    """

    def __init__(self, path: Path, logs: Sequence[str], configurations: Sequence[str]) -> None:
        self.path = path
        self._logs = {log: rank for rank, log in enumerate(logs)}
        self._configurations = {name: rank for rank, name in enumerate(configurations)}

    def states(self, log: str, stamp: int, configuration: str) -> States:
        """Of one frame. Raises GapevalError."""
        wanted = self._logs[log], stamp, self._configurations[configuration]
        found = {}
        for line in self._from(wanted):
            if line.key != wanted:
                break
            row = dict(zip(LABEL_COLUMNS, line.cells, strict=True))
            if row["hit"]:
                found[row["label"]] = row["hit"] == "true"
        return found

    def _from(self, wanted: Key) -> Iterator[Line]:
        """The lines from the first on that does not come before."""
        first, last = self._begin, len(self._text)
        while first < last:  # where the line begins that is looked for
            middle = self._line_at((first + last) // 2, first)
            line = self._line(middle)
            if line.key < wanted:
                first = self._end(middle)
            else:
                last = middle
        while first < len(self._text):
            yield self._line(first)
            first = self._end(first)

    def _line_at(self, place: int, first: int) -> int:
        """Where the line begins in which a place is."""
        return max(self._text.rfind(b"\n", first, place) + 1, first)

    def _end(self, begin: int) -> int:
        end = self._text.find(b"\n", begin)
        return len(self._text) if end < 0 else end + 1

    def _line(self, begin: int) -> Line:
        text = self._text[begin : self._end(begin)].decode("utf-8", "replace")
        try:
            (cells,) = csv.reader([text], strict=True)
            if len(cells) != len(LABEL_COLUMNS):
                raise ValueError("cells")
            return Line((self._logs[cells[0]], int(cells[1]), self._configurations[cells[2]]), cells)
        except (ValueError, KeyError, csv.Error) as error:
            raise GapevalError(f"{self.path}: not as gapeval writes it: {text.strip()[:60]!r}") from error

    @cached_property
    def _begin(self) -> int:
        """Behind the header."""
        end = self._end(0)
        if self._text[:end].decode("utf-8", "replace").strip() != ",".join(LABEL_COLUMNS):
            raise GapevalError(f"{self.path}: columns of another version; make it again")
        return end

    @cached_property
    def _text(self) -> mmap.mmap | bytes:
        try:
            with self.path.open("rb") as file:
                return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise GapevalError(f"{self.path}: cannot be read: {error}") from error


def label_changes(
    frames: Sequence[tuple[int, int]], before: Sequence[States], after: Sequence[States]
) -> tuple[LabelChange, ...]:
    """Labels by id, those that are missed now first. frames: index and stamp of each that is looked at."""
    found: dict[tuple[str, str, str], list[tuple[int, int]]] = {}
    for frame, was, now in zip(frames, before, after, strict=True):
        for label in sorted({*was, *now}):
            if was.get(label) != now.get(label):
                found.setdefault((label, _state(was, label), _state(now, label)), []).append(frame)
    changes = [
        LabelChange(*names, tuple(index for index, _ in each), tuple(stamp for _, stamp in each))
        for names, each in found.items()
    ]
    return tuple(sorted(changes, key=lambda change: (change.now != "missed", change.label, change.was)))


def _state(states: States, label: str) -> str:
    if label not in states:
        return NOT_ASKED
    return "hit" if states[label] else "missed"
