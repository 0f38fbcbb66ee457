"""A comparison for the terminal."""

from collections.abc import Iterator, Sequence

from gapeval.compare.outcome import MARKS, Change, Comparison, Row
from gapeval.report.comparisons.origins import LOGS, ORIGINS, last_reason, log_cells, origin_cells
from gapeval.report.comparisons.times import TIMES, time_cells, untold
from gapeval.report.comparisons.times import is_told as is_time_told
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import (
    ROWS,
    asides,
    difference,
    frames_sentence,
    is_aside,
    is_told,
    label_sentences,
    metric_and_unit,
    noise_words,
    occurring,
    pair,
    plain,
    unknowns,
)
from gapeval.report.text import columns, counted


def text(comparison: Comparison) -> str:
    """Where both come from, what changed, worst first, times, and last the verdict: a terminal shows the end.

    A line for each metric that changed, the first with the row's name; what holds for the whole row stands
    indented below them.
    """
    rows = [row for row in comparison.rows if is_told(row)]
    parts = [
        columns(ORIGINS, origin_cells(comparison)),
        _logs(comparison),
        "\n".join(f"notice: {plain(notice)}" for notice in comparison.notices),
        _changes(rows[:ROWS], comparison.varied) if rows else "No figure changed.",
        "\n".join(unknowns(rows[:ROWS])),
        f"... and {counted(len(rows) - ROWS, 'more row')}; --format csv has all" if len(rows) > ROWS else "",
        _times(comparison),
        _legend(comparison, rows[:ROWS]),
        verdict(comparison),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _logs(comparison: Comparison) -> str:
    cells = log_cells(comparison)
    reason = last_reason(comparison)
    lines = [columns(LOGS, cells)] if cells else []
    return "\n\n".join([*lines, f"latest reason in the history of BASE: {reason}"] if reason else lines)


def _changes(rows: Sequence[Row], varied: Sequence[str]) -> str:
    """The figures of all rows are aligned; the lines below them are not."""
    head = ("", "log", "configuration", *map(plain, varied), "metric", "base", "new", "change", "noise")
    cells = [_figures(row, varied) for row in rows]
    title, *aligned = columns(head, [line for lines in cells for line in lines]).split("\n")
    found = [title]
    left = iter(aligned)
    for row, lines in zip(rows, cells, strict=True):
        found += [next(left) for _ in lines]
        found += [f"     {line}" for line in _below(row)]
    return "\n".join(found)


def _figures(row: Row, varied: Sequence[str]) -> list[tuple[str, ...]]:
    """A line for each changed metric, or one where there is none."""
    names = (plain(row.log), plain(row.configuration), *(plain(row.parameters.get(n, "")) for n in varied))
    told = [change for change in row.changes if not is_aside(change)]
    if not told:
        return [(row.mark, *names, "", "", "", "", "")]
    blank = ("",) * len(names)
    return [(one.mark, *(blank if place else names), *_figure(one)) for place, one in enumerate(told)]


def _figure(change: Change) -> tuple[str, ...]:
    metric = metric_and_unit(plain(change.metric))
    return (metric, *pair(change.base, change.new), difference(change), noise_words(change.noise))


def _below(row: Row) -> Iterator[str]:
    whole = plain("; ".join(row.reasons))
    if row.changes and row.mark not in {change.mark for change in row.changes}:
        whole = f"{MARKS[row.mark]}: {whole}" if whole else MARKS[row.mark]
    if whole:
        yield whole
    yield from filter(None, (asides(row), frames_sentence(row)))
    yield from label_sentences(row)


def _times(comparison: Comparison) -> str:
    if not comparison.times:
        return ""
    shown = columns(TIMES, [time_cells(time) for time in comparison.times if is_time_told(time)])
    others = untold(comparison.times)
    return f"{shown}\n{others}" if others else shown


def _legend(comparison: Comparison, rows: Sequence[Row]) -> str:
    found = occurring(rows, [time for time in comparison.times if is_time_told(time)])
    return "\n".join(f"{mark}  {meaning}" for mark, meaning in found)
