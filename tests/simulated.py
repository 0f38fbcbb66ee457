"""What a simulated log should hold, from the scene alone: no mesh, no caster.

Robots and sensors are written down a second time, as their data sheets and the issue have them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from command import gapeval

from gapeval.config import LogSection
from gapeval.frame import Frame
from gapeval.labels import Labels, read_labels
from gapeval.logs.read import Recording, read_frames, read_recording
from gapeval.simulate.scene import Ground, Scene, Solid
from gapeval.simulate.simulation import Simulation, simulation

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class Facts:
    """A robot and its sensor. x, height: of the sensor, before the robot's middle and above the ground [m].
    down: its tilt [deg]. elevations: lowest and highest ring [deg]. kept: s that a pass takes.
    """

    x: float
    height: float
    down: float
    length: float
    width: float
    ground_z: float
    nearest: float
    farthest: float
    deviation: Callable[[Array], Array]
    grazing: float
    period: float
    elevations: tuple[float, float] = (0.0, 0.0)
    rings: int = 0
    columns: int = 0


def _steady(deviation: float) -> Callable[[Array], Array]:
    return lambda r: np.full(np.shape(r), deviation)


SPINNING = {"length": 1.0, "width": 0.7, "ground_z": -0.1, "height": 0.6, "grazing": 2.0, "period": 0.1}
FACTS = {
    "lms151": Facts(
        0.2502,
        0.2132,
        0.0,
        0.68,
        0.5,
        -0.0705,
        0.2,
        20.0,
        lambda r: np.maximum(0.012, 0.0068 * r + 0.0008),
        1.0,
        math.pi / 1.2,
    ),
    "vlp16": Facts(
        0.3, down=15.0, nearest=0.4, farthest=100.0, deviation=_steady(0.008), elevations=(-15.0, 15.0),
        rings=16, columns=1800, **SPINNING,
    ),
    "hdl32e": Facts(
        0.3, down=0.0, nearest=0.7, farthest=100.0, deviation=_steady(0.008), elevations=(-30.67, 10.67),
        rings=32, columns=2172, **SPINNING,
    ),
    "os1-64": Facts(
        0.3, down=15.0, nearest=0.4, farthest=100.0, deviation=_steady(0.01), elevations=(-16.8, 16.5),
        rings=64, columns=1024, **SPINNING,
    ),
    "os1-128": Facts(
        0.3, down=10.0, nearest=0.4, farthest=100.0, deviation=_steady(0.01), elevations=(-21.82, 20.95),
        rings=128, columns=1024, **SPINNING,
    ),
}  # fmt: skip
ROLL_STEP, BEAM_STEP = 0.024, math.radians(0.5)


@dataclass(frozen=True)
class Simulated:
    """A log as it was read back, and the scene that it is of."""

    truth: Simulation
    log: Path
    labels: Labels
    recording: Recording
    frames: tuple[Frame, ...]

    @property
    def facts(self) -> Facts:
        return FACTS[str(self.truth.about["sensor"])]


class Logs:
    """Logs made by the command, each once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.made: dict[tuple[object, ...], Simulated] = {}

    def of(self, scene: str, sensor: str, frames: int, seed: int = 0, container: str = "mcap") -> Simulated:
        wanted = (scene, sensor, frames, seed, container)
        if wanted not in self.made:
            folder = self.folder / "_".join(map(str, wanted))
            options = ("--sensor", sensor, "--frames", frames, "--seed", seed, "--format", container)
            done = gapeval("simulate", scene, *options, "-o", folder)
            assert done.status == 0, done.err
            log = folder / (scene + {"mcap": ".mcap", "ros1": ".bag", "ros2": ""}[container])
            recording = read_recording(log, LogSection())
            read = tuple(read_frames(recording, 0, recording.matched))
            assert all(isinstance(frame, Frame) for frame in read)
            self.made[wanted] = Simulated(
                simulation(scene, sensor, frames, seed),
                log,
                read_labels(folder / "labels.geojson"),
                recording,
                read,  # type: ignore[arg-type]
            )
        return self.made[wanted]


