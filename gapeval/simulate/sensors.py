"""Robots with their sensors: mounting, rays, noise, and what is lost."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Robot
from gapeval.frame import FloatArray, Transform
from gapeval.simulate.casting import Hits


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviation of a range r [m]: max(floor, slope r + offset)."""

    floor: float
    slope: float = 0.0
    offset: float = 0.0

    def deviation(self, distance: FloatArray) -> FloatArray:
        return np.asarray(np.maximum(self.floor, self.slope * distance + self.offset), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Rolling:
    """A planar scanner that rolls about its x axis; a cloud is one pass from side to side.

    beams: first and last azimuth in the scan, and their step [rad]. rolls: first and last roll, and the
    step from scan to scan [rad]. period: of a pass [s]. shadow_filter: the echoes of two neighbouring beams
    of a scan are dropped where the line between them meets the first beam at less than this angle [rad].
    """

    beams: tuple[float, float, float]
    rolls: tuple[float, float, float]
    period: float
    shadow_filter: float

    @property
    def lowest(self) -> float:
        """Elevation of the lowest ray [rad]."""
        return -np.pi / 2

    def times(self, density: float) -> Self:
        """So many times the scans in a pass, which takes as long."""
        first, last, step = self.rolls
        return replace(self, rolls=(first, last, step / density))

    @property
    def azimuths(self) -> FloatArray:
        """Of the beams of a scan (beams,) [rad]."""
        first, last, step = self.beams
        return np.linspace(first, last, round((last - first) / step) + 1)

    @property
    def rate(self) -> float:
        """Of the roll during a pass [rad/s]."""
        return (self.rolls[1] - self.rolls[0]) / self.period

    @property
    def scan_period(self) -> float:
        """From scan to scan [s]."""
        return self.rolls[2] / self.rate

    @property
    def beam_period(self) -> float:
        """From beam to beam [s]: the mirror turns once for each scan, and looks back for part of it."""
        return self.scan_period * self.beams[2] / (2 * np.pi)

    def directions(self, phase: float) -> FloatArray:
        """Rays (scans, beams, 3) in the frame of the laser at roll 0; phase: of the first scan, in steps."""
        azimuth = self.azimuths
        low, high, turn = self.rolls
        roll = (low + turn * phase + turn * np.arange(round((high - low) / turn)))[:, None]
        x, y = np.cos(azimuth), np.sin(azimuth)
        return np.stack(
            [np.broadcast_to(x, (len(roll), len(x))), y * np.cos(roll), y * np.sin(roll)], axis=-1
        )

    def kept(self, ranges: FloatArray) -> NDArray[np.bool_]:
        """Which echoes (scans, beams) pass the shadow filter; where there is no echo, range is inf."""
        step = self.beams[2]
        with np.errstate(invalid="ignore"):
            here, there = ranges[:, :-1], ranges[:, 1:]
            angle = np.abs(np.arctan2(there * np.sin(step), here - there * np.cos(step)))
        grazing = (np.minimum(angle, np.pi - angle) < self.shadow_filter) & np.isfinite(here + there)
        dropped = np.zeros(ranges.shape, dtype=np.bool_)
        dropped[:, :-1] |= grazing
        dropped[:, 1:] |= grazing
        return ~dropped


@dataclass(frozen=True, slots=True)
class Spinning:
    """Rings of beams that turn about the z axis. elevations: lowest and highest [rad], evenly spaced."""

    elevations: tuple[float, float]
    rings: int
    columns: int
    period: float

    @property
    def lowest(self) -> float:
        """Elevation of the lowest ray [rad]."""
        return self.elevations[0]

    def times(self, density: float) -> Self:
        """So many times the columns in a turn, which takes as long."""
        return replace(self, columns=round(self.columns * density))

    def directions(self, phase: float) -> FloatArray:
        """Rays (rings, columns, 3) in the sensor frame; phase: of the first column, in columns."""
        elevation = np.linspace(*self.elevations, self.rings)[:, None]
        azimuth = 2 * np.pi / self.columns * (np.arange(self.columns) + phase) - np.pi
        return np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.broadcast_to(np.sin(elevation), (self.rings, self.columns)),
            ],
            axis=-1,
        )

    def kept(self, ranges: FloatArray) -> NDArray[np.bool_]:
        """All echoes."""
        return np.ones(ranges.shape, dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor on its robot.

    mount: robot<-sensor. nearest, farthest: of its range [m]. grazing: below this angle between ray and
    surface [rad] echoes are lost, more the smaller it is.
    """

    about: str
    frame_id: str
    robot: Robot
    mount: Transform
    pattern: Rolling | Spinning
    noise: Noise
    nearest: float
    farthest: float
    grazing: float

    @property
    def first_ground(self) -> float:
        """x of the nearest level ground that is seen straight ahead, robot frame [m]."""
        tilt = -np.arcsin(self.mount.matrix[2, 0])
        below = min(tilt - self.pattern.lowest, np.pi / 2)
        height = self.mount.translation[2] - self.robot.ground_z
        return float(self.mount.translation[0] + height / np.tan(below))

    def ranges(self, hits: Hits, random: np.random.Generator) -> FloatArray:
        """What is in a cloud (rows, columns): the echoes that the pattern keeps, inf elsewhere."""
        ranges = self.echoes(hits, random)
        return np.where(self.pattern.kept(ranges), ranges, np.inf)

    def echoes(self, hits: Hits, random: np.random.Generator) -> FloatArray:
        """What the sensor measures (rows, columns) of what its rays hit: noisy, inf where an echo is lost."""
        noise = random.normal(0.0, 1.0, hits.distance.shape)
        luck = random.uniform(0.0, 1.0, hits.distance.shape)
        finite = np.isfinite(hits.distance)
        true = np.where(finite, hits.distance, 0.0)
        measured = true + noise * self.noise.deviation(true)
        seen = finite & (measured >= self.nearest) & (true <= self.farthest)
        seen &= luck * np.sin(self.grazing) < hits.grazing
        return np.where(seen, measured, np.inf)


def _tilted(x: float, z: float, down: float) -> Transform:
    """A sensor at x, z of the robot frame [m] that looks down by an angle [rad]."""
    return Transform.of([x, 0.0, z], [0.0, np.sin(down / 2), 0.0, np.cos(down / 2)])


def _spinning(
    about: str,
    frame_id: str,
    elevations: tuple[float, float],
    rings: int,
    columns: int,
    tilt: float,
    noise: float,
    nearest: float,
    farthest: float,
) -> Sensor:
    """On the mast of a wheeled robot, 0.6 m above the ground."""
    low, high = np.deg2rad(elevations).tolist()
    return Sensor(
        about, frame_id, WHEELED, _tilted(0.3, 0.5, np.deg2rad(tilt)),
        Spinning((low, high), rings, columns, 0.1), Noise(noise), nearest, farthest, np.deg2rad(2.0),
    )  # fmt: skip


TRACKED = Robot(length=0.68, width=0.5, ground_z=-0.0705)  # the NIFTi project's BlueBotics Absolem
WHEELED = Robot(length=1.0, width=0.7, ground_z=-0.1)

SENSORS = {
    "lms151": Sensor(
        "SICK LMS-151 rolling on the paper's NIFTi robot, 0.21 m above the ground; a cloud takes 2.6 s",
        "laser",
        TRACKED,
        Transform.of([0.2502, 0.0, 0.1427], [0.0, 0.0, 0.0, 1.0]),
        Rolling(
            beams=(np.deg2rad(-135.0).item(), np.deg2rad(135.0).item(), np.deg2rad(0.5).item()),
            rolls=(-np.pi / 2, np.pi / 2, 1.2 / 50),  # 1.2 rad/s at 50 scans a second
            period=np.pi / 1.2,
            shadow_filter=0.1,
        ),
        Noise(0.012, slope=0.0068, offset=0.0008),
        nearest=0.2,
        farthest=20.0,
        grazing=np.deg2rad(1.0).item(),
    ),
    "vlp16": _spinning(
        "Velodyne VLP-16, tilted down by 15 degrees, 0.6 m above the ground", "velodyne",
        (-15.0, 15.0), 16, 1800, tilt=15, noise=0.008, nearest=0.4, farthest=100.0,
    ),
    "hdl32e": _spinning(
        "Velodyne HDL-32E, level, 0.6 m above the ground", "velodyne",
        (-30.67, 10.67), 32, 2172, tilt=0, noise=0.008, nearest=0.7, farthest=100.0,
    ),
    "os1-64": _spinning(
        "Ouster OS1-64, tilted down by 15 degrees, 0.6 m above the ground", "os_sensor",
        (-16.8, 16.5), 64, 1024, tilt=15, noise=0.01, nearest=0.4, farthest=100.0,
    ),
    "os1-128": _spinning(
        "Ouster OS1-128, tilted down by 10 degrees, 0.6 m above the ground", "os_sensor",
        (-21.82, 20.95), 128, 1024, tilt=10, noise=0.01, nearest=0.4, farthest=100.0,
    ),
}  # fmt: skip
