"""Figures with their intervals, and the draws behind them, so that differences can be taken pairwise."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gapeval.config import Scoring
from gapeval.frame import FloatArray
from gapeval.results.tally import SEED
from gapeval.scoring.intervals import (
    LEAST_BLOCKS,
    LEAST_LOGS,
    REPLICATES,
    Counted,
    block_draws,
    blocks,
    figure_with_limits,
    interval,
    log_draws,
    needed,
)
from gapeval.scoring.metrics import COUNTS, METRICS, SUMS
from gapeval.studies.tally import COLUMN, Tally


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A figure, its 95 % interval where there is one, and its value in each draw (B,), NaN if undefined."""

    value: float | None
    low: float | None = None
    high: float | None = None
    draws: FloatArray | None = None


NOTHING = Estimate(None)


@dataclass(frozen=True, slots=True, eq=False)
class Draws:
    """Of whole logs where enough of them were scored, else of blocks of time.

    weights: (B, F), how often each frame counts in each draw. number: of logs or blocks; scored: of those
    with a frame that was labelled; least: as many as it takes for an interval.
    """

    weights: FloatArray
    number: int
    scored: int
    least: int


def estimates(
    tally: Tally, scoring: Scoring, wanted: Collection[str]
) -> Iterator[tuple[dict[str, Estimate], dict[str, int]]]:
    """Of each configuration: the metrics that are known, over all frames, and the counts behind them.

    wanted: metrics whose draws are kept. Draws depend on the logs alone: equal logs under other conditions
    are drawn alike.
    """
    draws = drawn(tally, scoring.block)
    totals = tally.sums.sum(axis=0)
    here = dict(zip(SUMS, totals.T, strict=True))
    anew = {name: draws.weights @ tally.sums[..., COLUMN[name]] for name in needed(METRICS)}
    judged = Counter(place for place, _ in frozenset[tuple[int, str]]().union(*tally.judged))
    counted = Counted(
        np.array([judged[place] for place in range(len(totals))]),
        len(frozenset[str]().union(*tally.labels)),
        draws.number,
        draws.scored,
    )
    found: list[dict[str, Estimate]] = [{} for _ in totals]
    for metric in METRICS:
        if not tally.known >= {*metric.above, *metric.below}:
            continue
        values, each, ends = figure_with_limits(metric, here, anew.__getitem__, counted, draws.least)
        for index, (value, low, high) in enumerate(zip(values.tolist(), *ends.tolist(), strict=True)):
            kept = None if each is None or metric.name not in wanted else each[:, index].copy()
            found[index][metric.name] = Estimate(_known(value), _known(low), _known(high), kept)
    logs = len(set(tally.case.tolist()))
    for index, figures in enumerate(found):
        counts = {name: int(here[name][index]) for name in COUNTS if name in tally.known}
        yield figures, {"logs": logs} | counts


def drawn(tally: Tally, block: float) -> Draws:
    """Whole logs, or blocks of time [s] where there are few."""
    cases = list(dict.fromkeys(tally.case.tolist()))
    scored = len(set(tally.case[tally.scored].tolist()))
    if scored >= LEAST_LOGS:
        place = np.searchsorted(cases, tally.case)
        weights = log_draws(len(cases), SEED)[:, place].astype(np.float64)
        return Draws(weights, len(cases), scored, LEAST_LOGS)
    parts, number, scored = [], 0, 0
    for order, case in enumerate(cases):
        own = tally.case == case
        parts.append(block_draws(tally.stamps[own], block, [SEED, order]))
        of_frames = blocks(tally.stamps[own], block)
        number += len(np.unique(of_frames))
        scored += len(np.unique(of_frames[tally.scored[own]]))
    return Draws(np.concatenate(parts, axis=1).astype(np.float64), number, scored, LEAST_BLOCKS)


def of_logs(values: FloatArray, statistic: Callable[..., Any]) -> Estimate:
    """A figure of values (L,), one for each log, drawn anew by logs where there are enough of them.

    Logs of which it is not known (NaN) are left out.
    """
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return NOTHING
    return of_frames(known, statistic) if len(known) >= LEAST_LOGS else Estimate(float(statistic(known)))


def of_frames(values: FloatArray, statistic: Callable[..., Any]) -> Estimate:
    """A figure of values (F,), one for each frame, drawn anew by frames."""
    chosen = np.random.default_rng(SEED).integers(0, len(values), (len(values), REPLICATES))
    draws = np.asarray(statistic(values[chosen], axis=0), dtype=np.float64)
    return of_draws(float(statistic(values)), draws)


def of_draws(value: float, draws: FloatArray) -> Estimate:
    """With the interval that draws (B,) give."""
    low, high = interval(draws[:, None])
    return Estimate(value, _known(float(low[0])), _known(float(high[0])), draws)


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value
