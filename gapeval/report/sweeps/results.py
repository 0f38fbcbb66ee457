"""The rows of a sweep's folder as they stand in its files: texts, so that a caption names them exactly."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gapeval.errors import GapevalError
from gapeval.results.store import ALL, MANIFEST
from gapeval.results.tables import PARAMETERS, SUMMARY
from gapeval.results.written import Row, number, read_json, read_rows, varied


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A folder's results. overall: the rows of all logs together, in the order of the grid."""

    folder: Path
    manifest: dict[str, Any]
    overall: tuple[Row, ...]

    @property
    def varied(self) -> tuple[str, ...]:
        """The parameters that differ between configurations; not the resolution twice."""
        return varied(self.overall)

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
