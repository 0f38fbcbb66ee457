"""A comparison as GitHub-flavoured Markdown."""

import re
import string
from collections.abc import Sequence

from gapeval.compare.outcome import Change, Comparison, Row
from gapeval.report.comparisons.advice import advice, renewal
from gapeval.report.comparisons.failures import FAILURES
from gapeval.report.comparisons.groups import (
    NAMED,
    Group,
    detailed,
    first,
    groups,
    members,
    more_groups,
    more_members,
    why,
)
from gapeval.report.comparisons.legend import legend
from gapeval.report.comparisons.origins import LOGS, ORIGINS, last_reason, log_cells, origin_cells
from gapeval.report.comparisons.overview import OVERVIEW, only_better, standing_cells, standings
from gapeval.report.comparisons.times import TIMES, shown_times, time_cells, untold
from gapeval.report.comparisons.times import is_told as is_time_told
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import (
    LABELS,
    ROWS,
    asides,
    difference,
    frames_run,
    metric_and_unit,
    noise_words,
    pair,
    plain,
    told_changes,
    unknowns,
)
from gapeval.report.text import counted

Cells = Sequence[str]
AWKWARD = re.compile(r"[`|\\]|^\s|\s$")  # in a code span, or in one within a table
ENTITIES = {ord(sign): f"&#{ord(sign)};" for sign in string.punctuation}


