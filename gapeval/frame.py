"""The plain data that everything speaks: rigid transforms, planes, and one scan with its pose."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gapeval.config import BodyBox

FloatArray = NDArray[np.float64]


def rotation_matrices(quaternions: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4), ordered x, y, z, w as in ROS."""
    x, y, z, w = np.moveaxis(np.asarray(quaternions, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """A rigid transform target<-source: p_target = rotation(quaternion) p_source + translation.

    translation: (3,) [m]; quaternion: (4,) x, y, z, w, of unit length (normalised when made by `of`).
    Equal by value: a sensor that does not move on its robot has the same mount in every frame.
    """

    translation: FloatArray
    quaternion: FloatArray
    matrix: FloatArray = field(init=False, repr=False)  # rotation, (3, 3)

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", rotation_matrices(self.quaternion))

    @classmethod
    def of(cls, translation: object, quaternion: object) -> Self:
        """From anything array-like; raises ValueError for a quaternion without direction."""
        t = np.array(translation, dtype=np.float64).reshape(3)
        q = np.array(quaternion, dtype=np.float64).reshape(4)
        norm = float(np.linalg.norm(q))
        if not (np.isfinite(t).all() and np.isfinite(norm) and norm > 1e-6):
            raise ValueError("a transform needs finite numbers and a quaternion other than zero")
        # A unit quaternion stays as it is, so that what was written reads back equal.
        return cls(t, q if abs(norm - 1.0) < 1e-12 else q / norm)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Transform) and self._numbers() == other._numbers()

    def __hash__(self) -> int:
        return hash(self._numbers())

    def _numbers(self) -> bytes:
        return self.translation.tobytes() + self.quaternion.tobytes()

    @classmethod
    def identity(cls) -> Self:
        return cls(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))

    def apply(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the source frame in the target frame."""
        return points @ self.matrix.T + self.translation

    def apply_inverse(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the target frame in the source frame."""
        return (points - self.translation) @ self.matrix


def sensor_angles(mount: Transform, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Azimuth and elevation [rad] (...) at which a sensor sees places (..., 3) of the robot frame.

    mount: robot<-sensor. Angles are in the sensor's own frame, but elevation is positive upwards also
    for a sensor that hangs upside down.
    """
    ray = mount.apply_inverse(places)
    return np.arctan2(ray[..., 1], ray[..., 0]), sensor_elevation(mount, places)


def sensor_elevation(mount: Transform, places: FloatArray) -> FloatArray:
    """The elevation [rad] (...) alone."""
    ray = mount.apply_inverse(places)
    elevation: FloatArray = np.arctan2(upright(mount) * ray[..., 2], np.hypot(ray[..., 0], ray[..., 1]))
    return elevation


def upright(mount: Transform) -> float:
    """1 for a sensor whose z axis points up, -1 for one that hangs upside down."""
    return 1.0 if mount.matrix[2, 2] >= 0 else -1.0


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Where else points of a cloud were seen from. mount: robot<-sensor, at the cloud's stamp.

    lowest_elevation: lowest ray of that sensor [rad], in its frame.
    """

    mount: Transform
    lowest_elevation: float


@dataclass(frozen=True, slots=True)
class PoseQuality:
    """How well the robot's pose is known at a stamp.

    gap: widest time between two transforms that were interpolated [s]. roll, pitch [rad] and height [m]:
    standard deviations, of the log's covariance and of what changes between those two transforms. NaN where
    the log does not tell.
    """

    gap: float
    roll: float
    pitch: float
    height: float


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One scan, or several that were gathered to one cloud.

    stamp: integer nanoseconds, from the message header.
    points: (N, 3) float32, robot frame [m], finite.
    sensor: robot<-sensor; its translation is the laser's origin.
    lowest_elevation: lowest ray of the sensor [rad], in the sensor frame; -pi/2 if it sees straight down.
    pose: fixed<-robot; None for a log without any fixed frame.
    dropped: points of the cloud that are left out here, being NaN, infinite or at exactly (0, 0, 0).
    digest: SHA-256 of what was decoded, where the frame was read from a log.
    others: where else points were seen from; empty for one scan of one sensor.
    up: (3,) unit vector against gravity, robot frame; None where the log does not tell.
    quality: of the pose; None for a log without any.
    """

    stamp: int
    points: NDArray[np.float32]
    sensor: Transform = field(default_factory=Transform.identity)
    lowest_elevation: float = -np.pi / 2
    pose: Transform | None = None
    dropped: int = 0
    digest: bytes = b""
    others: tuple[Viewpoint, ...] = ()
    up: tuple[float, float, float] | None = None
    quality: PoseQuality | None = None


@dataclass(frozen=True, slots=True)
class Plane:
    """ax + by + cz + d = 0 in the robot frame, with (a, b, c) of unit length and c > 0."""

    a: float
    b: float
    c: float
    d: float

    def distance(self, points: FloatArray) -> FloatArray:
        """Eq. (1): signed distance t_i [m] of points (..., 3), positive above the plane; (...)."""
        t: FloatArray = points @ np.array([self.a, self.b, self.c]) + self.d
        return t

    def height(self, places: FloatArray) -> FloatArray:
        """z [m] of the plane at places (..., 2)."""
        z: FloatArray = 0.0 - (self.a * places[..., 0] + self.b * places[..., 1] + self.d) / self.c
        return z


def robot_plane(ground_z: float) -> Plane:
    """The plane z = ground_z of the robot frame."""
    return Plane(0.0, 0.0, 1.0, -ground_z)


def of_body(points: NDArray[np.float32], body: BodyBox | None) -> NDArray[np.bool_]:
    """Which points (N, 3), robot frame [m], are of the robot itself, (N,)."""
    if body is None:
        return np.zeros(len(points), dtype=np.bool_)
    low, high = np.array([body.x, body.y, body.z]).T
    inside: NDArray[np.bool_] = ((points >= low) & (points <= high)).all(axis=1)
    return inside
