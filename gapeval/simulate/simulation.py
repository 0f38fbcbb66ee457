"""A scene, seen by a sensor: frames to the last noisy point."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gapeval.errors import ConfigError
from gapeval.frame import FloatArray, Transform, rotation_matrices
from gapeval.labels import Label
from gapeval.simulate import truth
from gapeval.simulate.casting import Caster, Hits, cast, caster, nearer
from gapeval.simulate.drive import PAUSE, START, Drive, drive, drive_on, pose, poses
from gapeval.simulate.joint import RAMP
from gapeval.simulate.layouts import SCENES
from gapeval.simulate.mesh import solid_triangles, static_triangles
from gapeval.simulate.scene import Scene
from gapeval.simulate.sensors import SENSORS, Rolling, Sensor
from gapeval.simulate.variation import Variation, varied_scene, varied_sensor

FIXED = "map"
LAYOUT, MEASUREMENT = 0, 1  # streams of random numbers
UNVARIED = Variation()

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Taking:
    """How a log is taken. scans: as planar scans and the joint that a laser rolls about, not as clouds;
    moving: while the robot drives by its stops, not while it stands at each.
    """

    scans: bool = False
    moving: bool = False


STANDING = Taking()


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A scene and all that is to be measured in it; scene and sensor are as the variation has them."""

    scene_name: str
    sensor_name: str
    seed: int
    variation: Variation
    scene: Scene
    sensor: Sensor
    drive: Drive
    taking: Taking = STANDING

    @property
    def frames(self) -> int:
        """Stops; also clouds, if the robot stands at each."""
        return len(self.drive.stamps)

    @property
    def about(self) -> dict[str, str | float]:
        """All that decides what comes out; of the variation only what differs."""
        return {
            "scene": self.scene_name,
            "sensor": self.sensor_name,
            "frames": self.frames,
            "seed": self.seed,
            **self.variation.about,
            **{name: True for name in ("scans", "moving") if getattr(self.taking, name)},
        }

    @property
    def labels(self) -> list[Label]:
        return truth.labels(self.scene, self.sensor.robot, FIXED)

    def pose(self, stop: int) -> Transform:
        """fixed<-robot at a stop."""
        return pose(self.scene.ground, self.sensor.robot, self.scene.stops[stop])


def simulation(
    scene: str,
    sensor: str,
    frames: int | None,
    seed: int,
    variation: Variation = UNVARIED,
    taking: Taking = STANDING,
) -> Simulation:
    """Lay out a scene for a sensor's robot, then vary it.

    Raises ConfigError for names that there are not, and for what cannot be varied or taken.
    """
    layout, chosen = _named(SCENES, scene, "scene"), _named(SENSORS, sensor, "sensor")
    count = layout.frames if frames is None else frames
    _require_possible(chosen, sensor, count, taking)
    laid_out = layout.build(np.random.default_rng([seed, LAYOUT]), chosen, count)
    varied, chosen = varied_scene(laid_out, scene, variation), varied_sensor(chosen, variation)
    way = _drive(varied, chosen, taking)
    return Simulation(scene, sensor, seed, variation, varied, chosen, way, taking)


def _require_possible(sensor: Sensor, name: str, frames: int, taking: Taking) -> None:
    rolls = isinstance(sensor.pattern, Rolling)
    if taking.scans and not rolls:
        planar = ", ".join(key for key, each in SENSORS.items() if isinstance(each.pattern, Rolling))
        raise ConfigError(f"scans: {name} makes no planar scans; leave them out, or take {planar}")
    if taking.moving and rolls and not taking.scans:
        raise ConfigError(f"moving: clouds of {name} are of a robot that stands; take scans as well")
    if taking.moving and frames < 2:
        raise ConfigError(f"moving: no way leads through {frames} stop; take 2 frames or more")


def _drive(scene: Scene, sensor: Sensor, taking: Taking) -> Drive:
    ramps = RAMP if isinstance(sensor.pattern, Rolling) and taking.scans else 0.0
    period = sensor.pattern.period
    return drive_on(scene, period + 2 * ramps) if taking.moving else drive(scene, period, PAUSE + ramps)


def clouds(simulated: Simulation) -> Iterator[NDArray[np.float32]]:
    """The points (N, 3) of each frame, in the sensor's frame [m]."""
    scenery = still(simulated)
    for stop in range(simulated.frames):
        yield cloud(simulated, scenery, stop)


def still(simulated: Simulation) -> Caster:
    """All of the scene that stays."""
    return caster(static_triangles(simulated.scene))


def cloud(simulated: Simulation, scenery: Caster, stop: int) -> NDArray[np.float32]:
    """One frame: cast the rays, make them noisy, lose some."""
    sensor = simulated.sensor
    random = np.random.default_rng([simulated.seed, MEASUREMENT, stop])
    rays = sensor.pattern.directions(random.uniform())
    towards = _rotated(rays.reshape(-1, 3), sensor.mount, simulated.pose(stop))
    origin = simulated.pose(stop).apply(sensor.mount.translation)
    hits = hits_at(simulated, scenery, stop, origin, towards)
    ranges = sensor.ranges(hits.shaped(rays.shape[:2]), random)
    seen = np.isfinite(ranges)
    return np.asarray(rays[seen] * ranges[seen][:, None], dtype=np.float32)


def hits_at(
    simulated: Simulation, scenery: Caster, stop: int, origin: FloatArray, towards: FloatArray
) -> Hits:
    """What rays hit, of what stays and of who passes at a stop; as for casting.cast, in the fixed frame."""
    hits = cast(scenery, origin, towards)
    if passing := simulated.scene.passing_at(stop):
        hits = nearer(hits, cast(caster(solid_triangles(passing)), origin, towards))
    return hits


def robot_at(simulated: Simulation, stamp: int) -> Transform:
    """fixed<-robot at any time [ns]."""
    place = simulated.drive.at(np.array([(stamp - START) / 1e9]))[0]
    return pose(simulated.scene.ground, simulated.sensor.robot, place)


def mounts_at(simulated: Simulation, seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """fixed<-mount of the sensor at times (K,) [s]: origins (K, 3) [m] and rotations (K, 3, 3)."""
    sensor = simulated.sensor
    places = simulated.drive.at(seconds)
    translations, quaternions = poses(simulated.scene.ground, sensor.robot, places)
    rotations = rotation_matrices(quaternions)
    return translations + rotations @ sensor.mount.translation, rotations @ sensor.mount.matrix


def _rotated(rays: FloatArray, mount: Transform, robot: Transform) -> FloatArray:
    return np.asarray(rays @ (robot.matrix @ mount.matrix).T, dtype=np.float64)


def _named(known: dict[str, T], name: str, what: str) -> T:
    if name not in known:
        raise ConfigError(f"{name}: no such {what}; there are {', '.join(known)}")
    return known[name]
