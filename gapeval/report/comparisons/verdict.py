"""What came out, in one line."""

from collections.abc import Sequence

from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSIONS, Comparison, Mark, Row, Time
from gapeval.report.text import counted


def verdict(comparison: Comparison) -> str:
    """`fine: 48 rows, none worse`, `regression: 3 of 48 rows worse, 1 missing`, `not comparable: ...`.

    A row that is worse in one figure and lacks another counts in both words.
    """
    rows, times = comparison.rows, comparison.times
    if comparison.status == FINE:
        better = sum("-" in marks(row) for row in rows)
        return f"fine: {counted(len(rows), 'row')}, none worse" + (f", {better} better" if better else "")
    if comparison.status == NOT_COMPARABLE:
        parts = _of(len(rows), [(sum(map(is_incomparable, rows)), "")])
        parts += _counted_times(times, "x", "")
        return f"not comparable: {', '.join(parts)}; {_besides(rows, times)} besides"
    lacking = [row for row in rows if "!" in marks(row)]
    missing = sum(not row.new for row in lacking)
    words = [
        (sum("+" in marks(row) for row in rows), " worse"),
        (missing, " missing"),
        (len(lacking) - missing, " with figures that are no longer defined"),
    ]
    parts = _of(len(rows), words)
    parts += _counted_times(times, "+", " over its limit") + _counted_times(times, "!", " no longer measured")
    return f"regression: {', '.join(parts)}"


def marks(row: Row) -> set[Mark]:
    """Of a row and of its figures."""
    return {row.mark, *(change.mark for change in row.changes)}


def is_incomparable(row: Row) -> bool:
    return "x" in marks(row)


def is_regression(row: Row) -> bool:
    """Whether a row is worse or lacks anything, comparable or not."""
    return not marks(row).isdisjoint(REGRESSIONS)


def _of(rows: int, words: Sequence[tuple[int, str]]) -> list[str]:
    """`3 of 48 rows worse`, `1 missing`: the first says of how many."""
    parts = [(number, word) for number, word in words if number]
    return [
        f"{number}{word}" if place else f"{number} of {counted(rows, 'row')}{word}"
        for place, (number, word) in enumerate(parts)
    ]


def _counted_times(times: Sequence[Time], mark: Mark, word: str) -> list[str]:
    number = sum(time.mark == mark for time in times)
    word = word.replace("its", "their") if number > 1 else word
    return [counted(number, "time") + word] if number else []


def _besides(rows: Sequence[Row], times: Sequence[Time]) -> str:
    number = sum(map(is_regression, rows)) + sum(time.mark in REGRESSIONS for time in times)
    return counted(number, "regression") if number else "no regression"
