"""Whether a change is more than other frames would bring: paired, over blocks of time.

Both results have seen the same frames. So the same blocks are drawn for both, and what is looked at is the
difference, figure by figure, as it would have been had those stretches been recorded.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.compare.frames import LogFrames
from gapeval.compare.outcome import Noise
from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray
from gapeval.results.figures import Figure
from gapeval.results.tally import SEED
from gapeval.scoring.intervals import (
    LEAST_BLOCKS,
    LEAST_LOGS,
    block_draws,
    blocks,
    interval,
    log_draws,
)
from gapeval.scoring.metrics import WITHOUT_LABELS

NAN = float("nan")
FITTING = 1e-6  # share of a figure by which its frames may miss it
Places = IndexArray | slice


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One log in both results: the same frames F, the same rows C.

    weights: (REPLICATES, F), how often each frame was drawn with its block of time.

    evaluated, scored: in how many blocks there are such frames.
    """

    base: LogFrames
    new: LogFrames
    weights: NDArray[np.floating]
    evaluated: int
    scored: int


def pair(base: LogFrames, new: LogFrames, block: float, place: int) -> Pair:
    """place: of the log among all logs. block [s]."""
    at = blocks(base.stamps, block)
    scored = base.sums["scored_frames"].any(axis=1)
    weights = block_draws(base.stamps, block, [SEED, place]).astype(np.float32)
    return Pair(base, new, weights, len(np.unique(at)), len(np.unique(at[scored])))


def noises(
    figure: Figure, pairs: Sequence[Pair], places: IndexArray, values: FloatArray
) -> tuple[Noise, ...]:
    """How much the change of a figure may owe to the frames, for some rows of these logs together.

    places: (J,) of the rows in C. values: (2, J) of the figure in both, as it stands in the results. Where
    the frames do not add up to it they are of other results, and nothing is said.
    """
    at = slice(None) if np.array_equal(places, np.arange(len(pairs[0].base.place))) else places
    totals = [_sums(figure, one, at, np.ones((1, len(one.base.stamps)))) for one in pairs]
    total = _added(totals)
    before = _ratio(total[0], total[1])
    after = _ratio(total[0] + total[2], total[1] + total[3])
    found = np.concatenate([before, after])
    fits: list[bool] = np.isclose(found, values, rtol=FITTING, atol=FITTING).all(axis=0).tolist()
    logs = sum(one.scored > 0 for one in pairs) >= LEAST_LOGS
    least, noun = (LEAST_LOGS, "logs") if logs else (LEAST_BLOCKS, "blocks of time")
    number = _number(figure, pairs, logs)
    if number < least:
        few = f"{number} {noun} to draw from, {least} are needed"
        return tuple(Noise(NAN, NAN, few) for _ in places)
    if logs:
        drawn = log_draws(len(pairs), SEED).astype(np.float64)
        parts = [np.concatenate(of_logs) for of_logs in zip(*totals, strict=True)]
        each = tuple(np.einsum("bl,lc->bc", drawn, part) for part in parts)
    else:
        each = _added([_sums(figure, one, at, one.weights) for one in pairs])
    above, below, more_above, more_below = each
    with np.errstate(divide="ignore", invalid="ignore"):
        # The difference of two ratios, from differences alone: exact also where little has changed.
        differences = (more_above - above / below * more_below) / (below + more_below)
    differences[(below == 0) | (below + more_below == 0)] = np.nan
    low, high = interval(differences)
    return tuple(_noise(*limits) for limits in zip(low.tolist(), high.tolist(), fits, strict=True))


def _noise(low: float, high: float, fits: bool) -> Noise:
    if not fits:
        return Noise(NAN, NAN, "the frames do not add up to the figures: they are of other results")
    if low != low:
        return Noise(NAN, NAN, "defined in too few blocks of time")
    return Noise(low, high)


def _number(figure: Figure, pairs: Sequence[Pair], logs: bool) -> int:
    """Of independent things to draw from."""
    unlabelled = set(figure.below or figure.above) <= set(WITHOUT_LABELS)
    if logs:
        return len(pairs) if unlabelled else sum(one.scored > 0 for one in pairs)
    return sum(one.evaluated if unlabelled else one.scored for one in pairs)


def _sums(figure: Figure, one: Pair, at: Places, weights: NDArray[np.floating]) -> tuple[FloatArray, ...]:
    """What is above and below in BASE, and how much more in NEW; weighted sums over frames, each (B, J)."""
    above, below = (_column(side, one.base, at) for side in (figure.above, figure.below))
    more_above, more_below = (
        _column(side, one.new, at) - there for side, there in ((figure.above, above), (figure.below, below))
    )
    return tuple(_weighted(weights, values) for values in (above, below, more_above, more_below))


def _column(weights: Mapping[str, float], frames: LogFrames, at: Places) -> FloatArray:
    """Sums of each frame, so many times each, (F, J)."""
    return sum((weight * frames.sums[name][:, at] for name, weight in weights.items()), np.zeros((1, 1)))


def _weighted(weights: NDArray[np.floating], values: FloatArray) -> FloatArray:
    """weights (B, F) @ values (F, J), of which many frames add nothing and many rows are alike."""
    alike = (values == values[:, :1]).all()
    some = np.flatnonzero(values.any(axis=1))
    columns = values[some, :1] if alike else values[some]
    summed = weights[:, some] @ columns.astype(weights.dtype)
    return np.broadcast_to(summed.astype(np.float64), (len(weights), values.shape[1]))


def _ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    undefined = np.full(above.shape, np.nan)
    found: FloatArray = np.divide(above, below, out=undefined, where=below != 0)
    return found


def _added(parts: Sequence[tuple[FloatArray, ...]]) -> tuple[FloatArray, ...]:
    return tuple(sum(each[1:], each[0]) for each in zip(*parts, strict=True))
