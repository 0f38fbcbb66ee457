"""How sure figures are: 95 % intervals, mostly from blocks of time that are drawn anew.

Frames that follow each other see the same ground, so that single frames, drawn anew, would claim too much.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray
from gapeval.scoring.metrics import WITHOUT_LABELS, Metric, figure

REPLICATES = 500
TAIL = 0.025  # on each side
LEAST_BLOCKS = 10  # of time; with fewer there is no interval
LEAST_LOGS = 5  # from which on whole logs are drawn, not blocks of each
MOST_UNDEFINED = 0.05  # share of the replicates without the figure: it rests on too few blocks

Stamps = NDArray[np.int64]
Seed = int | Sequence[int]
Things = FloatArray | IndexArray | int  # how many


def block_draws(stamps: Stamps, block: float, seed: Seed) -> NDArray[np.uint8]:
    """How often each frame counts in each replicate, (REPLICATES, n): blocks that begin at any time.

    stamps: (n,) ascending [ns]; block [s]. As many blocks as fit, at the end they go on at the beginning, so
    that each frame counts once on average. A pause longer than a block is as long as one.
    """
    at, whole = _without_pauses(stamps, block)
    length = min(_nanoseconds(block), whole)
    number = max(1, round(whole / length)) if len(stamps) else 0
    starts = np.random.default_rng(seed).integers(0, max(whole, 1), (REPLICATES, number))
    weights = np.empty((REPLICATES, len(stamps)), dtype=np.uint8)
    for start, weight in zip(starts, weights, strict=True):
        ends = np.concatenate([start + length, start + length - whole])  # the second where it goes on
        steps = np.bincount(np.searchsorted(at, start), minlength=len(at) + 1)
        steps -= np.bincount(np.searchsorted(at, ends), minlength=len(at) + 1)
        steps[0] += number
        weight[:] = np.cumsum(steps)[:-1]
    return weights


def blocks(stamps: Stamps, block: float) -> IndexArray:
    """In which block each frame lies, of blocks one after the other, (n,); in none of them lies no frame."""
    at, _ = _without_pauses(stamps, block)
    return (at // _nanoseconds(block)).astype(np.intp)


def _without_pauses(stamps: Stamps, block: float) -> tuple[Stamps, int]:
    """When each frame is, and all is over [ns], with each pause as long as a block at most."""
    steps = np.minimum(np.diff(stamps), _nanoseconds(block))
    at = np.concatenate([np.zeros(min(len(stamps), 1), dtype=np.int64), np.cumsum(steps)])
    last = int(np.median(steps)) if len(steps) else _nanoseconds(block)
    return at, int(at[-1]) + max(last, 1) if len(at) else 0


def _nanoseconds(seconds: float) -> int:
    return max(1, round(seconds * 1e9))


def log_draws(count: int, seed: Seed) -> NDArray[np.uint8]:
    """How often each of so many logs counts in each replicate, (REPLICATES, count)."""
    drawn = np.random.default_rng(seed).integers(0, max(count, 1), (REPLICATES, count))
    weights: NDArray[np.uint8] = (drawn[:, :, None] == np.arange(count)).sum(axis=1, dtype=np.uint8)
    return weights


def interval(replicates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The middle 95 % of replicates (B, ...): low and high, (...). NaN where too many of them are NaN."""
    ordered = np.sort(replicates, axis=0)  # NaN last
    defined = len(ordered) - np.isnan(ordered).sum(axis=0)
    enough = defined >= (1 - MOST_UNDEFINED) * len(ordered)
    low, high = (_quantile(ordered, defined, share) for share in (TAIL, 1 - TAIL))
    return np.where(enough, low, np.nan), np.where(enough, high, np.nan)


def _quantile(ordered: FloatArray, defined: IndexArray, share: float) -> FloatArray:
    """Of the first `defined` of each column, linear between neighbours."""
    place = share * np.maximum(defined - 1, 0)
    below = np.floor(place).astype(np.intp)
    above = np.minimum(below + 1, len(ordered) - 1)
    one, other = (np.take_along_axis(ordered, at[None], axis=0)[0] for at in (below, above))
    part = place - below
    between: FloatArray = one + np.where(part > 0, part * (other - one), 0.0)
    return between


