"""What frames add up to: of one log, or of all."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.results.hits import Approaches, FirstHits, HitCounts, Hits
from gapeval.results.replicates import Replicates
from gapeval.scoring.intervals import (
    LEAST_BLOCKS,
    LEAST_LOGS,
    Counted,
    Seed,
    Stamps,
    block_draws,
    blocks,
    figure_with_limits,
    log_draws,
)
from gapeval.scoring.metrics import METRICS, SUMS
from gapeval.scoring.scene import AskedLabel

SEED = 2013  # of what is drawn for intervals: fixed, so that the same input gives the same bytes
SCORED = tuple(SUMS).index("scored_frames")


@dataclass(frozen=True, slots=True, eq=False)
class Total:
    """One log, or all, when it is done.

    sums: (C, len(SUMS)). limits: of each metric, (2, C), NaN where unknown.
    """

    sums: FloatArray
    hits: HitCounts
    first_hits: FirstHits
    limits: Mapping[str, FloatArray]
    counted: Counted


class LogSums:
    """Of the log that is being read. stamps: of all its clouds, ascending [ns]; block [s]."""

    def __init__(self, configurations: int, stamps: Stamps, block: float, seed: Seed) -> None:
        self.sums = np.zeros((configurations, len(SUMS)))
        self.hits = HitCounts(configurations)
        self.approaches = Approaches(configurations)
        self.replicates = Replicates(configurations)
        self._stamps = np.sort(stamps)
        self._weights = block_draws(self._stamps, block, seed)
        self._blocks = blocks(self._stamps, block)
        self._evaluated: set[int] = set()
        self._scored: set[int] = set()

    def add(self, stamp: int, sums: FloatArray, asked: Sequence[AskedLabel], hits: Hits) -> None:
        """One frame: sums (C, len(SUMS)), labels (A) that were asked for, hits (C, A)."""
        self.sums += sums
        self.hits.add(asked, hits)
        self.approaches.add(asked, hits)
        place = int(np.searchsorted(self._stamps, stamp))
        self.replicates.add(self._weights[:, place], sums)
        block = int(self._blocks[place])
        self._evaluated.add(block)
        if sums[:, SCORED].any():
            self._scored.add(block)

    def total(self) -> Total:
        counted = Counted(
            self.approaches.judged, len(self.approaches.labels), len(self._evaluated), len(self._scored)
        )
        first = FirstHits.none(len(self.sums))
        first.add(self.approaches)
        found = _limits(self.sums, self.replicates.total, counted, LEAST_BLOCKS)
        return Total(self.sums, self.hits, first, found, counted)


class AllSums:
    """Of all logs so far."""

    def __init__(self, configurations: int) -> None:
        self.sums = np.zeros((configurations, len(SUMS)))
        self._hits = HitCounts(configurations)
        self._first = FirstHits.none(configurations)
        self._counted = Counted(np.zeros(configurations, dtype=np.intp))
        self._replicates = Replicates(0)
        self._logs: list[Total] = []

    def include(self, log: LogSums, total: Total) -> None:
        """What a log that is done adds to all but sums, which are added frame by frame."""
        self._hits.include(log.hits)
        self._first.add(log.approaches)
        self._counted.include(total.counted)
        self._logs.append(total)
        if self._whole_logs:
            self._replicates = Replicates(0)
        elif len(self._logs) == 1:
            self._replicates = log.replicates
        else:
            self._replicates.include(log.replicates)

    @property
    def _whole_logs(self) -> bool:
        """Whether there are enough logs to draw whole ones; else blocks are drawn, of each log by itself."""
        return sum(log.counted.scored_blocks > 0 for log in self._logs) >= LEAST_LOGS

    def total(self) -> Total:
        if len(self._logs) == 1:
            return self._logs[0]
        counted = self._counted
        if not self._whole_logs:
            drawn = self._replicates.total
            found = _limits(self.sums, drawn, counted, LEAST_BLOCKS)
        else:
            scored = sum(log.counted.scored_blocks > 0 for log in self._logs)
            counted = Counted(counted.judged, counted.labels, len(self._logs), scored)
            weights = log_draws(len(self._logs), SEED).astype(np.float64)

            def drawn(name: str) -> FloatArray:
                each = np.stack([log.sums[:, tuple(SUMS).index(name)] for log in self._logs])
                found: FloatArray = np.einsum("bl,lc->bc", weights, each)
                return found

            found = _limits(self.sums, drawn, counted, LEAST_LOGS)
        return Total(self.sums, self._hits, self._first, found, counted)


def _limits(
    sums: FloatArray, drawn: Callable[[str], NDArray[np.floating]], counted: Counted, least: int
) -> dict[str, FloatArray]:
    """(2, C) of each metric. drawn: the replicates of a sum, (B, C) or (B, 1)."""
    here = dict(zip(SUMS, sums.T, strict=True))
    return {metric.name: figure_with_limits(metric, here, drawn, counted, least)[2] for metric in METRICS}
