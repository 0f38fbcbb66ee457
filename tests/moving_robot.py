"""A robot that drives a curve past points that stand still: what its sensors say, exactly."""

from typing import Any

import numpy as np
from logs_writer import CLOUD, Record, cloud_message, header, static_record, tf_record

from gapeval.frame import Transform, rotation_matrices

SECOND = 10**9
START = 1_700_000_000 * SECOND
MOUNT = Transform.of([0.3, 0.1, 0.8], [0.0, 0.1, 0.0, 0.995])
REAR = Transform.of([-0.4, 0.0, 0.6], [0.0, 0.0, 1.0, 0.05])
STILL = np.random.default_rng(1).uniform([-8, -8, -0.5], [14, 8, 2.0], (400, 3))
LASER = "sensor_msgs/msg/LaserScan"
IMU = "sensor_msgs/msg/Imu"


def poses(stamps: Any) -> tuple[np.ndarray, np.ndarray]:
    """map<-base_link at stamps (n,): translations (n, 3) and quaternions (n, 4)."""
    t = (np.asarray(stamps, dtype=np.int64) - START) / SECOND
    place = np.column_stack([0.5 * t, 0.3 * np.sin(t), 0.02 * np.sin(3 * t)])
    yaw, roll = 0.4 * np.sin(0.7 * t), 0.03 * np.sin(2 * t)
    a, b, c, d = np.sin(yaw / 2), np.cos(yaw / 2), np.sin(roll / 2), np.cos(roll / 2)
    return place, np.column_stack([b * c, a * c, a * d, b * d])


def pose(stamp: int) -> Transform:
    place, turn = poses([stamp])
    return Transform.of(place[0], turn[0])


def into_robot(world: np.ndarray, stamps: Any) -> np.ndarray:
    """Points (n, 3) of the map in base_link, each at its stamp (n,)."""
    place, turn = poses(stamps)
    return np.einsum("nji,nj->ni", rotation_matrices(turn), world - place)


def tf(seconds: float, rate: int = 200, **mounts: Transform) -> list[Record]:
    """Poses on /tf, from a little before START on, and mounts on /tf_static."""
    stamps = START - SECOND // 2 + np.arange(int((seconds + 1.0) * rate)) * (SECOND // rate) + 777
    place, turn = poses(stamps)
    moving = [
        tf_record(int(s), [("map", "base_link", p.tolist(), q.tolist())])
        for s, p, q in zip(stamps, place, turn, strict=True)
    ]
    still = [
        ("base_link", name, mount.translation.tolist(), mount.quaternion.tolist())
        for name, mount in mounts.items()
    ]
    return [static_record(START - SECOND, still), *moving] if still else moving


def skewed(stamp: int, times: np.ndarray, mount: Transform = MOUNT) -> np.ndarray:
    """STILL as a sensor sees it, each point at its own time since a stamp (n,) [ns]."""
    return mount.apply_inverse(into_robot(STILL, stamp + times))


def cloud(stamp: int, points: np.ndarray, frame: str = "lidar", topic: str = "/points") -> Record:
    return Record(topic, CLOUD, stamp, lambda store: cloud_message(store, stamp, frame, points))


def timed_cloud(stamp: int, points: np.ndarray, times: np.ndarray) -> Record:
    """With a field `t`, uint32 nanoseconds since the stamp."""
    rows = np.zeros(len(points), dtype=[("xyz", "<f4", 3), ("t", "<u4")])
    rows["xyz"], rows["t"] = points, times
    layout = {
        "fields": [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("t", 12, 6, 1)],
        "data": rows.view(np.uint8).reshape(-1),
    }
    return Record("/points", CLOUD, stamp, lambda s: cloud_message(s, stamp, "lidar", points, **layout))


def scan(
    stamp: int,
    ranges: np.ndarray,
    first: float,
    step: float,
    increment: float,
    frame: str = "laser",
    topic: str = "/scan",
) -> Record:
    def build(store: Any) -> Any:
        return store.types[LASER](
            header=header(store, stamp, frame),
            angle_min=first,
            angle_max=first + step * (len(ranges) - 1),
            angle_increment=step,
            time_increment=increment,
            scan_time=0.02,
            range_min=0.05,
            range_max=60.0,
            ranges=ranges.astype(np.float32),
            intensities=np.empty(0, dtype=np.float32),
        )

    return Record(topic, LASER, stamp, build)


def imu(stamp: int, quaternion: Any, frame: str = "imu", topic: str = "/imu") -> Record:
    def build(store: Any) -> Any:
        make = store.types
        zero = make["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
        x, y, z, w = map(float, quaternion)
        return make[IMU](
            header=header(store, stamp, frame),
            orientation=make["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
            orientation_covariance=np.zeros(9),
            angular_velocity=zero,
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=zero,
            linear_acceleration_covariance=np.zeros(9),
        )

    return Record(topic, IMU, stamp, build)