def share_limits(shares: FloatArray, things: Things) -> tuple[FloatArray, FloatArray]:
    """Clopper and Pearson's limits of shares of so many things that are exactly 0 or 1; else NaN."""
    with np.errstate(divide="ignore"):
        tail = np.where(np.asarray(things) > 0, TAIL ** (1 / np.asarray(things, dtype=np.float64)), np.nan)
    none, all_ = shares == 0, shares == 1
    low = np.where(none, 0.0 * tail, np.where(all_, tail, np.nan))
    return low, np.where(none, 1 - tail, np.where(all_, 1 + 0.0 * tail, np.nan))


def event_limits(rates: FloatArray, things: Things) -> tuple[FloatArray, FloatArray]:
    """The exact Poisson limits of rates in so many things that are exactly 0; else NaN."""
    with np.errstate(divide="ignore"):
        most = np.where(np.asarray(things) > 0, -np.log(TAIL) / np.asarray(things, dtype=np.float64), np.nan)
    return np.where(rates == 0, 0.0 * most, np.nan), np.where(rates == 0, most, np.nan)


def limits(
    metric: Metric,
    values: FloatArray,
    replicates: FloatArray | None,
    things: Mapping[str, Things],
) -> tuple[FloatArray, FloatArray]:
    """The interval of a metric's values (C,), from its replicates (B, C) if there are enough blocks for them.

    things: how many independent ones there are of what metrics count, see Metric.counts.
    """
    low, high = np.full((2, *values.shape), np.nan)
    if replicates is not None:
        low, high = interval(replicates)
        low, high = np.where(np.isnan(values), np.nan, low), np.where(np.isnan(values), np.nan, high)
    if metric.counts != "nothing":
        of = event_limits if metric.counts == "events" else share_limits
        exact = of(values, things["blocks" if metric.counts == "events" else metric.counts])
        low, high = (
            np.where(np.isnan(one), other, one) for one, other in zip(exact, (low, high), strict=True)
        )
    return low, high


@dataclass(slots=True, eq=False)
class Counted:
    """Independent things behind figures. labels: distinct ones that were asked for; judged: (C,) of them.

    blocks, scored_blocks: of time (or logs, where whole ones are drawn), in which a frame was evaluated, or
    scored.
    """

    judged: IndexArray
    labels: int = 0
    blocks: int = 0
    scored_blocks: int = 0

    def include(self, other: "Counted") -> None:
        self.judged += other.judged
        self.labels += other.labels
        self.blocks += other.blocks
        self.scored_blocks += other.scored_blocks


def figure_with_limits(
    metric: Metric,
    sums: Mapping[str, FloatArray],
    drawn: Callable[[str], NDArray[np.floating]],
    counted: Counted,
    least: int,
) -> tuple[FloatArray, FloatArray | None, FloatArray]:
    """A metric (C,), its value in each draw (B, C) where there are enough blocks, and its limits (2, C).

    sums: (C,) of each. drawn: the replicates of a sum, (B, C) or (B, 1). least: as many blocks as it takes.
    """
    values = figure(metric, sums)
    number = counted.blocks if set(metric.below) <= set(WITHOUT_LABELS) else counted.scored_blocks
    replicates = None
    if number >= least:
        each = figure(metric, {name: drawn(name) for name in (*metric.above, *metric.below)})
        replicates = np.broadcast_to(each, (REPLICATES, len(values)))
    things: dict[str, Things] = {"labels": counted.labels, "judged": counted.judged, "blocks": number}
    return values, replicates, np.stack(limits(metric, values, replicates, things))


def needed(metrics: Sequence[Metric]) -> tuple[str, ...]:
    """The sums that metrics are made from."""
    return tuple(dict.fromkeys(name for metric in metrics for name in (*metric.above, *metric.below)))
