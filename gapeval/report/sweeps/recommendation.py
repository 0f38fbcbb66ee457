"""Which configuration of a sweep to use, and why."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from gapeval.report.text import short
from gapeval.results.store import badness
from gapeval.results.written import Row, number

NEAR = 0.02  # of pq, that count as equal where it has no interval


@dataclass(frozen=True, slots=True)
class Recommendation:
    """row: the configuration to use. best: the row of the highest pq. least: the pq that was demanded.

    by_interval: whether that is the lower end of the best one's interval. candidates: how many reach it.
    """

    row: Row
    best: Row
    least: float
    by_interval: bool
    candidates: int


def recommend(rows: Sequence[Row]) -> Recommendation | None:
    """Of all that are as good as the best within what pq can tell: the one that misses least.

    Among configurations whose pq reaches the lower end of the best one's interval (without one: that are
    within NEAR of it): highest hit_rate, then fewest fp_per_frame, smallest resolution, and at last what
    the best is chosen by, and the order of the rows. rows: of all logs together. None where no label was
    asked for.
    """
    scored = [row for row in rows if number(row, "pq") is not None]
    if not scored:
        return None
    best = min(scored, key=_badness)
    low = number(best, "pq_low")
    least = (number(best, "pq") or 0.0) - NEAR if low is None else low
    good = [row for row in scored if (number(row, "pq") or 0.0) >= least]
    return Recommendation(min(good, key=_aims), best, least, low is not None, len(good))


def _aims(row: Row) -> tuple[float, ...]:
    cells = (number(row, "i_height") or 0.0) * (number(row, "i_width") or 0.0)
    false = number(row, "fp_per_frame")
    return (
        -(number(row, "hit_rate") or 0.0),
        float("inf") if false is None else false,
        cells,
        *_badness(row),
    )


def _badness(row: Row) -> tuple[float, ...]:
    """As in the printed table and the column `best`."""
    return badness(partial(number, row))


def reason(found: Recommendation, configurations: int) -> str:
    """In words, with the figures."""
    if configurations == 1:
        return "It is the only configuration that was evaluated, so nothing was chosen."
    pq = f"{number(found.best, 'pq'):.3f}"
    if found.by_interval:
        high = number(found.best, "pq_high")
        end = "" if high is None else f" to {high:.3f}"
        tells = (
            f"The highest pq is {pq}, with a 95 % interval of {found.least:.3f}{end}, so that pq cannot tell "
            f"configurations from {found.least:.3f} on from the best"
        )
    else:
        tells = (
            f"The highest pq is {pq}; it has no interval, and what is within {NEAR:g} of it counts as equal"
        )
    if found.candidates == 1:
        return f"{tells}. No other configuration reaches that."
    others = (
        "it is also the one of the highest pq"
        if found.row["configuration"] == found.best["configuration"]
        else f"its own pq is {number(found.row, 'pq'):.3f}"
    )
    return (
        f"{tells}. {found.candidates} of {configurations} reach that. Among them this one has the highest "
        f"hit rate, then the fewest false gaps, then the smallest image; {others}."
    )


def difference(row: Row, best: Row) -> str:
    """How the configuration of the highest pq does beside another, in a sentence."""
    (hits, best_hits), (false, best_false) = (
        (number(row, name) or 0.0, number(best, name) or 0.0) for name in ("hit_rate", "fp_per_frame")
    )
    words = (
        f"The configuration of the highest pq is {best['configuration']}: {short(best_false)} false gaps per "
        f"frame against {short(false)} here, and a hit rate of {short(best_hits)} against {short(hits)}"
    )
    better = best_false < false and best_hits < hits
    return f"{words}; take it where a false gap costs more than a missed label." if better else f"{words}."