def markdown(comparison: Comparison) -> str:
    """The verdict first: a page is read from its head. Then what to do, what is worse, and of which labels.

    Then as for the terminal, in tables; times are folded. Names of logs and labels, paths and reasons stand
    as code: whatever is in them, they neither break a table nor call anybody.
    """
    rows, varied = detailed(comparison.rows), comparison.varied
    shown, found = rows[:ROWS], groups(comparison.rows)
    parts = [
        "## gapeval compare",
        f"**{verdict(comparison)}**",
        f"Next: {what_to_do}" if (what_to_do := advice(comparison)) else "",
        f"    {renewal(comparison)}".rstrip(),
        "\n".join(f"* {code(notice)}" for notice in comparison.notices),
        _overview(comparison),
        _better(comparison),
        _groups([group for group in found if group.mark in FAILURES], varied),
        _labels(shown, varied),
        _changes(shown, varied),
        "" if rows or found else "No figure changed.",
        _besides(shown, varied),
        f"... and {counted(len(rows) - ROWS, 'more row')}; `--format csv` has all"
        if len(rows) > ROWS
        else "",
        "\n".join(f"* {code(reason)}" for reason in unknowns(shown)),
        _groups([group for group in found if group.mark not in FAILURES], varied),
        "; ".join(f"{_mark(mark)} {meaning}" for mark, meaning in legend(comparison)),
        _times(comparison),
        _origins(comparison),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def code(text: str) -> str:
    """Any text as code, on one line and in a cell."""
    text = plain(text)
    if not AWKWARD.search(text):
        return f"`{text}`" if text else ""
    return f"<code>{text.translate(ENTITIES)}</code>"


def table(head: Cells, rows: Sequence[Cells]) -> str:
    """Cells are Markdown themselves."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _overview(comparison: Comparison) -> str:
    cells = [standing_cells(one, comparison) for one in standings(comparison.rows)]
    as_code = (0, 1, *range(OVERVIEW.index("log"), len(OVERVIEW) + len(comparison.varied)))
    lines = [[code(cell) if at in as_code else cell for at, cell in enumerate(line)] for line in cells]
    return table((*OVERVIEW, *map(code, comparison.varied)), lines) if lines else ""


def _better(comparison: Comparison) -> str:
    found = [f"{code(metric)} in {counted(n, 'row')}" for metric, n in only_better(comparison.rows).items()]
    return f"Only better: {', '.join(found)}" if found else ""


def _groups(found: Sequence[Group], varied: Sequence[str]) -> str:
    """A line for each reason, and one for each set of configurations where logs have different ones."""
    lines: list[Cells] = []
    for group in found[:ROWS]:
        about = (_mark(group.mark), code(why(group)), str(len(group.rows)))
        for of in (of_group := members(group, varied))[:NAMED]:
            logs, configurations = list(map(code, of.logs)), list(map(code, of.configurations))
            lines.append((*about, first(logs, "log"), first(configurations, "configuration")))
            about = ("", "", "")
        lines += [("", "", "", more, "") for more in more_members(of_group)]
    head = ("", "reason", "rows", "log", "configurations")
    return "\n\n".join([*([table(head, lines)] if lines else []), *more_groups(found)])


def _changes(rows: Sequence[Row], varied: Sequence[str]) -> str:
    """A line for each changed metric."""
    lines = [
        (_mark(change.mark), *_names(row, varied), *_figure(change))
        for row in rows
        for change in told_changes(row)
    ]
    head = ("", "log", "configuration", *map(code, varied), "metric", "base", "new", "change", "noise")
    return table(head, lines) if lines else ""


def _besides(rows: Sequence[Row], varied: Sequence[str]) -> str:
    """What holds for a whole row: where it changed, its counts, and reasons, if it has any."""
    lines: list[Cells] = []
    for row in rows:
        frames = f"{frames_run(row.frames)} ({counted(len(row.frames), 'frame')})" if row.frames else ""
        besides = (frames, asides(row), code("; ".join(row.reasons)))
        if any(besides) or not told_changes(row):
            lines.append((_mark(row.mark), *_names(row, varied), *besides))
    head = ("", "log", "configuration", *map(code, varied), "changed frames", "counts", "reasons")
    if not any(line[-1] for line in lines):
        head, lines = head[:-1], [line[:-1] for line in lines]
    return table(head, lines) if lines else ""


def _names(row: Row, varied: Sequence[str]) -> Cells:
    return (code(row.log), code(row.configuration), *(code(row.parameters.get(name, "")) for name in varied))


def _figure(change: Change) -> Cells:
    metric = code(metric_and_unit(change.metric))
    return (metric, *pair(change.base, change.new), difference(change), noise_words(change.noise))


def _labels(rows: Sequence[Row], varied: Sequence[str]) -> str:
    """Of each row the first labels that changed."""
    lines: list[Cells] = []
    for row in rows:
        changes = row.labels or ()
        names = _names(row, varied)
        lines += [
            (*names, code(change.label), change.was, frames_run(change.frames), change.now)
            for change in changes[:LABELS]
        ]
        if len(changes) > LABELS:
            lines.append((*names, f"... and {len(changes) - LABELS} more", "", "", ""))
    head = ("log", "configuration", *map(code, varied), "gap", "was", "in frames", "now")
    return table(head, lines) if lines else ""


def _mark(mark: str) -> str:
    return code(mark.strip())


def _times(comparison: Comparison) -> str:
    times = shown_times(comparison.times)
    if not times:
        return ""
    told = [time_cells(time) for time in times if is_time_told(time)]
    lines = [(_mark(mark), code(log), code(stage), *cells) for mark, log, stage, *cells in told]
    return _folded("Times", [table(TIMES, lines) if lines else "", untold(times)])


def _origins(comparison: Comparison) -> str:
    cells = [(name, *map(code, others)) for name, *others in origin_cells(comparison)]
    logs = [tuple(map(code, line)) for line in log_cells(comparison)]
    reason = last_reason(comparison)
    return "\n\n".join(
        [
            table(ORIGINS, cells),
            *([table(LOGS, logs)] if logs else []),
            *([f"Latest reason in the history of BASE: {code(reason)}"] if reason else []),
        ]
    )


def _folded(title: str, parts: Sequence[str]) -> str:
    inside = "\n\n".join(part for part in parts if part)
    return f"<details><summary>{title}</summary>\n\n{inside}\n\n</details>"
