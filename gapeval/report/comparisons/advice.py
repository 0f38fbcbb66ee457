"""What to do where a comparison fails."""

import shlex

from gapeval.compare.outcome import FINE, NOT_COMPARABLE, Comparison, Row
from gapeval.report.comparisons.words import plain


def advice(comparison: Comparison) -> str:
    """One line, after which the command of `renewal` stands, if there is one; nothing where all is fine."""
    if comparison.status == FINE:
        return ""
    renewed = bool(renewal(comparison))
    if comparison.status == NOT_COMPARABLE and renewed:
        return (
            "the reasons say what differs; put back what is a mistake, or renew the baseline "
            "(docs/ci.md says more):"
        )
    if comparison.status == NOT_COMPARABLE:
        return "the reasons say what differs; put back what is a mistake; docs/ci.md says more"
    if renewed:
        return "mend it; or, if that is how it is meant to be, renew the baseline:"
    if any(map(_is_incomplete, comparison.rows)):
        return "mend why frames failed, and finish the sweep: gapeval sweep --resume"
    return "mend it; or, where that much is nothing to you, allow it: --max-drop, --max-rise"


def renewal(comparison: Comparison) -> str:
    """The command that makes NEW the baseline; nothing where BASE is none, or NEW cannot be made one."""
    base, new = comparison.base, comparison.new
    is_folder = bool(new.scorer) and not new.history
    if comparison.status == FINE or not base.history or not is_folder:
        return ""
    if any(map(_is_incomplete, comparison.rows)):
        return ""
    return plain(f'gapeval baseline {shlex.quote(new.path)} -o {shlex.quote(base.path)} --reason "..."')


def _is_incomplete(row: Row) -> bool:
    """Whether it was not evaluated on all frames of NEW, though it is there."""
    return row.mark == "!" and bool(row.new) and not row.changes
