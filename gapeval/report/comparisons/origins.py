"""Where both results come from, as cells of a table."""

from collections.abc import Mapping

from gapeval.compare.outcome import Comparison, Origin
from gapeval.report.comparisons.words import plain

DIGITS = 12  # of a digest
ORIGINS = ("", "path", "gapeval", "revision", "source", "scorer")
LOGS = ("log", "sha256", "labels")


def origin_cells(comparison: Comparison) -> list[tuple[str, ...]]:
    """A line for BASE and one for NEW, under ORIGINS."""
    return [_origin("BASE", comparison.base), _origin("NEW", comparison.new)]


def log_cells(comparison: Comparison) -> list[tuple[str, str, str]]:
    """A line for each log of either, under LOGS: digests, BASE -> NEW where they differ."""
    base, new = comparison.base, comparison.new
    names = sorted({*base.logs, *new.logs, *base.labels, *new.labels})
    return [
        (plain(name), _digests(base.logs, new.logs, name), _digests(base.labels, new.labels, name))
        for name in names
    ]


def last_reason(comparison: Comparison) -> str:
    """Why a baseline was renewed last; nothing where BASE is none."""
    history = comparison.base.history
    return plain(str(history[-1].get("reason", ""))) if history else ""


def _origin(name: str, origin: Origin) -> tuple[str, ...]:
    commit, plus, changes = origin.revision.partition("+")
    revision = commit[:DIGITS] + plus + changes
    cells = (origin.path, origin.gapeval, revision, origin.source[:DIGITS], origin.scorer)
    return (name, *(plain(cell) or "-" for cell in cells))


def _digests(base: Mapping[str, str], new: Mapping[str, str], name: str) -> str:
    """Short, unless only all digits tell them apart."""
    was, now = base.get(name, ""), new.get(name, "")
    if was == now:
        return plain(was[:DIGITS]) or "-"
    digits = DIGITS if was[:DIGITS] != now[:DIGITS] else None
    return f"{plain(was[:digits]) or '-'} -> {plain(now[:digits]) or '-'}"
