"""The sums that metrics need, as they would be had other stretches of a log been recorded; in flat memory."""

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.results.tables import is_real
from gapeval.scoring.intervals import REPLICATES, needed
from gapeval.scoring.metrics import METRICS, SUMS

NAMES = needed(METRICS)
PLACES = [tuple(SUMS).index(name) for name in NAMES]
HELD = 32  # frames that are added at a time, together


class Replicates:
    """Sums of frames, each frame as often as it was drawn.

    Of each sum that is not all zero (REPLICATES, C), or (REPLICATES, 1) while it is the same under all
    configurations. Counts are exact in single precision, up to 16 million.
    """

    def __init__(self, configurations: int) -> None:
        self._totals: dict[str, NDArray[np.floating]] = {}
        self._frames = np.empty((HELD, configurations, len(NAMES)))
        self._weights = np.empty((HELD, REPLICATES))
        self._held = 0

    def add(self, weights: NDArray[np.uint8], sums: FloatArray) -> None:
        """One frame. weights: (REPLICATES,) how often it was drawn; sums: (C, len(SUMS))."""
        self._frames[self._held] = sums[:, PLACES]
        self._weights[self._held] = weights
        self._held += 1
        if self._held == HELD:
            self._add_held()

    def _add_held(self) -> None:
        weights, frames = self._weights[: self._held].T, self._frames[: self._held]
        for name, values in zip(NAMES, np.moveaxis(frames, 2, 0), strict=True):
            if not values.any():
                continue
            alike = (values == values[:, :1]).all()
            columns = np.ascontiguousarray(values[:, :1] if alike else values)
            precise = np.float64 if is_real(name) else np.float32
            # Not by a product of matrices: with many threads on a busy machine that takes for ever.
            by = np.einsum("bf,fc->bc", weights.astype(precise), columns.astype(precise))
            self._increase(name, by)
        self._held = 0

    def _increase(self, name: str, by: NDArray[np.floating]) -> None:
        before = self._totals.get(name)
        if before is None:
            self._totals[name] = by
        elif before.shape[1] < by.shape[1]:
            self._totals[name] = before + by
        else:
            before += by

    def include(self, other: "Replicates") -> None:
        """The frames of another log, which was drawn by itself."""
        other._add_held()
        for name, by in other._totals.items():
            self._increase(name, by.copy())

    def total(self, name: str) -> NDArray[np.floating]:
        """The sum of this name, (REPLICATES, C) or (REPLICATES, 1)."""
        self._add_held()
        return self._totals.get(name, np.zeros((REPLICATES, 1)))
