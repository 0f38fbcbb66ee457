"""One of the two that are compared: a folder of results, its summary.csv, or a baseline."""

import math
import shlex
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gapeval.compare.baseline import Baseline, is_baseline, read_baseline
from gapeval.compare.frames import LogFrames, read_frames
from gapeval.compare.labels import LabelFile, States
from gapeval.compare.limits import TIME
from gapeval.compare.origin import checked, failed, frames, origin, scoring
from gapeval.compare.outcome import Origin, Spread
from gapeval.errors import GapevalError
from gapeval.results.parts import is_unfinished
from gapeval.results.store import ALL, MANIFEST
from gapeval.results.tables import FRAMES, LABELS, PARAMETERS, SUMMARY, TIMING, TIMING_COLUMNS
from gapeval.results.written import Row, read_json, read_rows

NAMED_BY = ("log", "configuration")


class Record(Protocol):
    """What is known of single frames. unknown: why nothing is, or empty."""

    @property
    def unknown(self) -> str: ...

    def frames(self, configurations: Collection[str]) -> dict[str, LogFrames]:
        """Of these configurations, by log. Raises GapevalError."""

    def states(self, log: str, stamp: int, configuration: str) -> States:
        """Of each label that was asked for, whether it was hit. Raises GapevalError."""


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """Figures, and what they were made from.

    scoring: None where it is not known what they were made from. By log: frames, how many; failed, why some
    are missing; times, of each stage.
    """

    origin: Origin
    scoring: Mapping[str, Any] | None
    frames: Mapping[str, int]
    failed: Mapping[str, str]
    rows: tuple[Row, ...]
    times: Mapping[str, Mapping[str, Spread]]
    record: Record

    @property
    def is_baseline(self) -> bool:
        return isinstance(self.record, Baseline)

    @property
    def logs(self) -> frozenset[str]:
        return frozenset(row["log"] for row in self.rows if row["log"] != ALL)


def read_side(path: Path) -> Side:
    """Raises GapevalError."""
    if not path.exists():
        make_it = f"gapeval baseline DIR -o {shlex.quote(str(path))}"
        raise GapevalError(f"{path}: is not there; name a folder of results, or make a baseline: {make_it}")
    if not path.is_dir() and is_baseline(path):
        return _of_baseline(path, read_baseline(path))
    if path.is_dir():
        return _of_folder(path, path)
    beside = path.name == SUMMARY and (path.parent / MANIFEST).exists()
    return _of_folder(path, path.parent) if beside else _of_table(path)


def _of_folder(given: Path, folder: Path) -> Side:
    if is_unfinished(folder):
        raise GapevalError(
            f"{folder}: a sweep into it was not finished: gapeval sweep --resume {shlex.quote(str(folder))}"
        )
    manifest = checked(folder / MANIFEST, read_json(folder / MANIFEST))
    table = folder / SUMMARY
    if not table.exists():
        raise GapevalError(f"{folder}: no {SUMMARY}; name the folder of a sweep or a score")
    rows = _rows(table)
    order = [tuple(dict.fromkeys(row[name] for row in rows)) for name in NAMED_BY]
    record = Folder(folder, LabelFile(folder / LABELS, *order))
    timing = folder / TIMING
    times = _times(timing, tuple(read_rows(timing, TIMING_COLUMNS))) if timing.exists() else {}
    return Side(
        origin(given, manifest), scoring(manifest), frames(manifest), failed(manifest), rows, times, record
    )


def _of_baseline(path: Path, baseline: Baseline) -> Side:
    manifest = checked(path, baseline.manifest)
    found = origin(path, manifest, baseline.history)
    rows = _each_once(path, baseline.rows)
    return Side(found, scoring(manifest), frames(manifest), {}, rows, {}, baseline)


def _of_table(path: Path) -> Side:
    """A table by itself, of which nothing says what it was made from."""
    return Side(origin(path, {}), None, {}, {}, _rows(path), {}, Nothing())


def _rows(path: Path) -> tuple[Row, ...]:
    rows = tuple(read_rows(path))
    if not rows:
        raise GapevalError(f"{path}: no rows; run the sweep again")
    if not {*NAMED_BY, PARAMETERS[0]} <= rows[0].keys() or "stamp" in rows[0]:
        raise GapevalError(f"{path}: no results; name a folder of results, its {SUMMARY}, or a baseline")
    return _each_once(path, rows)


def _each_once(path: Path, rows: tuple[Row, ...]) -> tuple[Row, ...]:
    """The same rows. Of two for one thing the worse could be hidden by the other. Raises GapevalError."""
    named = Counter(tuple(row[name] for name in NAMED_BY) for row in rows)
    twice = [", ".join(name) for name, count in named.items() if count > 1]
    if twice:
        raise GapevalError(f"{path}: the row of {twice[0]} is there twice; make it again")
    return rows


def _times(path: Path, rows: tuple[Row, ...]) -> dict[str, dict[str, Spread]]:
    """Seconds of each stage, as it is done, and of all of them for one configuration in one frame."""
    found: dict[str, dict[str, Spread]] = {}
    for log in dict.fromkeys(row["log"] for row in rows):
        of_log = [row for row in rows if row["log"] == log]
        stages = {
            row["stage"]: (_spread(path, row), _seconds(path, row, "shared_by") or 1.0) for row in of_log
        }
        whole = Spread(
            sum(spread.median / shared for spread, shared in stages.values()),
            sum(spread.p95 / shared for spread, shared in stages.values()),
            max(spread.frames for spread, _ in stages.values()),
        )
        found[log] = {TIME: whole} | {stage: spread for stage, (spread, _) in stages.items()}
    return found


def _spread(path: Path, row: Row) -> Spread:
    median, p95, frames = (_seconds(path, row, name) for name in ("median", "p95", "frames"))
    return Spread(median, p95, int(frames))


def _seconds(path: Path, row: Row, name: str) -> float:
    """Or a number of them. What is no number is over no limit, so it is refused. Raises GapevalError."""
    text = row[name]
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not 0 <= found < math.inf:
        raise GapevalError(f"{path}: {name} of {row['stage']} is {text or 'missing'}; make it again")
    return found


@dataclass(frozen=True, slots=True)
class Folder:
    """The frames of a folder of results."""

    folder: Path
    labels: LabelFile

    @property
    def unknown(self) -> str:
        missing = [name for name in (FRAMES, LABELS) if not (self.folder / name).exists()]
        return f"{self.folder / missing[0]} is missing" if missing else ""

    def frames(self, configurations: Collection[str]) -> dict[str, LogFrames]:
        return read_frames(self.folder / FRAMES, 0, configurations)

    def states(self, log: str, stamp: int, configuration: str) -> States:
        return self.labels.states(log, stamp, configuration)


@dataclass(frozen=True, slots=True)
class Nothing:
    """No frames are known."""

    unknown: str = "only the table is there, not its folder"

    def frames(self, configurations: Collection[str]) -> dict[str, LogFrames]:
        return {}

    def states(self, log: str, stamp: int, configuration: str) -> States:
        return {}
