"""Folders of results for a comparison: swept once, copied, and changed by hand."""

import csv
import json
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from command import gapeval
from small_logs import drive, labels

from gapeval.compare import compare
from gapeval.compare.limits import read_limits
from gapeval.compare.outcome import Change, Comparison, Row
from gapeval.compare.side import read_side

Texts = dict[str, str]
GRID = ("-p", "n_o=0,1", "-p", "pl_th=0.02,0.05", "-p", "d_r=0.8", "-p", "scoring.block=0.2")
ALL = "all"

# Which way is better, written down a second time.
HIGHER = (
    *("hit_rate", "coverage", "precision", "recall", "f1", "sq", "rq", "pq"),
    *("npca_accuracy", "pca_accuracy", "first_hit_range"),
)
LOWER = (
    *("over_area", "fp_per_frame", "splits", "merges"),
    *("npca_length_error", "npca_yaw_error", "pca_length_error", "pca_yaw_error"),
    *("near_edge_error", "near_edge_late", "near_edge_missed", "under_coverage", "over_coverage"),
    *("shadow_gaps", "towards_missed", "plane_fallbacks"),
)
NEITHER = (
    *("axis_angle", "gaps", "traversable_npca", "traversable_pca", "hits", "tp", "fp", "fn"),
    *("false_gaps", "ignored", "not_counted"),
)
ASKED = ("frames", "scored_frames", "empty_frames", "asked")


def swept(folder: Path, frames: Sequence[int] = (24, 12), grid: Sequence[str] = GRID) -> Path:
    """Results of small logs, `a.mcap`, `b.mcap` and so on, of so many frames each, beside them."""
    logs = [drive(folder / f"{chr(97 + at)}.mcap", count, seed=at) for at, count in enumerate(frames)]
    drawn = labels(folder / "labels.geojson")
    done = gapeval("sweep", *logs, "--labels", drawn, *grid, "-o", folder / "results", "--jobs", 1)
    assert done.status == 0, done.err
    return folder / "results"


def copied(folder: Path, to: Path) -> Path:
    shutil.copytree(folder, to, ignore=shutil.ignore_patterns("parts", "*.mcap"))
    return to


def table(path: Path) -> list[Texts]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write_table(path: Path, rows: Sequence[Texts], columns: Iterable[str] = ()) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns) or list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def edited(folder: Path, edit: Callable[[Texts], Texts | None], name: str = "summary.csv") -> Path:
    """The folder, with each row of a table made anew; None: without it."""
    rows = [row for old in table(folder / name) if (row := edit(dict(old))) is not None]
    write_table(folder / name, rows)
    return folder


def cells(where: Texts, **values: object) -> Callable[[Texts], Texts]:
    """An edit: these cells in the rows that have those."""

    def edit(row: Texts) -> Texts:
        fits = all(row[name] == value for name, value in where.items())
        return row | {name: _text(value) for name, value in values.items()} if fits else row

    return edit


def _text(value: object) -> str:
    return "" if value is None else value if isinstance(value, str) else repr(value)


def manifest(folder: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    """The folder, with its manifest changed in place."""
    path = folder / "manifest.json"
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))
    return folder


def compared(base: Path, new: Path, drops: Sequence[str] = (), rises: Sequence[str] = ()) -> Comparison:
    return compare(read_side(base), read_side(new), read_limits(drops, rises, {}, {}))


def the_row(comparison: Comparison, log: str, configuration: str) -> Row:
    (found,) = [row for row in comparison.rows if (row.log, row.configuration) == (log, configuration)]
    return found


def the_change(row: Row, metric: str) -> Change:
    (found,) = [change for change in row.changes if change.metric == metric]
    return found


def shown(base: Path, new: Path, *options: object) -> tuple[int, dict[str, Any]]:
    """Exit status and JSON of the command."""
    done = gapeval("compare", base, new, "--format", "json", *options)
    assert done.out, done.err
    return done.status, json.loads(done.out)


def is_one_line(text: str) -> bool:
    return text.startswith("gapeval: ") and text.count("\n") == 1 and "a bug of ours" not in text
