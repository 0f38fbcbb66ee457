"""The files of a folder of studies."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from gapeval.errors import GapevalError
from gapeval.report.sweeps.results import Row, read_json, read_rows
from gapeval.results.store import MANIFEST

CLAIMS, STUDY = "claims.csv", "study.yaml"
COLUMNS = ("study", "claim", "section", "words", "measured", "verdict", "conditions", "source")


@dataclass(frozen=True, slots=True)
class Curve:
    """One figure of the rows of `where`: a panel for each y, a line for each value of the column `lines`."""

    title: str
    x: str
    y: tuple[str, ...]
    lines: str | None
    where: Mapping[str, tuple[str, ...]]
    log_x: bool


@dataclass(frozen=True, slots=True)
class Study:
    """One study: what it asks, its figures, its rows. runs: folders of the sweeps that it is made of."""

    name: str
    title: str
    paper: str
    question: str
    says: str
    curves: tuple[Curve, ...]
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
    curves = about.get("curves") or ()
    return Study(
        name,
        texts["title"] or name,
        texts["paper"],
        texts["question"],
        texts["says"],
        tuple(_curve(path, curve, rows) for curve in curves),
        rows,
        tuple(runs),
    )


def _text(value: Any) -> str:
    return "" if value is None else " ".join(str(value).split())


def _curve(path: Path, given: Any, rows: tuple[Row, ...]) -> Curve:
    """Raises GapevalError for a column that the rows do not have."""
    try:
        y = (given["y"],) if isinstance(given["y"], str) else tuple(map(str, given["y"]))
        where = {
            str(column): tuple(map(_cell, value if isinstance(value, list) else [value]))
            for column, value in (given.get("where") or {}).items()
        }
        lines = None if given.get("lines") is None else str(given["lines"])
        curve = Curve(_text(given.get("title")), str(given["x"]), y, lines, where, bool(given.get("log_x")))
    except (KeyError, TypeError, AttributeError) as error:
        raise GapevalError(f"{path}: a curve needs x and y, columns of the study's CSV file") from error
    columns = (curve.x, *curve.y, *where, *((lines,) if lines else ()))
    missing = [column for column in columns if rows and column not in rows[0]]
    if missing:
        raise GapevalError(f"{path}: a curve names {missing[0]}, which is no column of the study's CSV file")
    return curve


def _cell(value: Any) -> str:
    """As the value stands in a CSV file."""
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
