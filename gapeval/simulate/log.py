"""The log of a simulation and its labels: messages in the order of their stamps, and their files."""

import heapq
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from gapeval.errors import GapevalError
from gapeval.files import make_folder, whole_file
from gapeval.frame import Transform
from gapeval.labels import labels_text
from gapeval.logs.write import Cloud, Link, Links, Message, Scan, log_path, write_log
from gapeval.simulate.drive import START, pose
from gapeval.simulate.joint import Joint
from gapeval.simulate.scans import Scans, joint_of, scans
from gapeval.simulate.sensors import Rolling
from gapeval.simulate.simulation import FIXED, Simulation, clouds
from gapeval.simulate.turns import Turn, turns

ODOMETRY, ROBOT, MOUNT = "odom", "base_link", "laser_mount"
CLOUD_TOPIC, SCAN_TOPIC = "/points", "/scan"
LABELS = "labels.geojson"
# fixed<-odometry: where the odometry began, as a localisation would have it.
ODOMETRY_ORIGIN = Transform.of([1.5, -0.7, 0.0], [0.0, 0.0, np.sin(0.2), np.cos(0.2)])
P = TypeVar("P", Scans, Turn)
ROLL_PERIOD, ROLL_LAG = 10_000_000, 1_618_034  # ns between transforms of the joint, past whole periods


def write_simulation(
    simulated: Simulation, folder: Path, container: str, advance: Callable[[], object]
) -> tuple[Path, Path]:
    """The log, and labels.geojson beside it; returns both. `advance` is called once for each stop.

    Raises GapevalError where the folder holds anything else of these names: it may be the work of a hand.
    """
    log, labels = log_path(folder, simulated.scene_name, container), folder / LABELS
    make_folder(folder)
    _require_replaceable(log, labels, simulated.about)
    with whole_file(labels) as file:
        file.write(labels_text(simulated.labels, FIXED, simulated=simulated.about))
        file.flush()  # a disk without room for them should not get a log without labels
        write_log(log, container, messages(simulated, advance))
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


def messages(simulated: Simulation, advance: Callable[[], object]) -> Iterator[Message]:
    """tf_static, then poses and what is measured in the order of their stamps."""
    sensor, start = simulated.sensor, int(simulated.drive.pose_stamps[0])
    taking = simulated.taking
    mounted = MOUNT if taking.scans else sensor.frame_id
    yield Links(start, (Link(ROBOT, mounted, sensor.mount),), is_static=True)
    parts = [_pose_messages(simulated)]
    if taking.scans:
        parts += [_roll_messages(simulated, joint_of(simulated)), _scan_messages(simulated, advance)]
    else:
        parts.append((_turn_messages if taking.moving else _cloud_messages)(simulated, advance))
    yield from heapq.merge(*parts, key=lambda message: message.stamp)


def _cloud_messages(simulated: Simulation, advance: Callable[[], object]) -> Iterator[Message]:
    for stamp, points in zip(simulated.drive.stamps.tolist(), clouds(simulated), strict=True):
        advance()
        yield Cloud(stamp, CLOUD_TOPIC, simulated.sensor.frame_id, points)


def _turn_messages(simulated: Simulation, advance: Callable[[], object]) -> Iterator[Message]:
    frame = simulated.sensor.frame_id
    for turn in _counted(turns(simulated), simulated.frames, advance):
        yield Cloud(turn.stamp, CLOUD_TOPIC, frame, turn.points, turn.nanoseconds)


def _scan_messages(simulated: Simulation, advance: Callable[[], object]) -> Iterator[Message]:
    sensor, pattern = simulated.sensor, simulated.sensor.pattern
    assert isinstance(pattern, Rolling)
    for some in _counted(scans(simulated), simulated.frames, advance):
        for stamp, ranges in zip(some.stamps.tolist(), some.ranges, strict=True):
            yield Scan(
                stamp, SCAN_TOPIC, sensor.frame_id, ranges, pattern.beams,
                pattern.beam_period, pattern.scan_period, (sensor.nearest, sensor.farthest),
            )  # fmt: skip


def _counted(parts: Iterable[P], stops: int, advance: Callable[[], object]) -> Iterator[P]:
    """What is measured, in the order of stops; advances when a stop is done with."""
    done = 0
    for part in parts:
        for _ in range(done, part.stop):
            advance()
        done = part.stop
        yield part
    for _ in range(done, stops):
        advance()


def _roll_messages(simulated: Simulation, joint: Joint) -> Iterator[Message]:
    end = int(simulated.drive.pose_stamps[-1])
    stamps = np.arange(START - ROLL_PERIOD, end + ROLL_PERIOD, ROLL_PERIOD, dtype=np.int64) + ROLL_LAG
    rolls = joint.roll((stamps - START) / 1e9)
    for stamp, roll in zip(stamps.tolist(), rolls.tolist(), strict=True):
        turned = Transform.of([0.0, 0.0, 0.0], [np.sin(roll / 2), 0.0, 0.0, np.cos(roll / 2)])
        yield Links(stamp, (Link(MOUNT, simulated.sensor.frame_id, turned),), is_static=False)


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
