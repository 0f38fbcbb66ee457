"""What the marks mean that people see."""

from gapeval.compare.outcome import MARKS, Comparison, Mark
from gapeval.report.comparisons.groups import detailed, groups
from gapeval.report.comparisons.overview import standings
from gapeval.report.comparisons.times import is_told, shown_times
from gapeval.report.comparisons.words import ROWS, told_changes


def legend(comparison: Comparison) -> list[tuple[Mark, str]]:
    """Each mark that occurs, with its meaning, worst first."""
    rows = detailed(comparison.rows)[:ROWS]
    seen = {row.mark for row in rows} | {change.mark for row in rows for change in told_changes(row)}
    seen |= {group.mark for group in groups(comparison.rows)[:ROWS]}
    seen |= {one.change.mark for one in standings(comparison.rows)}
    seen |= {time.mark for time in shown_times(comparison.times) if is_told(time)}
    return [(mark, meaning) for mark, meaning in MARKS.items() if mark in seen and mark != " "]
