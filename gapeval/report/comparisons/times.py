"""Times of both results: which are worth a line, and its cells."""

import math
from collections.abc import Sequence

from gapeval.compare.outcome import Spread, Time
from gapeval.report.comparisons.words import plain
from gapeval.report.text import counted, short

TIMES = ("", "log", "stage", "median [ms]", "95 % [ms]", "NEW / BASE")


def shown_times(times: Sequence[Time]) -> list[Time]:
    """Those that people are shown or told the number of: all, or where a side has none, what a mark fails."""
    if any(time.base for time in times) and any(time.new for time in times):
        return list(times)
    return [time for time in times if _is_marked(time)]


def is_told(time: Time) -> bool:
    """`time` of each log, what its mark names, and stages that differ by more than their samples do."""
    return time.stage == "time" or _is_marked(time) or is_beyond_spread(time)


def _is_marked(time: Time) -> bool:
    return time.mark not in (" ", "~")


def is_beyond_spread(time: Time) -> bool:
    """Whether the slower median lies above 95 % of the faster's samples."""
    if time.base is None or time.new is None:
        return False
    faster, slower = sorted((time.base, time.new), key=lambda spread: spread.median)
    return slower.median > faster.p95


def untold(times: Sequence[Time]) -> str:
    """How many others there are, or nothing."""
    others = [time for time in times if not is_told(time)]
    single = sum(time.base is None or time.new is None for time in others)
    parts = [
        (len(others) - single, "within the spread of their own samples"),
        (single, "in BASE or NEW alone"),
    ]
    return ", ".join(f"{counted(number, 'other stage')} {words}" for number, words in parts if number)


def time_cells(time: Time) -> tuple[str, ...]:
    """A line under TIMES; the limit stands behind the ratio, where there is one."""
    ratio = "-"
    if time.base is not None and time.new is not None and time.base.median > 0:
        ratio = f"{time.new.median / time.base.median:.3g}"
    medians = f"{_median(time.base)} -> {_median(time.new)}"
    ends = " -> ".join("-" if spread is None else _ms(spread.p95) for spread in (time.base, time.new))
    return (time.mark.strip(), plain(time.log), plain(time.stage), medians, ends, ratio + _allowed(time))


def time_sentence(time: Time) -> str:
    """`time 2.1 ms -> 4 ms in the median (0.5 ms more allowed)`."""
    medians = f"{_median(time.base)} -> {_median(time.new)}"
    return f"{plain(time.metric)} [ms] {medians} in the median{_allowed(time)}"


def _allowed(time: Time) -> str:
    return f" ({_ms(time.limit)} ms more allowed)" if math.isfinite(time.limit) else ""


def _median(spread: Spread | None) -> str:
    return "-" if spread is None else _ms(spread.median)


def _ms(seconds: float) -> str:
    return short(1e3 * seconds)
