"""The rows of a sweep's folder as they stand in its files: texts, so that a caption names them exactly."""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gapeval.errors import GapevalError
from gapeval.results.store import ALL, MANIFEST
from gapeval.results.tables import PARAMETERS

SUMMARY, FRAMES = "summary.csv", "frames.csv"
Row = Mapping[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A folder's results. overall: the rows of all logs together, in the order of the grid."""

    folder: Path
    manifest: dict[str, Any]
    overall: tuple[Row, ...]

    @property
    def varied(self) -> tuple[str, ...]:
        """The parameters that differ between configurations; not the resolution twice."""
        differ = [name for name in PARAMETERS if len({row[name] for row in self.overall}) > 1]
        if all(row["k"] and square(row) for row in self.overall):
            return tuple(name for name in differ if name not in ("i_height", "i_width"))
        return tuple(name for name in differ if name != "k")

    @property
    def scored(self) -> bool:
        """Whether any label was asked for."""
        return any(number(row, "asked") for row in self.overall)


def read_results(folder: Path) -> Results:
    """Raises GapevalError where the files of a sweep are not there, or are no such files."""
    manifest = read_json(folder / MANIFEST)
    overall = tuple(row for row in read_rows(folder / SUMMARY, PARAMETERS) if row["log"] == ALL)
    if not overall:
        raise GapevalError(f"{folder / SUMMARY}: no rows for all logs together; run the sweep again")
    return Results(folder, manifest, overall)


def read_json(path: Path) -> dict[str, Any]:
    """Raises GapevalError."""
    try:
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise GapevalError(f"{path}: cannot be read: {error.strerror}; name a folder of results") from error
    except ValueError as error:
        raise GapevalError(f"{path}: not JSON: {error}; run what made it again") from error
    if not isinstance(document, dict):
        raise GapevalError(f"{path}: not what gapeval writes; run what made it again")
    return document


def read_rows(path: Path, columns: Iterable[str] = ()) -> Iterator[dict[str, str]]:
    """The rows of a CSV file; it must have these columns. Raises GapevalError."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(file, strict=True)
            missing = [name for name in columns if name not in (rows.fieldnames or ())]
            if missing:
                raise GapevalError(f"{path}: no column {missing[0]}; it is of another version: make it again")
            for row in rows:
                if None in row or None in row.values():
                    raise GapevalError(f"{path}: line {rows.line_num} is cut off; make it again")
                yield row
    except OSError as error:
        raise GapevalError(f"{path}: cannot be read: {error.strerror}; name a folder of results") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise GapevalError(f"{path}: no CSV file: {error}; make it again") from error


def number(row: Row, name: str) -> float | None:
    """A figure; None where it is undefined, or where the file has no such column."""
    text = row.get(name, "")
    try:
        return float(text) if text else None
    except ValueError as error:
        raise GapevalError(f"{name}: {text!r} is no number; make the results again") from error


def square(row: Row) -> bool:
    """Whether k alone tells the resolution."""
    cells = {row["i_height"], row["i_width"]}
    return row["k"].isdigit() and cells == {str(2 ** int(row["k"]) + 1)}


def values_of(rows: Sequence[Row], name: str) -> tuple[str, ...]:
    """What a column holds: numbers by size, other texts in the order of the rows."""
    found = dict.fromkeys(row[name] for row in rows)
    try:
        return tuple(sorted(found, key=lambda text: float(text) if text else -1.0))
    except ValueError:
        return tuple(found)


def where(row: Row, names: Iterable[str]) -> str:
    """`n_o = 1, delta_r = 1.1`: for a caption."""
    return ", ".join(f"{name} = {row[name] or '(empty)'}" for name in names)
