"""The files of a folder of studies."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from gapeval.errors import GapevalError
from gapeval.results.store import MANIFEST
from gapeval.results.written import Row, number, read_json, read_rows

CLAIMS, STUDY = "claims.csv", "study.yaml"
COLUMNS = ("study", "claim", "section", "words", "measured", "verdict", "conditions", "source")


@dataclass(frozen=True, slots=True)
class Curve:
    """One figure of the rows of `where`: a panel for each y, a line for each value of the column `lines`.

    place: among the study's curves, from 1.
    """

    place: int
    title: str
    x: str
    y: tuple[str, ...]
    lines: str | None
    where: Mapping[str, tuple[str, ...]]
    log_x: bool

    def rows_of(self, rows: Sequence[Row]) -> list[Row]:
        """Those that are asked for. A column of `where` that is missing is empty in all of them."""
        found = (
            row for row in rows if all(row.get(name, "") in any_of for name, any_of in self.where.items())
        )
        return [row for row in found if row[self.x]]


@dataclass(frozen=True, slots=True)
class Study:
    """One study: what it asks, its figures, its rows.

    left_out: curves that cannot be drawn, and why. runs: folders of the sweeps that it is made of.
    """

    name: str
    title: str
    paper: str
    question: str
    says: str
    curves: tuple[Curve, ...]
    left_out: tuple[str, ...]
    rows: tuple[Row, ...]
    runs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Studies:
    """A folder of studies, in the order of its manifest."""

    folder: Path
    manifest: dict[str, Any]
    claims: tuple[Row, ...]
    studies: tuple[Study, ...]


def read_studies(folder: Path) -> Studies:
    """Raises GapevalError where a file is missing or not what it should be."""
    manifest = read_json(folder / MANIFEST)
    claims = tuple(read_rows(folder / CLAIMS, COLUMNS))
    names = manifest.get("studies", ())
    return Studies(folder, manifest, claims, tuple(_study(folder, str(name)) for name in names))


def _study(folder: Path, name: str) -> Study:
    path = folder / name / STUDY
    try:
        about = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise GapevalError(f"{path}: cannot be read: {error.strerror}; run the study again") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise GapevalError(f"{path}: not YAML; run the study again") from error
    if not isinstance(about, dict):
        raise GapevalError(f"{path}: not a study; run it again")
    rows = tuple(read_rows(folder / f"{name}.csv"))
    runs = sorted(run.parent.relative_to(folder).as_posix() for run in (folder / name).rglob("summary.csv"))
    texts = {key: _text(about.get(key)) for key in ("title", "paper", "question", "says")}
    curves, left_out = _curves(name, about.get("curves") or [], rows)
    return Study(
        name,
        texts["title"] or name,
        texts["paper"],
        texts["question"],
        texts["says"],
        curves,
        left_out,
        rows,
        tuple(runs),
    )


def _text(value: Any) -> str:
    return "" if value is None else " ".join(str(value).split())


def _curves(study: str, given: Any, rows: tuple[Row, ...]) -> tuple[tuple[Curve, ...], tuple[str, ...]]:
    """Those that can be drawn, and of each other one what is wrong with it."""
    curves: list[Curve] = []
    left_out: list[str] = []
    for place, one in enumerate(given if isinstance(given, list) else [given], 1):
        name = f"study {study}, curve {place}"
        try:
            curve = _curve(place, one)
            name += f" ({curve.title or ', '.join(curve.y) + ' against ' + curve.x})"
            _check(curve, rows)
        except (KeyError, TypeError, AttributeError):
            left_out.append(f"{name} is left out: it needs x and y, columns of {study}.csv")
        except GapevalError as error:
            left_out.append(f"{name} is left out: {error}")
        else:
            curves.append(curve)
    return tuple(curves), tuple(left_out)


def _curve(place: int, given: Any) -> Curve:
    y = (given["y"],) if isinstance(given["y"], str) else tuple(map(str, given["y"]))
    where = {
        str(column): tuple(map(_cell, value if isinstance(value, list) else [value]))
        for column, value in (given.get("where") or {}).items()
    }
    lines = None if given.get("lines") is None else str(given["lines"])
    return Curve(place, _text(given.get("title")), str(given["x"]), y, lines, where, bool(given.get("log_x")))


def _check(curve: Curve, rows: tuple[Row, ...]) -> None:
    """Raises GapevalError for a column that the rows do not have, and for a y that is no number."""
    if not rows:
        return
    asked = [name for name, any_of in curve.where.items() if "" not in any_of]
    for column in (curve.x, *curve.y, *asked, *((curve.lines,) if curve.lines else ())):
        if column not in rows[0]:
            raise GapevalError(f"there is no column {column}")
    for row in curve.rows_of(rows):
        for name in (column for y in curve.y for column in (y, f"{y}_low", f"{y}_high")):
            try:
                value = number(row, name)
            except GapevalError:
                value = math.nan
            if value is not None and not math.isfinite(value):
                raise GapevalError(f"{name} is {row[name]!r} in a row, which is no number")
        if curve.log_x and not _is_number(row[curve.x]):
            raise GapevalError(f"{curve.x} is {row[curve.x]!r} in a row, which is no number, as log_x needs")


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def is_numeric(rows: Sequence[Row], column: str) -> bool:
    """Whether all that a column holds is numbers."""
    return all(_is_number(row[column]) for row in rows)


def _cell(value: Any) -> str:
    """As the value stands in a CSV file."""
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
