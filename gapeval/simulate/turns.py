"""Clouds of a spinning sensor on a robot that drives on: each column is cast from where it is at its time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.simulate.casting import Caster
from gapeval.simulate.drive import START
from gapeval.simulate.sensors import Spinning
from gapeval.simulate.simulation import Simulation, hits_at, mounts_at, robot_at, still

TURN = 3  # stream of random numbers, beside those of the simulation


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """One turn of the sensor. stamp: of its first column [ns].

    points: (N, 3) float32, each in the sensor frame at its own time [m], which is so many nanoseconds (N,)
    uint32 after the stamp. true: (N, 3) the same points in the robot frame at the stamp [m].
    """

    stop: int
    stamp: int
    points: NDArray[np.float32]
    nanoseconds: NDArray[np.uint32]
    true: FloatArray


def turns(simulated: Simulation) -> Iterator[Turn]:
    """Turn after turn, from the beginning of the drive to its end."""
    scenery, stamps = still(simulated), turn_stamps(simulated)
    stops = simulated.drive.stops((stamps - START) / 1e9)
    for number, (stamp, stop) in enumerate(zip(stamps.tolist(), stops.tolist(), strict=True)):
        yield _turn(simulated, scenery, number, stamp, stop)


def turn_stamps(simulated: Simulation) -> NDArray[np.int64]:
    """Of all turns that end before the drive does [ns]."""
    period = simulated.sensor.pattern.period
    count = int(np.floor(simulated.drive.times[-1] / period + 1e-9))
    return START + np.round(np.arange(count) * period * 1e9).astype(np.int64)


def _turn(simulated: Simulation, scenery: Caster, number: int, stamp: int, stop: int) -> Turn:
    sensor, pattern = simulated.sensor, simulated.sensor.pattern
    assert isinstance(pattern, Spinning)
    rays = pattern.directions(0.0)  # the encoder fires each column at the same angle in every turn
    since = np.arange(pattern.columns) * (pattern.period / pattern.columns)
    origins, rotations = mounts_at(simulated, np.asarray((stamp - START) / 1e9 + since, dtype=np.float64))
    towards = np.einsum("cij,rcj->rci", rotations, rays)
    starts = np.broadcast_to(origins, rays.shape)
    hits = hits_at(simulated, scenery, stop, starts.reshape(-1, 3), towards.reshape(-1, 3))
    random = np.random.default_rng([simulated.seed, TURN, number])
    ranges = sensor.ranges(hits.shaped(rays.shape[:2]), random)
    seen = np.isfinite(ranges)
    far = ranges[seen][:, None]
    nanoseconds = np.broadcast_to(np.round(since * 1e9).astype(np.uint32), ranges.shape)
    return Turn(
        stop,
        stamp,
        np.asarray(rays[seen] * far, dtype=np.float32),
        nanoseconds[seen],
        robot_at(simulated, stamp).apply_inverse(starts[seen] + towards[seen] * far),
    )
