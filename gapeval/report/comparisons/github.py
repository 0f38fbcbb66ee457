"""A comparison for GitHub Actions: annotations of a step, and its summary."""

from gapeval.compare.outcome import FINE, Comparison, Row, Time
from gapeval.report.comparisons.failures import WORDS, account, failures
from gapeval.report.comparisons.groups import Group, member_lines, why
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import named, plain
from gapeval.report.text import counted

ANNOTATIONS = 10  # of each kind that GitHub shows of a step; it drops the others
FIGURES = 10  # of a row that an annotation names
SUMMARY = 1024 * 1024  # bytes that GitHub takes of a step; it drops the whole summary above
FOLD = "<details>"
UNFOLD = "</details>"
CUT = "\n... cut here, {} more lines; --format md has all\n"


def annotations(comparison: Comparison) -> str:
    """An error for what fails, worst first, and the verdict as the last line.

    One for each row and time, and one for all rows that fail for the same reasons. Of more than 10, the 10th
    says how many more rows and times there are. Nothing but the verdict where all is fine.
    """
    if comparison.status == FINE:
        return verdict(comparison) + "\n"
    found = failures(comparison)
    shown = found if len(found) <= ANNOTATIONS else found[: ANNOTATIONS - 1]
    lines = [
        _error(f"gapeval: {_title(one, comparison)}", "\n".join(_message(one, comparison))) for one in shown
    ]
    if more := sum(map(_count, found[len(shown) :])):
        lines.append(_error("gapeval compare", f"{more} more are worse or not comparable; see the summary"))
    return "\n".join([*lines, verdict(comparison)]) + "\n"


def _title(one: Row | Group | Time, comparison: Comparison) -> str:
    if isinstance(one, Row):
        return named(one, comparison.varied)
    if isinstance(one, Time):
        return plain(one.log)
    logs = list(dict.fromkeys(row.log for row in one.rows))
    return f"{counted(len(one.rows), 'row')} of {plain(logs[0]) if len(logs) == 1 else f'{len(logs)} logs'}"


def _message(one: Row | Group | Time, comparison: Comparison) -> list[str]:
    if isinstance(one, Group):
        return [f"{WORDS[one.mark]}: {why(one)}", *member_lines(one, comparison.varied)]
    return account(one, FIGURES)


def _count(one: Row | Group | Time) -> int:
    return len(one.rows) if isinstance(one, Group) else 1


def step_summary(comparison: Comparison, room: int = SUMMARY) -> str:
    """Markdown in fewer bytes of UTF-8 than there is room for; cut after a line, it says how much is cut.

    room: SUMMARY less what the step's summary already holds. It begins with a line break, which ends what
    is already there. Empty where there is no room even to say that all is cut.
    """
    whole = "\n" + markdown(comparison)
    if len(whole.encode()) < room:
        return whole
    lines = whole.splitlines(keepends=True)
    left = room - 1 - len(f"{UNFOLD}\n{CUT.format(len(lines))}".encode())
    kept = 0
    while left >= (size := len(lines[kept].encode())):
        left -= size
        kept += 1
    if not kept:
        return ""
    folds = [line for line in lines[:kept] if line.startswith((FOLD, UNFOLD))]
    closing = f"{UNFOLD}\n" if folds and folds[-1].startswith(FOLD) else ""
    return "".join(lines[:kept]) + closing + CUT.format(len(lines) - kept)


def _error(title: str, message: str) -> str:
    """A workflow command; what would end it, or its title, is escaped."""
    message = message.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    title = title.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")
    return f"::error title={title.replace(':', '%3A').replace(',', '%2C')}::{message}"
