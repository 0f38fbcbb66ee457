"""Planar scans of a laser that rolls: each beam is cast from where the laser is at its time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.simulate.casting import Caster
from gapeval.simulate.drive import START
from gapeval.simulate.joint import Joint, joint, to_and_fro
from gapeval.simulate.sensors import Rolling
from gapeval.simulate.simulation import Simulation, hits_at, mounts_at, robot_at, still

SCAN = 2  # stream of random numbers, beside those of the simulation
AT_ONCE = 256  # scans; bounds memory
NO_ECHO = 0.0  # m, as the LMS-151 says it, and its driver as it comes


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """Scans one after the other, near a stop.

    stamps: (S,) of their first beams [ns]. ranges: (S, beams) float32 [m], NO_ECHO where there is none. true:
    (S, beams, 3) where the echoes are in the fixed frame [m], noise along the ray and all; NaN where none.
    """

    stop: int
    stamps: NDArray[np.int64]
    ranges: NDArray[np.float32]
    true: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """The scans from where the joint begins to turn one way to where it ends.

    true: (S, beams, 3) in the robot frame at the stamp [m]; NaN where there is no echo.
    """

    stamps: NDArray[np.int64]
    true: FloatArray

    @property
    def stamp(self) -> int:
        """Of the last scan [ns]."""
        return int(self.stamps[-1])


def joint_of(simulated: Simulation) -> Joint:
    """What the laser rolls about: a pass while the robot stands at each stop, or one after the other."""
    pattern, way = _pattern(simulated), simulated.drive
    if simulated.taking.moving:
        return joint(pattern, to_and_fro(pattern, float(way.times[-1])))
    return joint(pattern, (way.stamps - START) / 1e9 - pattern.period)


def scans(simulated: Simulation) -> Iterator[Scans]:
    """All scans of the whole drive, also those made while the joint rests."""
    scenery, turning = still(simulated), joint_of(simulated)
    stamps = scan_stamps(simulated)
    stops = simulated.drive.stops((stamps - START) / 1e9)
    for stop in range(simulated.frames):
        first, last = np.searchsorted(stops, [stop, stop + 1]).tolist()
        for number in range(first, last, AT_ONCE):
            part = slice(number, min(number + AT_ONCE, last))
            yield _measured(simulated, scenery, turning, stop, stamps[part], number)


def passes(simulated: Simulation) -> Iterator[Pass]:
    """What an assembled cloud of each pass should hold, in the order of scans and beams."""
    every = list(scans(simulated))
    stamps = np.concatenate([some.stamps for some in every])
    true = np.concatenate([some.true for some in every])
    turning = joint_of(simulated)
    numbers = turning.passes((stamps - START) / 1e9)
    for number in range(len(turning.begins)):
        own = np.flatnonzero(numbers == number)
        seen_from = robot_at(simulated, int(stamps[own[-1]]))
        yield Pass(stamps[own], seen_from.apply_inverse(true[own]))


def beam_times(pattern: Rolling, stamps: NDArray[np.int64]) -> FloatArray:
    """When each beam of scans (S,) was sent (S, beams) [s] since START."""
    beams = np.arange(len(pattern.azimuths))
    return ((stamps - START) / 1e9)[:, None] + beams * pattern.beam_period


def _measured(
    simulated: Simulation,
    scenery: Caster,
    turning: Joint,
    stop: int,
    stamps: NDArray[np.int64],
    number: int,
) -> Scans:
    """number: of the first of these scans in the log."""
    pattern, sensor = _pattern(simulated), simulated.sensor
    times = beam_times(pattern, stamps)
    origins, rotations = mounts_at(simulated, times.reshape(-1))
    roll, azimuth = turning.roll(times.reshape(-1)), np.tile(pattern.azimuths, len(stamps))
    x, y = np.cos(azimuth), np.sin(azimuth)
    local = np.column_stack([x, y * np.cos(roll), y * np.sin(roll)])
    towards = np.einsum("kij,kj->ki", rotations, local)
    hits = hits_at(simulated, scenery, stop, origins, towards).shaped(times.shape)
    ranges = np.full(times.shape, NO_ECHO, dtype=np.float32)
    for row in range(len(stamps)):  # each scan has draws of its own, however many are cast at once
        random = np.random.default_rng([simulated.seed, SCAN, number + row])
        one = type(hits)(hits.distance[row], hits.grazing[row])
        echoes = sensor.echoes(one, random).astype(np.float32)
        np.copyto(ranges[row], echoes, where=echoes < np.float32(sensor.farthest))
    seen = ranges != NO_ECHO
    true = np.full((*times.shape, 3), np.nan)
    true[seen] = (origins + towards * ranges.reshape(-1, 1))[seen.reshape(-1)]
    return Scans(stop, stamps, ranges, true)


def scan_stamps(simulated: Simulation) -> NDArray[np.int64]:
    """Of all scans that end before the drive does [ns]."""
    pattern = _pattern(simulated)
    last = float(simulated.drive.times[-1]) - pattern.beam_period * len(pattern.azimuths)
    count = int(np.floor(last / pattern.scan_period)) + 1
    return START + np.round(np.arange(count) * pattern.scan_period * 1e9).astype(np.int64)


def _pattern(simulated: Simulation) -> Rolling:
    pattern = simulated.sensor.pattern
    assert isinstance(pattern, Rolling)
    return pattern
