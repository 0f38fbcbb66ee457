"""Rows of both results, joined on log and parameters, and what became of each."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from gapeval.compare.limits import WORSE, Limits, Way
from gapeval.compare.outcome import MARKS, TOLERANCE, Change, Mark, Row
from gapeval.compare.side import Side
from gapeval.errors import GapevalError
from gapeval.results.figures import ASKED, FIGURES
from gapeval.results.store import ALL
from gapeval.results.tables import PARAMETERS
from gapeval.results.written import Row as Texts
from gapeval.results.written import number

DECIDES_INTERVALS = ("block",)  # of scoring, which no figure depends on


@dataclass(frozen=True, slots=True)
class Joined:
    """The same log and parameters in both; at least one of them is there."""

    log: str
    base: Texts | None
    new: Texts | None


def joined(base: Side, new: Side) -> list[Joined]:
    """In the order of BASE, then what is in NEW alone."""
    names = [name for name in PARAMETERS if name in base.rows[0] and name in new.rows[0]]
    # What is no column may be swept, too: then the configuration's id tells rows apart.
    keys = [
        [(row["log"], *(_normal(row[name]) for name in names)) for row in side.rows] for side in (base, new)
    ]
    several = {key for each in keys for key, count in Counter(each).items() if count > 1}
    before, after = (
        {
            (key, row["configuration"] if key in several else ""): row
            for key, row in zip(each, side.rows, strict=True)
        }
        for each, side in zip(keys, (base, new), strict=True)
    )
    return [Joined(key[0][0], before.get(key), after.get(key)) for key in dict.fromkeys((*before, *after))]


def _normal(text: str) -> str:
    try:
        return repr(float(text))
    except ValueError:
        return text


def judged(pair: Joined, base: Side, new: Side, limits: Limits, objection: "Objection") -> Row:
    """A row without what is known of its frames. objection: against its log."""
    before, after = _figures(pair.base, base), _figures(pair.new, new)
    row = pair.new or pair.base or {}
    mark, reasons = _as_a_whole(pair, objection)
    changes = () if mark is not None else _changes(before, after, limits)
    return Row(
        pair.log,
        row["configuration"],
        {name: row.get(name, "") for name in PARAMETERS},
        mark or _worst(changes),
        reasons,
        before,
        after,
        changes,
        was=pair.base["configuration"] if pair.base else "",
    )


def _as_a_whole(pair: Joined, objection: "Objection") -> tuple[Mark | None, tuple[str, ...]]:
    """x, ! or * where figures are not held against each other, with reasons."""
    if objection.mark == "x":
        return "x", objection.reasons
    if pair.new is None:
        return "!", ("not in NEW",)
    if pair.base is None:
        return "*", ("not in BASE",)
    if objection.mark is not None:
        return objection.mark, objection.reasons
    asked = [(name, *(row.get(name, "") for row in (pair.base, pair.new))) for name in ASKED]
    other = tuple(
        f"{name}: {before or '-'} -> {after or '-'}, though labels and scoring are the same"
        for name, before, after in asked
        if _normal(before) != _normal(after)
    )
    return ("x", other) if other else (None, ())


def _figures(row: Texts | None, side: Side) -> dict[str, float | None]:
    """Empty for a missing row. Raises GapevalError."""
    try:
        found = {} if row is None else {name: number(row, name) for name in FIGURES if name in row}
    except GapevalError as error:
        raise GapevalError(f"{side.origin.path}: {error}") from error
    for name, value in found.items():
        if value is not None and not math.isfinite(value):
            raise GapevalError(f"{side.origin.path}: {name} is {value}; make the results again")
    return found


def _changes(
    before: Mapping[str, float | None], after: Mapping[str, float | None], limits: Limits
) -> tuple[Change, ...]:
    # A figure without a column in NEW is lost; one without a column in BASE is held against nothing.
    found = [
        change
        for name, value in before.items()
        if (change := _change(name, value, after.get(name), limits)) is not None
    ]
    return tuple(sorted(found, key=_severity))


def rank(mark: Mark) -> int:
    """0 for the worst."""
    return tuple(MARKS).index(mark)


def _severity(change: Change) -> tuple[int, float]:
    return rank(change.mark), -size(change)


def size(change: Change) -> float:
    """How large a change is, from 0 to 2, as a share of the larger value; 1 where a side is undefined.

    Without last bits, which would sort equal changes otherwise on another machine.
    """
    if change.base is None or change.new is None:
        return 1.0
    share = abs(change.new - change.base) / max(abs(change.base), abs(change.new), TOLERANCE)
    return round(share, 9)


def _change(metric: str, base: float | None, new: float | None, limits: Limits) -> Change | None:
    """None where nothing has changed."""
    better = FIGURES[metric].better
    if base is None or new is None:
        if base is new:
            return None
        # Nothing is lost where nothing was right: no gaps at all have no precision.
        lost = new is None and better != "none" and not (better == "higher" and base == 0)
        return Change(metric, "!" if lost else "*" if base is None else "~", base, new, math.inf)
    if abs(new - base) <= TOLERANCE * max(1.0, abs(base), abs(new)):
        return None
    way: Way = "drop" if new < base else "rise"
    limit = limits.allowed(metric, way, base)
    mark: Mark = "-"
    if better == "none" or way in WORSE[better]:
        mark = "+" if abs(new - base) > limit + TOLERANCE else "~"
    return Change(metric, mark, base, new, limit)


def _worst(changes: tuple[Change, ...]) -> Mark:
    return min((change.mark for change in changes), key=rank, default=" ")


@dataclass(frozen=True, slots=True)
class Objection:
    """Why the rows of a log are not held against each other; without a mark: they are."""

    mark: Mark | None
    reasons: tuple[str, ...]


def objections(base: Side, new: Side) -> dict[str, Objection]:
    """Of each log in either, and of all together."""
    logs = sorted(base.logs | new.logs)
    found = {log: _objection(base, new, log) for log in logs}
    against_all = list(_of_all(base, new))
    for log in sorted(base.logs & new.logs):
        one = found[log]
        if one.mark is not None:
            against_all += [(one.mark, why if len(logs) == 1 else f"{log}: {why}") for why in one.reasons]
    worst = min((mark for mark, _ in against_all), key=rank, default=None)
    return found | {ALL: Objection(worst, tuple(reason for _, reason in against_all))}


def _of_all(base: Side, new: Side) -> Iterator[tuple[Mark, str]]:
    for log in sorted(base.logs - new.logs):
        yield "!", f"{log} is not in NEW"
    for log in sorted(new.logs - base.logs):
        yield "x", f"{log} is not in BASE"


def _objection(base: Side, new: Side, log: str) -> Objection:
    unlike = tuple(_unlike(base, new, log))
    if unlike:
        return Objection("x", unlike)
    if log in new.failed:
        return Objection("!", (f"NEW: {new.failed[log]}",))
    if log in base.failed:
        return Objection("*", (f"BASE: {base.failed[log]}",))
    contents = [side.origin.logs.get(log, "") for side in (base, new)]
    if log in base.logs & new.logs and contents[0] != contents[1]:
        return Objection("x", (f"other contents of the log: {_short(contents[0])} -> {_short(contents[1])}",))
    return Objection(None, ())


def _unlike(base: Side, new: Side, log: str) -> Iterator[str]:
    """What is scored otherwise."""
    for name, side in (("BASE", base), ("NEW", new)):
        if side.scoring is None:
            yield f"what {name} was made from is not known: no manifest.json that says so is beside it"
    if base.scoring is None or new.scoring is None:
        return
    if base.origin.scorer != new.origin.scorer:
        yield f"other scorer: version {base.origin.scorer or '-'} -> {new.origin.scorer or '-'}"
    for key in sorted({*base.scoring, *new.scoring} - {*DECIDES_INTERVALS}):
        before, after = base.scoring.get(key), new.scoring.get(key)
        if before != after:
            yield f"scoring.{key}: {_text(before)} -> {_text(after)}"
    labels = [side.origin.labels.get(log, "") for side in (base, new)]
    if log in base.logs & new.logs and labels[0] != labels[1]:
        yield f"other labels: {_short(labels[0])} -> {_short(labels[1])}"


def _short(digest: str) -> str:
    return digest[:12] or "none"


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name}: {_text(of)}" for name, of in value.items()) + "}"
    return "-" if value is None else str(value)
