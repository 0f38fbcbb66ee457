"""A comparison as CSV: a line for each change."""

import math
from collections.abc import Iterable

from gapeval.compare.outcome import Change, Comparison, Row, Time
from gapeval.report.comparisons.words import noise_word

FIGURES = (
    "mark",
    "metric",
    "base",
    "new",
    "difference",
    "limit",
    "noise_low",
    "noise_high",
    "noise",
    "reason",
)
SPECIAL = frozenset(',"\r\n')


def as_csv(comparison: Comparison) -> str:
    """Every row, without end; floats as repr, an empty field for what is undefined, unknown or without limit.

    A line for each changed figure, with why its noise is not known, if it is not. A row of which something
    holds as a whole has a line before them, without a metric, with its own mark and reasons; so has one that
    is the same. Times have the median as `base` and `new`, and neither configuration nor parameters; those of
    one side alone are left out, unless they are marked.
    """
    varied = comparison.varied
    lines = [",".join(map(_field, ("log", "configuration", *varied, *FIGURES)))]
    for row in comparison.rows:
        names = (row.log, row.configuration, *(row.parameters.get(name, "") for name in varied))
        head = ",".join(map(_field, names))
        if row.reasons or not row.changes:
            lines.append(",".join((head, *_whole(row))))
        lines += [",".join((head, *_change(change))) for change in row.changes]
    empty = [""] * (1 + len(varied))
    lines += [
        ",".join((_field(time.log), *empty, *_time(time))) for time in filter(_is_told, comparison.times)
    ]
    return "\n".join(lines) + "\n"


def _whole(row: Row) -> Iterable[str]:
    return (row.mark, *[""] * (len(FIGURES) - 2), _field("; ".join(row.reasons)))


def _change(change: Change) -> Iterable[str]:
    noise = change.noise
    return (
        change.mark,
        _field(change.metric),
        _number(change.base),
        _number(change.new),
        _number(change.difference),
        _number(change.limit),
        _number(noise.low) if noise else "",
        _number(noise.high) if noise else "",
        noise_word(noise),
        _field(noise.unknown) if noise else "",
    )


def _is_told(time: Time) -> bool:
    return time.mark != " " or (time.base is not None and time.new is not None)


def _time(time: Time) -> Iterable[str]:
    base = None if time.base is None else time.base.median
    new = None if time.new is None else time.new.median
    difference = None if base is None or new is None else new - base
    figures = (base, new, difference, time.limit)
    return (time.mark, _field(time.metric), *map(_number, figures), "", "", "", "")


def _number(value: float | None) -> str:
    return repr(value) if value is not None and math.isfinite(value) else ""


def _field(text: str) -> str:
    """As readers of CSV take it back, also with `\\r`; what is no UTF-8 is spelt out."""
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return text if SPECIAL.isdisjoint(text) else '"' + text.replace('"', '""') + '"'
