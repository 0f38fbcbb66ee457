"""How the robot gets from stop to stop, and when."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Robot
from gapeval.frame import FloatArray, Transform
from gapeval.simulate.scene import Ground, Scene
from gapeval.simulate.sensors import Sensor

START = 1_700_000_000 * 10**9  # ns, of every log
SPEED, TURN = 0.4, 0.5  # m/s, rad/s
SHUFFLE = 0.3  # m, below which the robot does not turn for its way
POSES_PER_SECOND = 50
PAUSE = 3 / POSES_PER_SECOND  # s before and after a cloud, so that poses beside its stamp are those at it


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """times: (M,) [s] since START; places: (M, 3) x, y [m], yaw [rad], straight in between.

    stamps: (N,) of the clouds [ns]: the robot stands while its sensor makes a pass, and stamps it at the end.
    """

    times: FloatArray
    places: FloatArray
    stamps: NDArray[np.int64]

    def at(self, seconds: FloatArray) -> FloatArray:
        """Places (K, 3) at times (K,) [s]."""
        return np.column_stack([np.interp(seconds, self.times, column) for column in self.places.T])

    @property
    def pose_stamps(self) -> NDArray[np.int64]:
        """When the robot's pose is published [ns]: at a rate of its own, never at the stamp of a cloud."""
        count = int(np.ceil((self.times[-1] - self.times[0]) * POSES_PER_SECOND)) + 2
        return START + np.arange(-1, count, dtype=np.int64) * (10**9 // POSES_PER_SECOND) + 3_141_592


def drive(scene: Scene, sensor: Sensor) -> Drive:
    """Stand at each stop for a pass of the sensor, then go on to the next."""
    stay = sensor.pattern.period + 2 * PAUSE
    times, places, departures = [0.0], [scene.stops[0]], []
    for stop in scene.stops:
        for place in _way(places[-1], stop):
            step = np.abs(place - places[-1])
            times.append(times[-1] + max(float(np.hypot(*step[:2])) / SPEED, float(step[2]) / TURN))
            places.append(place)
        times.append(times[-1] + stay)
        places.append(places[-1])
        departures.append(times[-1])
    # Stamps lie on whole milliseconds; poses, at 3.14 ms past every 20, do not.
    stamps = START + np.round((np.array(departures) - PAUSE) * 1e3).astype(np.int64) * 10**6
    return Drive(np.array(times), np.array(places), stamps)


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
    x, y, yaw = place.tolist()
    heading = np.array([np.cos(yaw), np.sin(yaw)])
    front, rear = (ground.level(x + side * robot.length / 2 * heading[0]) for side in (1.0, -1.0))
    pitch = -np.arctan2(front - rear, robot.length)
    c, s = np.cos(yaw / 2), np.sin(yaw / 2)
    a, b = np.cos(pitch / 2), np.sin(pitch / 2)
    standing = Transform.of([x, y, (front + rear) / 2], [-s * b, c * b, s * a, c * a])
    return Transform(standing.apply(np.array([0.0, 0.0, -robot.ground_z])), standing.quaternion)