def turn(axis: str, angle: float) -> Array:
    """The rotation by an angle [rad] about y or z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]] if axis == "y" else [[c, -s, 0], [s, c, 0], [0, 0, 1]])


def true_pose(scene: Scene, facts: Facts, stop: int) -> tuple[Array, Array]:
    """Rotation and translation fixed<-robot: its front and rear stand on the profile."""
    x, y, yaw = scene.stops[stop]
    ends = [x + side * facts.length / 2 * math.cos(yaw) for side in (-1, 1)]
    rear, front = np.interp(ends, *scene.ground.profile.T)
    rotation = turn("z", yaw) @ turn("y", -math.atan((front - rear) / facts.length))
    return rotation, np.array([x, y, (front + rear) / 2]) - facts.ground_z * rotation[:, 2]


def true_sensor(scene: Scene, facts: Facts, stop: int) -> tuple[Array, Array]:
    """Rotation and translation fixed<-sensor."""
    rotation, translation = true_pose(scene, facts, stop)
    mount = np.array([facts.x, 0.0, facts.height + facts.ground_z])
    return rotation @ turn("y", math.radians(facts.down)), rotation @ mount + translation


def in_sensor_frame(frame: Frame) -> Array:
    """The cloud (N, 3) as the sensor gave it."""
    return (frame.points.astype(np.float64) - frame.sensor.translation) @ frame.sensor.matrix


@dataclass(frozen=True)
class Raster:
    """Echoes by ray. ranges: (rows, columns) [m], inf where there is none; rays: (rows, columns, 3).

    rows are rings, or scans of the rolling laser; phase: of the first column or scan, in steps.
    off: how far the worst point is from its ray, in steps; order: (N,) row of each point, as in the cloud.
    """

    ranges: Array
    rays: Array
    phase: float
    off: float
    order: Any


def raster(facts: Facts, points: Array) -> Raster:
    """Which ray each echo came by; asserts that no two came by one."""
    r = np.linalg.norm(points, axis=1)
    x, y, z = points.T
    if facts.rings:
        low, high = np.radians(facts.elevations)
        row = (np.arcsin(z / r) - low) / (high - low) * (facts.rings - 1)
        column = (np.arctan2(y, x) + math.pi) / (2 * math.pi) * facts.columns
        phase = _phase(column)
        column -= phase
        shape = facts.rings, facts.columns
        elevation = np.linspace(low, high, shape[0])[:, None]
        azimuth = (np.arange(shape[1]) + phase) * 2 * math.pi / shape[1] - math.pi
        parts = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    else:
        beam = np.sign(y) * np.arctan2(np.hypot(y, z), x)
        column = (beam + math.radians(135)) / BEAM_STEP
        row = (np.arctan2(z * np.sign(y), np.abs(y)) + math.pi / 2) / ROLL_STEP
        away = np.hypot(y, z) > 0.1 * r  # where the roll is well known
        phase = _phase(row[away])
        row -= phase
        shape = 131, 541
        row[~away] = np.round(row[~away])
        roll = ((np.arange(shape[0]) + phase) * ROLL_STEP - math.pi / 2)[:, None]
        azimuth = np.radians(np.arange(shape[1]) * 0.5 - 135)
        parts = np.cos(azimuth), np.sin(azimuth) * np.cos(roll), np.sin(azimuth) * np.sin(roll)
    rays = np.stack(np.broadcast_arrays(*parts), axis=-1)
    off = max(np.abs(row - np.round(row)).max(), np.abs(column - np.round(column)).max())
    rows, columns = np.round(row).astype(int), np.round(column).astype(int) % shape[1]
    if not facts.rings:
        rows, columns, r = rows[away], columns[away], r[away]
    assert rows.min() >= 0
    assert rows.max() < shape[0]
    ranges = np.full(shape, np.inf)
    ranges[rows, columns] = r
    assert np.isfinite(ranges).sum() == len(r), "two echoes by one ray"
    return Raster(ranges, rays, phase, float(off), rows)


def _phase(steps: Array) -> float:
    """The common fraction of numbers that differ by whole ones."""
    return float(np.angle(np.exp(2j * math.pi * steps).mean()) / (2 * math.pi) % 1.0)


def ground_ahead(ground: Ground, origin: Array, directions: Array, step: float = 0.01) -> tuple[Array, Array]:
    """Where rays (N, 3) that go down first meet the ground as defined, and the sine of the angle there.

    Goes along each ray in small steps from above the highest ground to below the lowest.
    """
    reach, sine = np.full(len(directions), np.nan), np.full(len(directions), np.nan)
    for i, d in enumerate(directions):
        low, high = ground.profile[:, 1].min() - 0.06, ground.profile[:, 1].max() + 0.06
        first, last = max((high - origin[2]) / d[2], 0.0), (low - origin[2]) / d[2]
        t = np.arange(first, last + step, step)
        places = origin + t[:, None] * d
        above = places[:, 2] - ground.height(places[:, :2])
        below = np.flatnonzero(above <= 0)
        if len(below) == 0 or below[0] == 0:
            continue
        k = below[0]
        reach[i] = t[k - 1] + step * above[k - 1] / (above[k - 1] - above[k])
        x, y = (origin + reach[i] * d)[:2]
        h = ground.height(np.array([[x + 1e-3, y], [x - 1e-3, y], [x, y + 1e-3], [x, y - 1e-3]]))
        normal = np.array([-(h[0] - h[1]) / 2e-3, -(h[2] - h[3]) / 2e-3, 1.0])
        sine[i] = abs(normal @ d) / np.linalg.norm(normal)
    return reach, sine


NOTHING, GROUND, FLOOR, WALL, SOLID = range(5)


def first_hits(
    scene: Scene, passing: tuple[Solid, ...], origin: Array, directions: Array, level: float
) -> tuple[Array, Any, Array]:
    """What rays (N, 3) meet first where the ground is flat, at a level [m]: distance, kind, sine of angle.

    Ray by ray against every upright wall and every level face, by the formula of two lines in the plane.
    """
    ends, sines = [np.full(len(directions), np.inf)], [np.ones(len(directions))]
    kinds = [NOTHING]
    with np.errstate(divide="ignore", invalid="ignore"):

        def face(z: float, kind: int, inside: Callable[[Array], Any]) -> None:
            t = (z - origin[2]) / directions[:, 2]
            places = origin[:2] + t[:, None] * directions[:, :2]
            good = (t > 0) & np.isfinite(t)
            good[good] &= inside(places[good])
            ends.append(np.where(good, t, np.inf))
            sines.append(np.abs(directions[:, 2]))
            kinds.append(kind)

        def sides(outline: shapely.Polygon, low: float, high: float, kind: int) -> None:
            ring = shapely.get_coordinates(outline.exterior)
            for p, q in pairwise(ring):
                edge, away = q - p, p - origin[:2]
                across = directions[:, 0] * edge[1] - directions[:, 1] * edge[0]
                t = (away[0] * edge[1] - away[1] * edge[0]) / across
                s = (away[0] * directions[:, 1] - away[1] * directions[:, 0]) / across
                z = origin[2] + t * directions[:, 2]
                good = (t > 0) & (s >= 0) & (s <= 1) & (z >= low) & (z <= high)
                ends.append(np.where(good, t, np.inf))
                sines.append(np.abs(across) / math.hypot(*edge))
                kinds.append(kind)

        outlines = [hole.outline for hole in scene.holes]
        face(level, GROUND, lambda p: ~np.any([shapely.contains_xy(o, p) for o in outlines] or False, axis=0))
        for hole in scene.holes:
            face(-hole.depth, FLOOR, lambda p, o=hole.outline: shapely.contains_xy(o, p))
            sides(hole.outline, -hole.depth, level, WALL)
        for solid in (*scene.solids, *passing):
            sides(solid.outline, solid.bottom, solid.top, SOLID)
            for z in (solid.bottom, solid.top):
                face(z, SOLID, lambda p, o=solid.outline: shapely.contains_xy(o, p))
    table = np.array(ends)
    best = table.argmin(axis=0)
    rays = np.arange(len(directions))
    return table[best, rays], np.array(kinds)[best], np.array(sines)[best, rays]
