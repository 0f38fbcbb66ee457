"""What results were made from: versions, inputs and counts. No dates and no number of workers."""

import hashlib
import platform
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

from gapeval import __version__
from gapeval.labels import Labels
from gapeval.logs.read import Recording

SCORER = 1  # raise it when equal inputs are scored differently; such results cannot be compared
LIBRARIES = ("numpy", "opencv-python-headless", "shapely", "scipy", "rosbags", "mcap")


def versions() -> dict[str, str]:
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


class LogHash:
    """A log's identity: the hash of what was decoded, frame by frame, not of the file's bytes."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()

    def add(self, frame_digest: bytes) -> None:
        self._digest.update(frame_digest)

    def hexdigest(self) -> str:
        return self._digest.hexdigest()


def log_entry(
    name: str, recording: Recording, sha256: str, frames: int, refused: dict[str, int]
) -> dict[str, Any]:
    """One log: what it is, what was picked in it, how much was read and what was refused."""
    return {
        "log": name,
        "sha256": sha256,
        "container": recording.container,
        "cloud_topic": recording.cloud_topic,
        "pose_source": recording.pose_source,
        "robot_frame": recording.robot_frame,
        "fixed_frame": recording.fixed_frame,
        "sensor_frame": recording.sensor_frame,
        "lowest_elevation": recording.lowest_elevation,
        "clouds": recording.total,
        "frames": frames,
        "refused": dict(sorted(refused.items())),
        "notices": list(recording.notices),
    }


def label_entry(labels: Labels) -> dict[str, Any]:
    return {"labels": labels.path.name, "sha256": labels.sha256, "features": len(labels.labels)}


def manifest(
    logs: Sequence[dict[str, Any]], labels: Sequence[dict[str, Any]], configurations: int
) -> dict[str, Any]:
    return {
        "gapeval": __version__,
        "scorer": SCORER,
        "versions": versions(),
        "configurations": configurations,
        "logs": list(logs),
        "labels": list(labels),
    }
