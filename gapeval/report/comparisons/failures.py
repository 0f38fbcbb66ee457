"""What fails the gate, and what is said of it."""

from gapeval.compare.outcome import MARKS, REGRESSIONS, Comparison, Mark, Row, Time
from gapeval.report.comparisons.groups import Group, detailed, groups
from gapeval.report.comparisons.times import time_sentence
from gapeval.report.comparisons.verdict import marks
from gapeval.report.comparisons.words import label_sentences, plain, sentence
from gapeval.report.text import counted

WORDS: dict[Mark, str] = {
    "x": "not comparable",
    "!": "lost",
    "+": "worse",
    "-": "better",
    "*": "new",
    "~": "changed",
    " ": "the same",
}
FAILURES: tuple[Mark, ...] = ("x", *REGRESSIONS)
RANK = {mark: rank for rank, mark in enumerate(MARKS)}


def failures(comparison: Comparison) -> list[Row | Group | Time]:
    """What is not comparable or worse, worst first: rows that share their reasons, rows, times."""
    found: list[Row | Group | Time] = [
        *(of if len(of.rows) > 1 else of.rows[0] for of in groups(comparison.rows)),
        *detailed(comparison.rows),
        *comparison.times,
    ]
    return sorted((one for one in found if worst(one) in FAILURES), key=lambda one: RANK[worst(one)])


def worst(one: Row | Group | Time) -> Mark:
    """The worst mark of a row and of its figures, or that of a group or time."""
    return min(marks(one), key=RANK.__getitem__) if isinstance(one, Row) else one.mark


def account(one: Row | Time, figures: int | None = None) -> list[str]:
    """Lines: reasons, the figures that fail, worst first, labels. figures: no more of them than so many."""
    if isinstance(one, Time):
        return [f"{WORDS[one.mark]}: {time_sentence(one)}"]
    changes = [change for change in one.changes if change.mark in FAILURES]
    lines = [f"{WORDS[one.mark]}: {plain('; '.join(one.reasons))}"] if one.reasons else []
    lines += [f"{WORDS[change.mark]}: {sentence(change)}" for change in changes[:figures]]
    if figures is not None and len(changes) > figures:
        lines.append(f"... and {counted(len(changes) - figures, 'more figure')}")
    return [*(lines or [WORDS[one.mark]]), *label_sentences(one)]
