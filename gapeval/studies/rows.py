"""Rows of a study's CSV: figures with intervals, over the logs of equal conditions."""

import csv
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gapeval.config import Configuration
from gapeval.ragged import IndexArray
from gapeval.results.store import badness
from gapeval.results.tables import PARAMETERS, cell, parameters
from gapeval.studies.cases import Planned
from gapeval.studies.columns import FIGURES, key_columns, named_by
from gapeval.studies.definition import Claim, Study, Value
from gapeval.studies.estimates import NOTHING, Estimate, estimates
from gapeval.studies.tally import Tables, Tally, by_gap_range, by_labels, letter
from gapeval.sweep.grid import configurations

ALL = "all"


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """keys: what the row is about, by column; figures: what was measured; counts: what is behind it."""

    keys: Mapping[str, Value | None]
    figures: Mapping[str, Estimate]
    counts: Mapping[str, int]


def rows_of(planned: Planned, study: Study, tables: Tables) -> Iterator[Row]:
    """For each scene, and all, under each combination of conditions: a row for each configuration."""
    about = [about_configuration(configuration) for configuration in configurations(planned.config)]
    wanted = drawn_by(study.claims)
    groups: list[tuple[str, Any, Tally]] = [("", None, tables.whole)]
    for name in study.labels_by:
        groups += [
            (name, letter(at) if name == "position" else at, tally) for at, tally in by_labels(tables, name)
        ]
    groups += [("gap_range", at, tally) for at, tally in by_gap_range(tables)]
    for by, group, tally in groups:
        for keys, cases in conditions_of(planned):
            part = tally.of(np.isin(tally.case, cases))
            if by and not part.sums.any():
                continue
            found = estimates(part, planned.config.scoring, wanted)
            for parameter, (figures, counts) in zip(about, found, strict=True):
                yield Row({**keys, "by": by or None, "group": group, **parameter}, figures, counts)


def drawn_by(claims: Iterable[Claim]) -> set[str]:
    """The metrics whose draws claims need: of differences, ratios and best values."""
    figures = [figure for claim in claims for figure in claim.figures.values()]
    return {figure.of for figure in figures} | {"hit_rate", "coverage"}


def about_configuration(configuration: Configuration) -> dict[str, Value | None]:
    """The columns that say which configuration a row is of."""
    return {"configuration": configuration.id, **parameters(configuration)}


def conditions_of(
    planned: Planned, by_scene: bool = True
) -> Iterator[tuple[dict[str, Value | None], IndexArray]]:
    """All scenes, and each, under each combination of conditions: its columns, and its cases."""
    combined = dict.fromkeys(case.conditions for case in planned.cases)
    scenes = dict.fromkeys(case.scene for case in planned.cases) if by_scene else {}
    for conditions, scene in itertools.product(combined, (ALL, *scenes)):
        cases = [
            index
            for index, case in enumerate(planned.cases)
            if case.conditions == conditions and scene in (ALL, case.scene)
        ]
        known = dict(conditions)
        keys = {"scene": scene} | {name: known.get(name) for name in planned.columns}
        yield keys, np.array(cases, dtype=np.intp)


def with_best(rows: Sequence[Row]) -> list[Row]:
    """The rows, the best of each scene and combination of conditions marked; as in a sweep, see BEST."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for index, row in enumerate(rows):
        if row.keys.get("by") is None and row.counts.get("asked"):
            fixed = {
                key: value for key, value in row.keys.items() if key not in (*PARAMETERS, "configuration")
            }
            groups.setdefault(tuple(fixed.items()), []).append(index)
    marked = list(rows)
    for group in groups.values():
        if len(group) > 1:
            best = min(group, key=lambda index: badness(lambda name: rows[index].figures[name].value))
            marked[best] = replace(rows[best], keys={**rows[best].keys, "best": True})
    return marked


def csv_text(rows: Sequence[Row], study: Study) -> str:
    """The rows as CSV: what varies first, then figures each with its interval, then counts.

    Columns that are empty in all rows are left out, and so are parameters that are the same in all, unless a
    curve is drawn from them.
    """
    drawn = {column for curve in study.curves for column in named_by(curve)}
    different = {name: {row.keys.get(name) for row in rows} for name in key_columns(study)}
    keys = [
        name
        for name, values in different.items()
        if name in drawn or (len(values) > 1 if name in PARAMETERS else values != {None})
    ]
    known = {name for row in rows for name, one in row.figures.items() if one.value is not None}
    figures = [name for name in FIGURES if name in known | drawn]
    counts = dict.fromkeys(name for row in rows for name in row.counts)
    heads = [*keys, *(f"{name}{end}" for name in figures for end in ("", "_low", "_high")), *counts]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        cells = [cell(row.keys.get(name)) for name in keys]
        for name in figures:
            one = row.figures.get(name, NOTHING)
            cells += [cell(one.value), cell(one.low), cell(one.high)]
        writer.writerow([*cells, *(cell(row.counts.get(name)) for name in counts)])
    return text.getvalue()
