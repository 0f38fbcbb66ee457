"""A scene, seen by a sensor: frames to the last noisy point, and the messages of a log."""

import heapq
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gapeval.errors import ConfigError, GapevalError
from gapeval.files import make_folder, whole_file
from gapeval.frame import FloatArray, Transform
from gapeval.labels import Label, labels_text
from gapeval.logs.write import Cloud, Link, Links, Message, log_path, write_log
from gapeval.simulate import truth
from gapeval.simulate.casting import Caster, cast, caster, nearer
from gapeval.simulate.drive import START, Drive, drive, pose
from gapeval.simulate.layouts import SCENES
from gapeval.simulate.mesh import solid_triangles, static_triangles
from gapeval.simulate.scene import Scene
from gapeval.simulate.sensors import SENSORS, Sensor
from gapeval.simulate.variation import Variation, varied_scene, varied_sensor

FIXED, ODOMETRY, ROBOT = "map", "odom", "base_link"
CLOUD_TOPIC = "/points"
LABELS = "labels.geojson"
# fixed<-odometry: where the odometry began, as a localisation would have it.
ODOMETRY_ORIGIN = Transform.of([1.5, -0.7, 0.0], [0.0, 0.0, np.sin(0.2), np.cos(0.2)])
LAYOUT, MEASUREMENT = 0, 1  # streams of random numbers
UNVARIED = Variation()

T = TypeVar("T")


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

    @property
    def frames(self) -> int:
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
        }

    @property
    def labels(self) -> list[Label]:
        return truth.labels(self.scene, self.sensor.robot, FIXED)

    def pose(self, stop: int) -> Transform:
        """fixed<-robot at a stop."""
        return pose(self.scene.ground, self.sensor.robot, self.scene.stops[stop])


def simulation(
    scene: str, sensor: str, frames: int | None, seed: int, variation: Variation = UNVARIED
) -> Simulation:
    """Lay out a scene for a sensor's robot, then vary it.

    Raises ConfigError for names that there are not, and for what cannot be varied.
    """
    layout, chosen = _named(SCENES, scene, "scene"), _named(SENSORS, sensor, "sensor")
    count = layout.frames if frames is None else frames
    laid_out = layout.build(np.random.default_rng([seed, LAYOUT]), chosen, count)
    varied, chosen = varied_scene(laid_out, scene, variation), varied_sensor(chosen, variation)
    return Simulation(scene, sensor, seed, variation, varied, chosen, drive(varied, chosen))


def clouds(simulated: Simulation) -> Iterator[NDArray[np.float32]]:
    """The points (N, 3) of each frame, in the sensor's frame [m]."""
    still = caster(static_triangles(simulated.scene))
    for stop in range(simulated.frames):
        yield cloud(simulated, still, stop)


def cloud(simulated: Simulation, still: Caster, stop: int) -> NDArray[np.float32]:
    """One frame: cast the rays, make them noisy, lose some."""
    sensor = simulated.sensor
    random = np.random.default_rng([simulated.seed, MEASUREMENT, stop])
    rays = sensor.pattern.directions(random.uniform())
    towards = _rotated(rays.reshape(-1, 3), sensor.mount, simulated.pose(stop))
    origin = simulated.pose(stop).apply(sensor.mount.translation)
    hits = cast(still, origin, towards)
    if passing := simulated.scene.passing_at(stop):
        hits = nearer(hits, cast(caster(solid_triangles(passing)), origin, towards))
    ranges = sensor.ranges(hits.shaped(rays.shape[:2]), random)
    seen = np.isfinite(ranges)
    return np.asarray(rays[seen] * ranges[seen][:, None], dtype=np.float32)


def write_simulation(
    simulated: Simulation, folder: Path, container: str, advance: Callable[[], object]
) -> tuple[Path, Path]:
    """The log, and labels.geojson beside it; returns both. `advance` is called after each cloud.

    Raises GapevalError where the folder holds anything else of these names: it may be the work of a hand.
    """
    log, labels = log_path(folder, simulated.scene_name, container), folder / LABELS
    make_folder(folder)
    _require_replaceable(log, labels, simulated.about)
    with whole_file(labels) as file:
        file.write(labels_text(simulated.labels, FIXED, simulated=simulated.about))
        file.flush()  # a disk without room for them should not get a log without labels
        write_log(log, container, _messages(simulated, advance))
    return log, labels


def _require_replaceable(log: Path, labels: Path, about: dict[str, str | float]) -> None:
    """What is there must be of the same simulation, so that labels and logs of a folder go together."""
    earlier = None
    if labels.exists():
        try:
            earlier = json.loads(labels.read_text(encoding="utf-8")).get("simulated")
        except (OSError, ValueError, AttributeError):
            earlier = None
        if earlier is None:
            raise GapevalError(f"{labels}: exists and was not made by simulate; choose another folder")
        if earlier != about:
            said = ", ".join(f"{key} {value}" for key, value in earlier.items())
            raise GapevalError(f"{labels.parent}: holds another simulation ({said}); choose another folder")
    elif log.exists():
        raise GapevalError(f"{log}: exists and was not made by simulate; choose another folder")


def _messages(simulated: Simulation, advance: Callable[[], object]) -> Iterator[Message]:
    """tf_static, then poses and clouds in the order of their stamps."""
    sensor, start = simulated.sensor, int(simulated.drive.pose_stamps[0])
    yield Links(start, (Link(ROBOT, sensor.frame_id, sensor.mount),), is_static=True)
    yield from heapq.merge(
        _pose_messages(simulated), _cloud_messages(simulated, advance), key=lambda message: message.stamp
    )


def _cloud_messages(simulated: Simulation, advance: Callable[[], object]) -> Iterator[Message]:
    for stamp, points in zip(simulated.drive.stamps.tolist(), clouds(simulated), strict=True):
        advance()
        yield Cloud(stamp, CLOUD_TOPIC, simulated.sensor.frame_id, points)


def _pose_messages(simulated: Simulation) -> Iterator[Message]:
    scene, robot = simulated.scene, simulated.sensor.robot
    stamps = simulated.drive.pose_stamps
    for stamp, place in zip(stamps.tolist(), simulated.drive.at((stamps - START) / 1e9), strict=True):
        links = (
            Link(FIXED, ODOMETRY, ODOMETRY_ORIGIN),
            Link(ODOMETRY, ROBOT, seen_from(ODOMETRY_ORIGIN, pose(scene.ground, robot, place))),
        )
        yield Links(stamp, links, is_static=False)


def seen_from(origin: Transform, place: Transform) -> Transform:
    """A pose relative to another, both in one frame."""
    x, y, z, w = origin.quaternion
    back = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z], [x, y, z, w]])
    return Transform.of(origin.apply_inverse(place.translation), back @ place.quaternion)


def _rotated(rays: FloatArray, mount: Transform, robot: Transform) -> FloatArray:
    return np.asarray(rays @ (robot.matrix @ mount.matrix).T, dtype=np.float64)


def _named(known: dict[str, T], name: str, what: str) -> T:
    if name not in known:
        raise ConfigError(f"{name}: no such {what}; there are {', '.join(known)}")
    return known[name]
