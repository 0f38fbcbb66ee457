"""Which metrics got worse over all rows: what is read before any single row."""

from collections.abc import Sequence
from dataclasses import dataclass

from gapeval.compare.outcome import REGRESSIONS, Change, Comparison, Row
from gapeval.compare.rows import rank, size
from gapeval.report.comparisons.words import metric_and_unit, pair, plain, told_changes
from gapeval.report.text import counted

OVERVIEW = ("", "metric", "worse in", "better in", "beyond noise", "worst change", "log", "configuration")

Found = tuple[Row, Change]


@dataclass(frozen=True, slots=True)
class Standing:
    """A metric that is worse or lost in some row.

    worse, better: in how many rows. known, beyond: of how many of those that are worse the noise is known,
    and how many are beyond it. row, change: the worst.
    """

    metric: str
    worse: int
    better: int
    known: int
    beyond: int
    row: Row
    change: Change


def standings(rows: Sequence[Row]) -> list[Standing]:
    """Worst first, as rows are: what is lost, then by the largest change. Nothing of a single changed row."""
    found = _by_metric(rows)
    standing = [_standing(metric, of) for metric, of in found.items() if any(map(_is_worse, of))]
    return sorted(standing, key=lambda one: _badness((one.row, one.change)))


def only_better(rows: Sequence[Row]) -> dict[str, int]:
    """In how many rows each metric is better that is worse in none. Nothing of a single changed row."""
    found = {m: of for m, of in _by_metric(rows).items() if not any(map(_is_worse, of))}
    better = {metric: sum(change.mark == "-" for _, change in of) for metric, of in found.items()}
    return {metric: number for metric, number in better.items() if number}


def better_sentence(rows: Sequence[Row]) -> str:
    """`only better: over_area in 3 rows, pq in 1 row`, or nothing."""
    found = [f"{plain(metric)} in {counted(number, 'row')}" for metric, number in only_better(rows).items()]
    return f"only better: {', '.join(found)}" if found else ""


def standing_cells(one: Standing, comparison: Comparison) -> tuple[str, ...]:
    """A line under OVERVIEW and the parameters that vary."""
    names = (one.row.log, one.row.configuration)
    parameters = (one.row.parameters.get(name, "") for name in comparison.varied)
    return (
        one.change.mark,
        metric_and_unit(plain(one.metric)),
        f"{one.worse} of {len(comparison.rows)} rows",
        str(one.better) if one.better else "-",
        f"{one.beyond} of {one.known}" if one.known else "-",
        " -> ".join(pair(one.change.base, one.change.new)),
        *map(plain, (*names, *parameters)),
    )


def _by_metric(rows: Sequence[Row]) -> dict[str, list[Found]]:
    changed = [row for row in rows if row.changes]
    found: dict[str, list[Found]] = {}
    for row in changed if len(changed) > 1 else ():
        for change in told_changes(row):
            found.setdefault(change.metric, []).append((row, change))
    return found


def _standing(metric: str, found: Sequence[Found]) -> Standing:
    worse = [one for one in found if _is_worse(one)]
    beyond = [change.noise.beyond for _, change in worse if change.noise is not None]
    known = [one for one in beyond if one is not None]
    better = sum(change.mark == "-" for _, change in found)
    return Standing(metric, len(worse), better, len(known), sum(known), *min(worse, key=_badness))


def _is_worse(found: Found) -> bool:
    return found[1].mark in REGRESSIONS


def _badness(found: Found) -> tuple[int, float]:
    return rank(found[1].mark), -size(found[1])
