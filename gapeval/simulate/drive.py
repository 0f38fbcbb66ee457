"""How the robot gets from stop to stop, and when."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Robot
from gapeval.frame import FloatArray, Transform, rotation_matrices
from gapeval.simulate.scene import Ground, Scene

START = 1_700_000_000 * 10**9  # ns, of every log
SPEED, TURN = 0.4, 0.5  # m/s, rad/s
SHUFFLE = 0.3  # m, below which the robot does not turn for its way
POSES_PER_SECOND = 50
PAUSE = 3 / POSES_PER_SECOND  # s before and after a cloud, so that poses beside its stamp are those at it
KNOT = 0.01  # s between the places of a robot that drives on
EASE = 0.4  # s over which it changes its speed


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """times: (M,) [s] since START; places: (M, 3) x, y [m], yaw [rad], straight in between.

    stamps: (N,) of the stops [ns]: the robot stands while its sensor makes a pass, and stamps it at the end;
    or it drives by. departures: (N,) [s], when it goes on to the next.
    """

    times: FloatArray
    places: FloatArray
    stamps: NDArray[np.int64]
    departures: FloatArray

    def at(self, seconds: FloatArray) -> FloatArray:
        """Places (K, 3) at times (K,) [s]."""
        return np.column_stack([np.interp(seconds, self.times, column) for column in self.places.T])

    def stops(self, seconds: FloatArray) -> NDArray[np.intp]:
        """At which stop the robot is, or to which it drives (K,), at times (K,) [s]."""
        return np.minimum(np.searchsorted(self.departures, seconds), len(self.departures) - 1)

    @property
    def pose_stamps(self) -> NDArray[np.int64]:
        """When the robot's pose is published [ns]: at a rate of its own, never at the stamp of a cloud."""
        count = int(np.ceil((self.times[-1] - self.times[0]) * POSES_PER_SECOND)) + 2
        return START + np.arange(-1, count, dtype=np.int64) * (10**9 // POSES_PER_SECOND) + 3_141_592


def drive(scene: Scene, period: float, margin: float = PAUSE) -> Drive:
    """Stand at each stop for a pass of the sensor and a margin before and after [s]; go on to the next."""
    stay = period + 2 * margin
    times, places, departures = [0.0], [scene.stops[0]], []
    for stop in scene.stops:
        for seconds, place in _legs(places[-1], stop):
            times.append(times[-1] + seconds)
            places.append(place)
        times.append(times[-1] + stay)
        places.append(places[-1])
        departures.append(times[-1])
    # Stamps lie on whole milliseconds; poses, at 3.14 ms past every 20, do not.
    stamps = START + np.round((np.array(departures) - margin) * 1e3).astype(np.int64) * 10**6
    return Drive(np.array(times), np.array(places), stamps, np.array(departures))


def drive_on(scene: Scene, least: float) -> Drive:
    """Drive by each stop without standing there; from one to the next it takes at least so long [s].

    Speeds change gently, so that poses interpolated between those that are published are nearly exact.
    """
    times, places, passed = [EASE / 2], [scene.stops[0]], [EASE / 2]
    for stop in scene.stops[1:]:
        legs = _legs(places[-1], stop)
        slower = max(1.0, least / max(sum(seconds for seconds, _ in legs), 1e-9))
        for seconds, place in legs:
            times.append(times[-1] + seconds * slower)
            places.append(place)
        passed.append(times[-1])
    rough = np.arange(-round(EASE / KNOT), np.ceil((times[-1] + EASE) / KNOT) + 1) * KNOT
    width = round(EASE / KNOT) + 1  # knots, with both ends
    eased = []
    for column in np.array(places).T:
        sums = np.cumsum(np.concatenate([[0.0], np.interp(rough, times, column)]))
        eased.append((sums[width:] - sums[:-width]) / width)
    middle = rough[width // 2 : width // 2 + len(eased[0])]
    inside = middle > -KNOT / 2
    stamps = START + np.round(np.array(passed) * 1e3).astype(np.int64) * 10**6
    return Drive(middle[inside], np.column_stack(eased)[inside], stamps, np.array(passed))


def _legs(start: FloatArray, end: FloatArray) -> list[tuple[float, FloatArray]]:
    """Seconds and places on the way."""
    legs = []
    for place in _way(start, end):
        step = np.abs(place - start)
        legs.append((max(float(np.hypot(*step[:2])) / SPEED, float(step[2]) / TURN), place))
        start = place
    return legs


def _way(start: FloatArray, end: FloatArray) -> list[FloatArray]:
    """Places on the way: turn towards the end, drive straight there, turn as it wants; or just shuffle."""
    x, y, yaw = start
    away = end[:2] - start[:2]
    if np.hypot(*away) < SHUFFLE:
        return [end]
    turn = np.remainder(np.arctan2(away[1], away[0]) - yaw + np.pi / 2, np.pi) - np.pi / 2  # or backwards
    heading = yaw + turn
    there = heading + np.remainder(end[2] - heading + np.pi, 2 * np.pi) - np.pi  # the short way round
    return [np.array([x, y, heading]), np.array([*end[:2], heading]), np.array([*end[:2], there])]


def pose(ground: Ground, robot: Robot, place: FloatArray) -> Transform:
    """fixed<-robot of a robot that stands on the ground's profile at x, y [m], yaw [rad].

    It pitches as the profile does between its front and its rear; roughness does not move it.
    """
    translations, quaternions = poses(ground, robot, place[None])
    return Transform.of(translations[0], quaternions[0])


def poses(ground: Ground, robot: Robot, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same at places (K, 3): translations (K, 3) [m] and quaternions (K, 4)."""
    x, y, yaw = places.T
    front, rear = (ground.level(x + side * robot.length / 2 * np.cos(yaw)) for side in (1.0, -1.0))
    pitch = -np.arctan2(front - rear, robot.length)
    c, s = np.cos(yaw / 2), np.sin(yaw / 2)
    a, b = np.cos(pitch / 2), np.sin(pitch / 2)
    quaternions = np.column_stack([-s * b, c * b, s * a, c * a])
    foot = np.column_stack([x, y, (front + rear) / 2])
    up = rotation_matrices(quaternions)[:, :, 2]
    return foot - robot.ground_z * up, quaternions
