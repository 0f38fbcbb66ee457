"""Rows that have but one thing to tell, for the same reasons: told once, not row by row."""

from collections.abc import Sequence
from dataclasses import dataclass

from gapeval.compare.outcome import MARKS, Mark, Row
from gapeval.report.comparisons.words import ROWS, is_told, parameters, plain
from gapeval.report.text import counted

NAMED = 8  # logs, and configurations of each, that a group names


@dataclass(frozen=True, slots=True)
class Group:
    """Rows that are not comparable, lost or new as a whole: of one mark and for the same reasons."""

    mark: Mark
    reasons: tuple[str, ...]
    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class Members:
    """Rows of a group: the same configurations on each of these logs, by their ids and what varies."""

    logs: tuple[str, ...]
    configurations: tuple[str, ...]


def is_whole(row: Row) -> bool:
    """Whether all there is to tell holds for the row as a whole."""
    return is_told(row) and not (row.changes or row.labels or row.frames)


def detailed(rows: Sequence[Row]) -> list[Row]:
    """Those that there is more to tell of."""
    return [row for row in rows if is_told(row) and not is_whole(row)]


def groups(rows: Sequence[Row]) -> list[Group]:
    """Of those that are whole, in the order of their first rows."""
    found: dict[tuple[Mark, tuple[str, ...]], list[Row]] = {}
    for row in filter(is_whole, rows):
        found.setdefault((row.mark, row.reasons), []).append(row)
    return [Group(mark, reasons, tuple(of)) for (mark, reasons), of in found.items()]


def why(group: Group) -> str:
    """The reasons, or what the mark means where there are none."""
    return plain("; ".join(group.reasons)) or MARKS[group.mark]


def members(group: Group, varied: Sequence[str]) -> list[Members]:
    """All rows of a group."""
    of_log: dict[str, list[str]] = {}
    for row in group.rows:
        name = f"{plain(row.configuration)} {parameters(row, varied)}".strip()
        of_log.setdefault(plain(row.log), []).append(name)
    alike: dict[tuple[str, ...], list[str]] = {}
    for log, names in of_log.items():
        alike.setdefault(tuple(names), []).append(log)
    return [Members(tuple(logs), names) for names, logs in alike.items()]


def first(names: Sequence[str], noun: str) -> str:
    """`a, b`, or the first 8 and how many more."""
    more = len(names) - NAMED
    shown = ", ".join(names[:NAMED])
    return f"{shown} and {counted(more, f'more {noun}')}" if more > 0 else shown


def member_lines(group: Group, varied: Sequence[str]) -> list[str]:
    """`street.mcap: 5ed457beaf20 n_o=1, a013f6f3d667 n_o=2`; of many logs the first, and how many more."""
    found = members(group, varied)
    lines = [f"{first(of.logs, 'log')}: {first(of.configurations, 'configuration')}" for of in found[:NAMED]]
    return lines + more_members(found)


def more_members(found: Sequence[Members]) -> list[str]:
    """How many rows are not named, or nothing."""
    more = sum(len(of.logs) * len(of.configurations) for of in found[NAMED:])
    return [f"... and {counted(more, 'more row')} of other logs"] if more else []


def more_groups(found: Sequence[Group]) -> list[str]:
    """How many rows are in groups beyond the first, or nothing."""
    more = sum(len(group.rows) for group in found[ROWS:])
    return [f"... and {counted(more, 'more row')} for other reasons; --format csv has all"] if more else []
