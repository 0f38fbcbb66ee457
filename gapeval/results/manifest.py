"""What results were made from: versions, inputs and counts. No dates and no number of workers."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from gapeval import __version__
from gapeval.labels import Labels
from gapeval.logs.read import Recording
from gapeval.sweep.provenance import revision, source, versions

SCORER = 2  # raise it when equal inputs are scored differently; such results cannot be compared


@dataclass(slots=True)
class LogTally:
    """What was read of one log, and refused, with the reasons.

    identity: hash of what was decoded, frame by frame; the log's file may hold it in any container.
    """

    refused: dict[str, int]
    identity: "hashlib._Hash" = field(default_factory=hashlib.sha256)
    frames: int = 0
    points: int = 0
    dropped: int = 0

    def add(self, frame_digest: bytes, points: int, dropped: int) -> None:
        self.identity.update(frame_digest)
        self.frames += 1
        self.points += points
        self.dropped += dropped

    def refuse(self, reason: str) -> None:
        self.refused[reason] = self.refused.get(reason, 0) + 1


def log_entry(name: str, recording: Recording, tally: LogTally, labels: Labels | None) -> dict[str, Any]:
    """One log: what it is, what was picked in it, how much was read and what was refused.

    Errors of poses are named only where there are any.
    """
    errors = {"pose_error": recording.pose_error, "pose_noise": recording.pose_noise}
    return {
        "log": name,
        "sha256": tally.identity.hexdigest() if tally.frames else None,
        "labels": labels and labels.sha256,
        "container": recording.container,
        "cloud_topic": recording.cloud_topic,
        "pose_source": recording.pose_source,
        "robot_frame": recording.robot_frame,
        "fixed_frame": recording.fixed_frame,
        "sensor_frame": recording.sensor_frame,
        "lowest_elevation": recording.lowest_elevation,
        "clouds": recording.total,
        "frames": tally.frames,
        "refused": dict(sorted(tally.refused.items())),
        "points": tally.points,
        "points_dropped": tally.dropped,
        "notices": list(recording.notices),
        "losses": [asdict(loss) for loss in recording.losses],
        **{name: error.model_dump() for name, error in errors.items() if error is not None},
    }


def label_entry(labels: Labels) -> dict[str, Any]:
    return {"labels": labels.path.name, "sha256": labels.sha256, "features": len(labels.labels)}


def manifest(
    logs: Sequence[dict[str, Any]],
    labels: Sequence[dict[str, Any]],
    configurations: int,
    scoring: dict[str, Any],
    failed: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """scoring: how gaps were compared with labels, and in which domain.

    failed: the frames that are not in the results because something went wrong with them.
    """
    return {
        "gapeval": __version__,
        "revision": revision(),
        "source": source(),
        "scorer": SCORER,
        "scoring": scoring,
        "versions": versions(),
        "configurations": configurations,
        "logs": list(logs),
        "labels": list(labels),
        "failed": list(failed),
    }
