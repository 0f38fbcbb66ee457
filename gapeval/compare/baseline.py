"""A baseline: figures of a sweep in one CSV file to commit, with what they were made from, and why renewed.

It begins with lines of `# `, which are JSON together. Then come the rows of summary.csv, without intervals,
and those of frames.csv, told apart by their stamp, with the labels that were hit.
"""

import codecs
import csv
import io
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gapeval.compare.frames import LogFrames, read_frames
from gapeval.compare.labels import States
from gapeval.errors import GapevalError
from gapeval.files import write_whole
from gapeval.results.figures import FIGURES
from gapeval.results.tables import FRAMES, LABELS, PARAMETERS, SUMMARY
from gapeval.results.written import Row, read_rows
from gapeval.scoring.metrics import SUMS

OPENING = "# "
KIND = "gapeval baseline"
VERSION = 1
COLUMNS = (
    *("log", "configuration", "stamp", *PARAMETERS),
    *(name for name in FIGURES if name not in SUMS),
    *(*SUMS, "hit", "missed"),
)
NEEDED = ("log", "configuration", "stamp", "hit", "missed")  # of the columns, to read it at all
# What must be known of where it was made from to say whether results can be compared with it.
KEPT = ("gapeval", "revision", "source", "scorer", "scoring", "logs")
KEPT_OF_LOGS = ("log", "sha256", "labels", "frames")


@dataclass(frozen=True, slots=True)
class Baseline:
    """history: why it was made and renewed, the latest last. lines: above the table."""

    path: Path
    manifest: Mapping[str, Any]
    history: tuple[Mapping[str, Any], ...]
    rows: tuple[Row, ...]
    hits: Mapping[tuple[str, int, str], States]
    lines: int

    @property
    def unknown(self) -> str:
        return "" if self.hits else f"{self.path} was made without frames"

    def frames(self, configurations: Collection[str]) -> dict[str, LogFrames]:
        return read_frames(self.path, self.lines, configurations)

    def states(self, log: str, stamp: int, configuration: str) -> States:
        return self.hits.get((log, stamp, configuration), {})


def is_baseline(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(16).removeprefix(codecs.BOM_UTF8).startswith(OPENING.encode())
    except OSError as error:
        raise GapevalError(f"{path}: cannot be read: {error.strerror}") from error


def read_baseline(path: Path) -> Baseline:
    """Raises GapevalError. What an earlier version did not have may be missing."""
    document, lines = _above(path)
    if document.get("version") != VERSION:
        raise GapevalError(
            f"{path}: a baseline of another version of gapeval; renew it with gapeval baseline"
        )
    rows, hits = [], {}
    if _is_in_conflict(path):
        raise _conflict(path)
    for row in read_rows(path, NEEDED, lines):
        if row["stamp"]:
            hits[row["log"], _stamp(path, row), row["configuration"]] = _states(path, row)
        else:
            rows.append(row)
    if not rows:
        raise GapevalError(f"{path}: no rows; renew it with gapeval baseline")
    return Baseline(path, document, tuple(document["history"]), tuple(rows), hits, lines)


def read_history(path: Path) -> tuple[Mapping[str, Any], ...]:
    """Of a baseline of any version. Raises GapevalError."""
    return tuple(_above(path)[0]["history"])


def _above(path: Path) -> tuple[dict[str, Any], int]:
    """What stands above the table, with a history, and in how many lines. Raises GapevalError."""
    above = _lines_above(path)
    try:
        document = json.loads("".join(line[len(OPENING) :] for line in above))
        if document["kind"] != KIND or not all(isinstance(entry, dict) for entry in document["history"]):
            raise ValueError("kind")
    except (ValueError, KeyError, TypeError) as error:
        if _is_in_conflict(path):
            raise _conflict(path) from error
        raise GapevalError(f"{path}: no baseline; make one with gapeval baseline") from error
    return document, len(above)


def _lines_above(path: Path) -> list[str]:
    found = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            for line in file:
                if not line.startswith(OPENING):
                    break
                found.append(line)
    except (OSError, UnicodeDecodeError) as error:
        raise GapevalError(f"{path}: cannot be read: {error}") from error
    return found


def _conflict(path: Path) -> GapevalError:
    return GapevalError(f"{path}: holds a merge conflict; check out either side of it, then renew it")


def _is_in_conflict(path: Path) -> bool:
    return any(line.startswith(b"<<<<<<< ") for line in path.read_bytes().splitlines())


def _stamp(path: Path, row: Row) -> int:
    try:
        return int(row["stamp"])
    except ValueError as error:
        raise GapevalError(f"{path}: stamp {row['stamp']!r} is no number; renew it") from error


def _states(path: Path, row: Row) -> States:
    try:
        labels = [json.loads(row[name] or "[]") for name in ("hit", "missed")]
        if not all(isinstance(names, list) for names in labels):
            raise ValueError("list")
    except ValueError as error:
        raise GapevalError(f"{path}: frame {row['stamp']}: no list of labels; renew it") from error
    return {str(label): hit for hit, names in zip((True, False), labels, strict=True) for label in names}


def write_baseline(
    path: Path,
    folder: Path,
    manifest: Mapping[str, Any],
    history: Sequence[Mapping[str, Any]],
    with_frames: bool,
) -> int:
    """From a folder of results with this manifest; returns the number of its frames. Raises GapevalError."""
    kept: dict[str, Any] = {name: manifest.get(name) for name in KEPT}
    kept["logs"] = [{name: entry.get(name) for name in KEPT_OF_LOGS} for entry in manifest.get("logs") or ()]
    document = {"kind": KIND, "version": VERSION, "history": list(history)} | kept
    text = io.StringIO()
    for line in json.dumps(document, indent=1, ensure_ascii=False).split("\n"):
        text.write(f"{OPENING}{line}\n")
    table = csv.DictWriter(text, COLUMNS, restval="", extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows(read_rows(folder / SUMMARY, ("log", "configuration")))
    frames = 0
    if with_frames:
        for row in _frames(folder):
            table.writerow(row)
            frames += 1
    write_whole(path, text.getvalue().encode())
    return frames


def _frames(folder: Path) -> Iterator[Row]:
    """The rows of frames.csv, with the labels that were hit and missed."""
    named = ("log", "stamp", "configuration")
    states: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for row in read_rows(folder / LABELS, (*named, "label", "hit")):
        if row["hit"]:
            of_frame = states.setdefault(tuple(row[name] for name in named), {"hit": [], "missed": []})
            of_frame["hit" if row["hit"] == "true" else "missed"].append(row["label"])
    for row in read_rows(folder / FRAMES, (*named, *SUMS)):
        of_frame = states.get(tuple(row[name] for name in named), {})
        yield row | {
            name: json.dumps(labels, ensure_ascii=False) for name, labels in of_frame.items() if labels
        }
