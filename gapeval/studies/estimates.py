"""Figures with their intervals, and the draws behind them, so that differences can be taken pairwise."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gapeval.config import Scoring
from gapeval.frame import FloatArray
from gapeval.scoring.metrics import COUNTS, SUMS, figures
from gapeval.studies.tally import Tally

DRAWS, SEED, LOGS = 500, 0, 5


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """A figure, its 95 % interval where there is one, and its value in each draw (B,), NaN if undefined."""

    value: float | None
    low: float | None = None
    high: float | None = None
    draws: FloatArray | None = None


NOTHING = Estimate(None)


def estimates(tally: Tally, scoring: Scoring) -> Iterator[tuple[dict[str, Estimate], dict[str, int]]]:
    """Of each configuration: every metric, over all frames together, and the counts behind them."""
    weights = drawn(tally)
    totals = tally.sums.sum(axis=0)
    replicates = None if weights is None else np.tensordot(weights, tally.sums, axes=1)
    logs = len(set(tally.case.tolist()))
    for index, total in enumerate(totals):
        sums = dict(zip(SUMS, total.tolist(), strict=True))
        found = figures(sums)
        counts = {"logs": logs} | {name: int(sums[name]) for name in COUNTS}
        if replicates is None:
            yield {name: Estimate(value) for name, value in found.items()}, counts
            continue
        each = [figures(dict(zip(SUMS, one, strict=True))) for one in replicates[:, index].tolist()]
        made = {}
        for name, value in found.items():
            draws = np.array([np.nan if one[name] is None else one[name] for one in each], dtype=np.float64)
            made[name] = NOTHING if value is None else Estimate(value, *percentiles(draws), draws)
        yield made, counts


def drawn(tally: Tally) -> FloatArray | None:
    cases = dict.fromkeys(tally.case.tolist())
    if len(cases) < LOGS:
        return None
    random = np.random.default_rng(SEED)
    of_logs = random.multinomial(len(cases), np.full(len(cases), 1 / len(cases)), DRAWS)
    place = {case: index for index, case in enumerate(cases)}
    return np.asarray(of_logs[:, [place[case] for case in tally.case.tolist()]], dtype=np.float64)


def percentiles(draws: FloatArray) -> tuple[float | None, float | None]:
    """The middle 95 % of the draws; none where it is undefined in many of them."""
    known = draws[np.isfinite(draws)]
    if len(known) < 0.9 * len(draws):
        return None, None
    low, high = np.quantile(known, (0.025, 0.975)).tolist()
    return low, high


def of_logs(values: FloatArray, figure: Callable[..., Any]) -> Estimate:
    """A figure of values (L,), one for each log, resampled by logs where there are enough of them."""
    if len(values) < LOGS:
        return Estimate(float(figure(values)))
    return of_frames(values, figure)


def of_frames(values: FloatArray, figure: Callable[..., Any]) -> Estimate:
    """A figure of values (F,), one for each frame, resampled by frames."""
    random = np.random.default_rng(SEED)
    chosen = random.integers(0, len(values), (DRAWS, len(values)))
    draws = np.asarray(figure(values[chosen], axis=1), dtype=np.float64)
    return Estimate(float(figure(values)), *percentiles(draws), draws)
