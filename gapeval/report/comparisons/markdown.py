"""A comparison as GitHub-flavoured Markdown."""

import re
import string
from collections.abc import Sequence

from gapeval.compare.outcome import Change, Comparison, Row
from gapeval.report.comparisons.origins import LOGS, ORIGINS, last_reason, log_cells, origin_cells
from gapeval.report.comparisons.times import TIMES, time_cells, untold
from gapeval.report.comparisons.times import is_told as is_time_told
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import (
    LABELS,
    ROWS,
    asides,
    difference,
    frames_run,
    is_aside,
    is_told,
    metric_and_unit,
    noise_words,
    occurring,
    pair,
    plain,
    unknowns,
)
from gapeval.report.text import counted

Cells = Sequence[str]
AWKWARD = re.compile(r"[`|\\]|^\s|\s$")  # in a code span, or in one within a table
ENTITIES = {ord(sign): f"&#{ord(sign)};" for sign in string.punctuation}


def markdown(comparison: Comparison) -> str:
    """The verdict first: a page is read from its head. Then as for the terminal, in tables; times are folded.

    Names of logs and labels, paths and reasons stand as code: whatever is in them, they neither break a table
    nor call anybody.
    """
    rows = [row for row in comparison.rows if is_told(row)]
    more = len(rows) - ROWS
    parts = [
        "## gapeval compare",
        f"**{verdict(comparison)}**",
        "\n".join(f"* {code(notice)}" for notice in comparison.notices),
        _changes(rows[:ROWS], comparison.varied) if rows else "No figure changed.",
        f"... and {counted(more, 'more row')}; `--format csv` has all" if more > 0 else "",
        "\n".join(f"* {code(reason)}" for reason in unknowns(rows[:ROWS])),
        _labels(rows[:ROWS], comparison.varied),
        _legend(comparison, rows[:ROWS]),
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


def _changes(rows: Sequence[Row], varied: Sequence[str]) -> str:
    head = ("", "log", "configuration", *map(code, varied), "metric", "base", "new", "change", "noise")
    return table(head, [line for row in rows for line in _lines(row, varied)])


def _lines(row: Row, varied: Sequence[str]) -> list[Cells]:
    """A line for each changed metric; before them one with what holds for the whole row."""
    names = _names(row, varied)
    whole = [code("; ".join(row.reasons))] if row.reasons else []
    if row.frames:
        whole.append(f"changed in {counted(len(row.frames), 'frame')}: {frames_run(row.frames)}")
    if counts := asides(row):
        whole.append(counts)
    told = [change for change in row.changes if not is_aside(change)]
    lines: list[Cells] = []
    if whole or not told:
        lines.append((_mark(row.mark), *names, "; ".join(whole), "", "", "", ""))
    return lines + [(_mark(change.mark), *names, *_figure(change)) for change in told]


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


def _legend(comparison: Comparison, rows: Sequence[Row]) -> str:
    found = occurring(rows, [time for time in comparison.times if is_time_told(time)])
    return "; ".join(f"{_mark(mark)} {meaning}" for mark, meaning in found)


def _mark(mark: str) -> str:
    return code(mark.strip())


def _times(comparison: Comparison) -> str:
    if not comparison.times:
        return ""
    told = [time_cells(time) for time in comparison.times if is_time_told(time)]
    lines = [(_mark(mark), code(log), code(stage), *cells) for mark, log, stage, *cells in told]
    return _folded("Times", [table(TIMES, lines) if lines else "", untold(comparison.times)])


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
