"""The joint that a planar laser rolls about: its angle at any time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.simulate.sensors import Rolling

RAMP = 0.2  # s from rest to the rate of a pass, and back, beyond the ends of the pass


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint that goes to and fro: the first pass from its least roll to its greatest, the next back.

    begins: (P,) when each pass begins [s]: when the joint, at its full rate, is at the pass's first roll. It
    speeds up before that and slows down after the pass, each for RAMP, and rests where it then is.
    low, high: first and last roll of a pass [rad]; rate: between the two [rad/s].
    """

    begins: FloatArray
    low: float
    high: float
    rate: float

    @property
    def period(self) -> float:
        """Of a pass, without its ramps [s]."""
        return (self.high - self.low) / self.rate

    def roll(self, seconds: FloatArray) -> FloatArray:
        """Angles (K,) at times (K,) [rad], about the x axis of the frame that the joint is mounted in."""
        number = np.clip(np.searchsorted(self.begins - RAMP, seconds, side="right") - 1, 0, None)
        since = np.clip(seconds - self.begins[number], -RAMP, self.period + RAMP)
        early, late = np.minimum(since, 0.0), np.maximum(since - self.period, 0.0)
        # Along the tangent of the pass, bent away from it where the joint speeds up or slows down.
        travelled = self.rate * (since + (early**2 - late**2) / (2 * RAMP))
        roll: FloatArray = np.where(number % 2 == 0, self.low + travelled, self.high - travelled)
        return roll

    def passes(self, seconds: FloatArray) -> NDArray[np.intp]:
        """In which pass, with its ramps, times (K,) lie; -1 where the joint rests."""
        number = np.searchsorted(self.begins - RAMP, seconds, side="right") - 1
        rests = (number < 0) | (seconds > self.begins[np.maximum(number, 0)] + self.period + RAMP)
        return np.where(rests, -1, number)


def joint(pattern: Rolling, begins: FloatArray) -> Joint:
    """The joint of a laser whose passes begin at times (P,) [s]."""
    low, high, _ = pattern.rolls
    return Joint(begins, low, high, pattern.rate)


def to_and_fro(pattern: Rolling, end: float) -> FloatArray:
    """When passes begin of a joint that never rests (P,) [s]: from 0 to an end [s], whole passes alone."""
    whole = pattern.period + 2 * RAMP
    return np.asarray(RAMP + whole * np.arange(int(end / whole + 1e-9)), dtype=np.float64)
