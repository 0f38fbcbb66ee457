"""One of the two that are compared: a folder of results, its summary.csv, or a baseline."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gapeval.compare.baseline import Baseline, is_baseline, read_baseline
from gapeval.compare.frames import LogFrames, read_frames
from gapeval.compare.labels import LabelFile, States
from gapeval.compare.limits import TIME
from gapeval.compare.outcome import Origin, Spread
from gapeval.errors import GapevalError
from gapeval.results.store import ALL, MANIFEST
from gapeval.results.tables import FRAMES, LABELS, SUMMARY, TIMING, TIMING_COLUMNS
from gapeval.results.written import Row, number, read_json, read_rows

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
    def logs(self) -> frozenset[str]:
        return frozenset(row["log"] for row in self.rows if row["log"] != ALL)


def read_side(path: Path) -> Side:
    """Raises GapevalError."""
    if path.is_file() and is_baseline(path):
        return _of_baseline(path, read_baseline(path))
    if path.is_dir():
        return _of_folder(path, path, read_json(path / MANIFEST))
    beside = path.name == SUMMARY and (path.parent / MANIFEST).exists()
    return _of_folder(path, path.parent, read_json(path.parent / MANIFEST)) if beside else _of_table(path)


def _of_folder(given: Path, folder: Path, manifest: Mapping[str, Any]) -> Side:
    table = folder / SUMMARY
    if not table.exists():
        raise GapevalError(f"{folder}: no {SUMMARY}; name the folder of a sweep or a score")
    rows = _rows(table)
    failed = {
        str(entry.get("log")): f"{entry.get('frames')} frames failed: {entry.get('reason')}"
        for entry in manifest.get("failed") or ()
    }
    order = [tuple(dict.fromkeys(row[name] for row in rows)) for name in NAMED_BY]
    record = Folder(folder, LabelFile(folder / LABELS, *order))
    timing = folder / TIMING
    times = _times(tuple(read_rows(timing, TIMING_COLUMNS))) if timing.exists() else {}
    return Side(origin(given, manifest), _scoring(manifest), _frames(manifest), failed, rows, times, record)


def _of_baseline(path: Path, baseline: Baseline) -> Side:
    found = origin(path, baseline.manifest, baseline.history)
    return Side(
        found, _scoring(baseline.manifest), _frames(baseline.manifest), {}, baseline.rows, {}, baseline
    )


def _of_table(path: Path) -> Side:
    """A table by itself, of which nothing says what it was made from."""
    return Side(origin(path, {}), None, {}, {}, _rows(path), {}, Nothing())


def _rows(path: Path) -> tuple[Row, ...]:
    rows = tuple(read_rows(path, NAMED_BY))
    if not rows:
        raise GapevalError(f"{path}: no rows; run the sweep again")
    return rows


def origin(path: Path, manifest: Mapping[str, Any], history: tuple[Mapping[str, Any], ...] = ()) -> Origin:
    logs = [entry for entry in manifest.get("logs") or () if isinstance(entry, dict)]
    gapeval, revision, source, scorer = (
        str(manifest.get(name) or "") for name in ("gapeval", "revision", "source", "scorer")
    )
    return Origin(
        str(path),
        gapeval,
        revision,
        source,
        scorer,
        logs={str(entry.get("log")): str(entry.get("sha256") or "") for entry in logs},
        labels={str(entry.get("log")): str(entry.get("labels") or "") for entry in logs},
        history=history,
    )


def _scoring(manifest: Mapping[str, Any]) -> Mapping[str, Any] | None:
    found = manifest.get("scoring")
    return found if isinstance(found, dict) else None


def _frames(manifest: Mapping[str, Any]) -> dict[str, int]:
    return {
        str(entry.get("log")): int(entry.get("frames") or 0)
        for entry in manifest.get("logs") or ()
        if isinstance(entry, dict)
    }


def _times(rows: tuple[Row, ...]) -> dict[str, dict[str, Spread]]:
    """Seconds of each stage, as it is done, and of all of them for one configuration in one frame."""
    found: dict[str, dict[str, Spread]] = {}
    for log in dict.fromkeys(row["log"] for row in rows):
        of_log = [row for row in rows if row["log"] == log]
        stages = {row["stage"]: (_spread(row), number(row, "shared_by") or 1.0) for row in of_log}
        whole = Spread(
            sum(spread.median / shared for spread, shared in stages.values()),
            sum(spread.p95 / shared for spread, shared in stages.values()),
            max(spread.frames for spread, _ in stages.values()),
        )
        found[log] = {TIME: whole} | {stage: spread for stage, (spread, _) in stages.items()}
    return found


def _spread(row: Row) -> Spread:
    return Spread(number(row, "median") or 0.0, number(row, "p95") or 0.0, int(number(row, "frames") or 0))


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
