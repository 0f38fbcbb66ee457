"""A log, ready to be read frame by frame: the plain data."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gapeval.config import PoseError, PoseNoise
from gapeval.logs.read.container import Topic
from gapeval.logs.read.transforms import Transforms


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """The clouds that have all their transforms, sorted by stamp; n of each.

    stamps, bag_times: (n,) [ns]; ranks: (n,) place among the topic's messages with the same bag time;
    indices: (n,) place among all messages of the topic; cloud_frames: (n,) frame_id.
    cloud, sensor: robot<-cloud, robot<-sensor; pose: fixed<-robot, None without a fixed frame.
    """

    stamps: NDArray[np.int64]
    bag_times: NDArray[np.int64]
    ranks: NDArray[np.int64]
    indices: NDArray[np.int64]
    cloud_frames: tuple[str, ...]
    cloud: Transforms
    sensor: Transforms
    pose: Transforms | None

    def __len__(self) -> int:
        return len(self.stamps)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Everything about a log but its clouds. Can be pickled for another process.

    container: the kind of file; start, end: first and last bag time [ns], None if unknown.
    pose_source: `tf`, the name of a pose topic, or `none` without a fixed frame.
    sensor_frame: the laser's; cloud_frames: those that the clouds are in.
    lowest_elevation: lowest ray of the sensor [rad], in the sensor frame.
    total: clouds in the log. refused: reason -> clouds refused for it so far; examples: reason -> a few of
    their stamps [ns]. Clouds that turn out to hold nothing are refused only when they are read.
    notices: what is worth telling, one line each.
    pose_error, pose_noise: of robot<-cloud in the scans, made on purpose; None where there is none.
    """

    path: Path
    container: str
    topics: tuple[Topic, ...]
    cloud_topic: str
    pose_source: str
    robot_frame: str
    fixed_frame: str | None
    sensor_frame: str
    cloud_frames: tuple[str, ...]
    start: int | None
    end: int | None
    lowest_elevation: float
    scans: Scans
    total: int
    refused: dict[str, int]
    examples: dict[str, tuple[int, ...]]
    notices: tuple[str, ...]
    pose_error: PoseError | None = None
    pose_noise: PoseNoise | None = None

    @property
    def matched(self) -> int:
        """Clouds that have all their transforms."""
        return len(self.scans)


@dataclass(frozen=True, slots=True)
class RefusedScan:
    """A cloud that cannot be used. reason: a constant text; detail: what is wrong with this one."""

    stamp: int
    reason: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.reason}: {self.detail}" if self.detail else self.reason
