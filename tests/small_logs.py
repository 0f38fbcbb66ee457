"""Small logs of a robot on flat ground that drives towards a trench, with its labels."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from logs_writer import write_log

SECOND = 1_000_000_000
START = 1_600_000_000 * SECOND
SENSOR_HEIGHT = 1.0
TRENCH = ((2.0, -1.0), (2.6, 1.0))  # lower left and upper right corner, fixed frame


def stamps(count: int) -> list[int]:
    return [START + index * SECOND // 10 for index in range(count)]


def robot_x(index: int) -> float:
    """The robot drives along x."""
    return 0.05 * index


def cloud(index: int, seed: int = 0) -> np.ndarray:
    """Points (N, 3) in the sensor frame: ground with 1 cm of noise, but for the trench; a post behind it."""
    random = np.random.default_rng(1000 * seed + index)
    x, y = np.meshgrid(np.arange(0.3, 4.0, 0.04), np.arange(-3.0, 3.0, 0.04))
    ground = np.column_stack([x.ravel(), y.ravel(), random.normal(0.0, 0.01, x.size)])
    (left, bottom), (right, top) = TRENCH
    fixed = ground[:, 0] + robot_x(index)
    hidden = (fixed > left) & (fixed < right) & (ground[:, 1] > bottom) & (ground[:, 1] < top)
    post = np.column_stack([np.full(40, 3.5 - robot_x(index)), np.full(40, 0.5), np.linspace(0, 1.5, 40)])
    points = np.vstack([ground[~hidden], post]).astype(np.float32)
    points[:, 2] -= SENSOR_HEIGHT
    return points


def drive(path: Path, count: int = 4, container: str = "mcap", seed: int = 0, **options: Any) -> Path:
    """A log of `count` clouds, poses before and after each."""
    clouds = [(stamp, cloud(index, seed)) for index, stamp in enumerate(stamps(count))]
    return drive_with(path, clouds, container, **options)


def drive_with(
    path: Path, clouds: Sequence[tuple[int, Any]], container: str = "mcap", **options: Any
) -> Path:
    """A log of these clouds, on the same drive."""
    path.parent.mkdir(parents=True, exist_ok=True)
    half = SECOND // 20
    times = [START - half + index * half for index in range(2 * len(clouds) + 3)]
    poses = [(time, robot_x(0) + 0.05 * (time - START) / (SECOND / 10), 0.0, 0.0) for time in times]
    return write_log(
        path, clouds=clouds, poses=poses, container=container, sensor_height=SENSOR_HEIGHT, **options
    )


def trench_ring() -> list[list[float]]:
    (left, bottom), (right, top) = TRENCH
    return [[left, bottom, 0], [right, bottom, 0], [right, top, 0], [left, top, 0], [left, bottom, 0]]


def feature(ring: Any, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"id": "trench"} | properties,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }


def labels(path: Path, features: Sequence[Any] | None = None, **top: Any) -> Path:
    """A label file; by default the trench with all that is known of it."""
    if features is None:
        features = [feature(trench_ring(), traversable=True, length=0.6, crossing_yaw=0.0)]
    document = {"type": "FeatureCollection", "frame_id": "map", "features": list(features)} | top
    path.write_text(json.dumps(document))
    return path
