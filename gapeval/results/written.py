"""The files of results as they were written: texts, so that whoever shows them names them exactly."""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from gapeval.errors import GapevalError
from gapeval.results.tables import PARAMETERS

Row = Mapping[str, str]
SQUARES = {str(k): str(2**k + 1) for k in range(1, 13)}  # resolutions, by k as it is written


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


def read_rows(path: Path, columns: Iterable[str] = (), skipped: int = 0) -> Iterator[dict[str, str]]:
    """The rows of a CSV file; it must have these columns. skipped: lines above. Raises GapevalError."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(islice(file, skipped, None), strict=True)
            missing = [name for name in columns if name not in (rows.fieldnames or ())]
            if missing:
                raise GapevalError(f"{path}: no column {missing[0]}; it is of another version: make it again")
            for row in rows:
                if None in row or None in row.values():
                    raise GapevalError(f"{path}: line {skipped + rows.line_num} is cut off; make it again")
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


def varied(rows: Sequence[Row]) -> tuple[str, ...]:
    """The parameters that differ between rows; not the resolution twice."""
    differ = [name for name in PARAMETERS if len({row[name] for row in rows}) > 1]
    if all(row["k"] and square(row) for row in rows):
        return tuple(name for name in differ if name not in ("i_height", "i_width"))
    return tuple(name for name in differ if name != "k")


def square(row: Row) -> bool:
    """Whether k alone tells the resolution."""
    cells = {row["i_height"], row["i_width"]}
    return cells == {SQUARES.get(row["k"])}
