"""Seconds of both results, stage by stage: shown, and held against nothing but limits that were given."""

from collections.abc import Iterator

from gapeval.compare.limits import TIME, Limits
from gapeval.compare.outcome import Mark, Spread, Time
from gapeval.compare.side import Side


def times(base: Side, new: Side, limits: Limits) -> tuple[Time, ...]:
    """Of each log: all stages together first. Without a side that has any: only what has a limit."""
    return tuple(_times(base, new, limits))


def _times(base: Side, new: Side, limits: Limits) -> Iterator[Time]:
    for log in sorted(base.logs & new.logs):
        before, after = base.times.get(log, {}), new.times.get(log, {})
        for stage in dict.fromkeys((*before, *after, *limits.stages)):
            metric = stage if stage == TIME else f"{TIME}.{stage}"
            yield _time(log, stage, before.get(stage), after.get(stage), metric, limits)


def _time(log: str, stage: str, base: Spread | None, new: Spread | None, metric: str, limits: Limits) -> Time:
    limit = limits.allowed(metric, "rise", base.median if base else 0.0)
    mark: Mark = " "
    if limits.given(metric, "rise") is not None:
        if base is None or new is None:
            mark = "x"  # what is to be held against the limit is not there
        elif new.median > base.median + limit:
            mark = "+"
    return Time(log, stage, mark, base, new, limit)
