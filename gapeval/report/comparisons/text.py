"""A comparison for the terminal."""

from collections.abc import Iterator, Sequence

from gapeval.compare.outcome import MARKS, Change, Comparison, Row
from gapeval.report.comparisons.advice import advice, renewal
from gapeval.report.comparisons.failures import FAILURES
from gapeval.report.comparisons.groups import Group, detailed, groups, member_lines, more_groups, why
from gapeval.report.comparisons.legend import legend
from gapeval.report.comparisons.origins import LOGS, ORIGINS, last_reason, log_cells, origin_cells
from gapeval.report.comparisons.overview import OVERVIEW, better_sentence, standing_cells, standings
from gapeval.report.comparisons.times import TIMES, shown_times, time_cells, untold
from gapeval.report.comparisons.times import is_told as is_time_told
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import (
    ROWS,
    asides,
    difference,
    frames_sentence,
    label_sentences,
    metric_and_unit,
    noise_words,
    pair,
    plain,
    told_changes,
    unknowns,
)
from gapeval.report.text import columns, counted


def text(comparison: Comparison) -> str:
    """Where both come from, what changed, worst first, times, and last the verdict: a terminal shows the end.

    First which metrics are worse in how many rows, then the worst rows: a line for each metric that changed,
    the first with the row's name; what holds for the whole row stands indented below them. Rows of which
    nothing but a reason is known are told together.
    """
    rows = detailed(comparison.rows)
    found = groups(comparison.rows)
    parts = [
        columns(ORIGINS, origin_cells(comparison)),
        _logs(comparison),
        "\n".join(f"notice: {plain(notice)}" for notice in comparison.notices),
        _overview(comparison),
        _groups([group for group in found if group.mark in FAILURES], comparison.varied),
        _changes(rows[:ROWS], comparison.varied) if rows else "",
        "" if rows or found else "No figure changed.",
        "\n".join(unknowns(rows[:ROWS])),
        f"... and {counted(len(rows) - ROWS, 'more row')}; --format csv has all" if len(rows) > ROWS else "",
        _groups([group for group in found if group.mark not in FAILURES], comparison.varied),
        _times(comparison),
        "\n".join(f"{mark}  {meaning}" for mark, meaning in legend(comparison)),
        _advice(comparison),
        verdict(comparison),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _logs(comparison: Comparison) -> str:
    cells = log_cells(comparison)
    reason = last_reason(comparison)
    lines = [columns(LOGS, cells)] if cells else []
    return "\n\n".join([*lines, f"latest reason in the history of BASE: {reason}"] if reason else lines)


def _overview(comparison: Comparison) -> str:
    cells = [standing_cells(one, comparison) for one in standings(comparison.rows)]
    head = (*OVERVIEW, *map(plain, comparison.varied))
    return "\n".join(filter(None, (columns(head, cells) if cells else "", better_sentence(comparison.rows))))


def _groups(found: Sequence[Group], varied: Sequence[str]) -> str:
    lines = []
    for group in found[:ROWS]:
        lines.append(f"{group.mark}  {counted(len(group.rows), 'row')}: {why(group)}")
        lines += [f"     {line}" for line in member_lines(group, varied)]
    return "\n".join([*lines, *more_groups(found)])


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
    told = told_changes(row)
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
    if counts := asides(row):
        yield f"counts: {counts}"
    yield from filter(None, [frames_sentence(row)])
    yield from label_sentences(row)


def _times(comparison: Comparison) -> str:
    times = shown_times(comparison.times)
    if not times:
        return ""
    shown = columns(TIMES, [time_cells(time) for time in times if is_time_told(time)])
    others = untold(times)
    return f"{shown}\n{others}" if others else shown


def _advice(comparison: Comparison) -> str:
    command = renewal(comparison)
    lines = [f"next: {line}" for line in [advice(comparison)] if line]
    return "\n".join([*lines, *([f"    {command}"] if command else [])])
