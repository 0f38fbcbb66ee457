"""A log, ready to be read frame by frame: the plain data."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gapeval.config import BodyBox, PoseError, PoseNoise, RotatingLaser
from gapeval.frame import FloatArray
from gapeval.logs.read.container import Loss, Topic
from gapeval.logs.read.transforms import Stamps, Transforms


@dataclass(frozen=True, slots=True, eq=False)
class Sources:
    """The messages that clouds are made of and that have all their transforms, sorted by stamp; m of them.

    topics: (m,) places among the recording's cloud topics. stamps: (m,) [ns]. bag_times: (m,) [ns]; ranks:
    (m,) place among the topic's messages with the same bag time; indices: (m,) place among all messages of
    the topic. frames: (m,) frame_id.
    times: (m, K) [ns], sorted in each row, between which its points were measured; knots: (m * K,) transforms
    reference<-cloud at these. K is 1 where all points of a message count as measured at its stamp.
    sensor: (m,) robot<-sensor, pose: (m,) fixed<-robot, both at the stamp; None without a fixed frame.
    """

    topics: NDArray[np.int64]
    stamps: Stamps
    bag_times: Stamps
    ranks: NDArray[np.int64]
    indices: NDArray[np.int64]
    frames: tuple[str, ...]
    times: Stamps
    knots: Transforms
    sensor: Transforms
    pose: Transforms | None

    def __len__(self) -> int:
        return len(self.stamps)

    def knots_of(self, index: int) -> Transforms:
        """reference<-cloud at the times of one message, (K,)."""
        count = self.times.shape[1]
        return self.knots.part(slice(index * count, (index + 1) * count))


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """The clouds, sorted by stamp; n of them, each of one message or of several.

    main: (n,) the source whose stamp the cloud has. members: (p,) the sources of all clouds, one cloud after
    the other; ends: (n + 1,) where each begins and ends among them.
    up: (n, 3) against gravity in the robot frame, NaN where that is not known; quality: (n, 4), see quality.
    wrong: (n,) robot<-robot, errors made on purpose; None where there are none.
    """

    sources: Sources
    main: NDArray[np.int64]
    members: NDArray[np.int64]
    ends: NDArray[np.int64]
    up: FloatArray | None = None
    quality: FloatArray | None = None
    wrong: Transforms | None = None
    stamps: Stamps = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamps", self.sources.stamps[self.main])

    def __len__(self) -> int:
        return len(self.main)

    @property
    def pose(self) -> Transforms | None:
        """fixed<-robot at the stamps, (n,)."""
        return None if self.sources.pose is None else self.sources.pose.take(self.main)

    def members_of(self, index: int) -> NDArray[np.int64]:
        """The sources of one cloud."""
        return self.members[self.ends[index] : self.ends[index + 1]]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Everything about a log but its clouds. Can be pickled for another process.

    container: the kind of file; start, end: first and last bag time [ns], None if unknown.
    cloud_topics: the first one's stamps are the clouds'. planar: whether they are scans of a rotating laser.
    pose_source: `tf`, the name of a pose topic or file, or `none` without a fixed frame.
    sensor_frame: the laser's; cloud_frames: those that the clouds are in. reference: the frame that the
    sources' transforms lead to: robot_frame, or fixed_frame where clouds are gathered while the robot moves.
    lowest_elevations: lowest ray of the sensor of each cloud topic [rad], in the sensor frame.
    total: clouds in the log. refused: reason -> clouds refused for it so far; examples: reason -> a few of
    their stamps [ns]. Clouds that turn out to hold nothing are refused only when they are read.
    notices: what is worth telling, one line each. losses: what of the log could not be read.
    laser: how planar scans are read. deskew: whether points are moved by their own times.
    body: what is the robot itself, dropped where it stood when each scan was made.
    checked: whether all clouds were there; of a large log that shows only when they are read. strict: whether
    one that is not is an error.
    pose_error, pose_noise: of robot<-cloud in the scans, made on purpose; None where there is none.
    """

    path: Path
    container: str
    topics: tuple[Topic, ...]
    cloud_topics: tuple[str, ...]
    planar: bool
    pose_source: str
    robot_frame: str
    fixed_frame: str | None
    sensor_frame: str
    cloud_frames: tuple[str, ...]
    reference: str
    start: int | None
    end: int | None
    lowest_elevations: tuple[float, ...]
    scans: Scans
    total: int
    refused: dict[str, int]
    examples: dict[str, tuple[int, ...]]
    notices: tuple[str, ...]
    losses: tuple[Loss, ...] = ()
    laser: RotatingLaser = field(default_factory=RotatingLaser)
    deskew: bool = False
    body: BodyBox | None = None
    checked: bool = True
    strict: bool = False
    pose_error: PoseError | None = None
    pose_noise: PoseNoise | None = None

    @property
    def matched(self) -> int:
        """Clouds that have all their transforms."""
        return len(self.scans)

    @property
    def cloud_topic(self) -> str:
        """As it is shown."""
        return " + ".join(self.cloud_topics)

    @property
    def lowest_elevation(self) -> float:
        """Of the sensor that gives the clouds their stamps [rad]."""
        return self.lowest_elevations[0]


@dataclass(frozen=True, slots=True)
class RefusedScan:
    """A cloud that cannot be used. reason: a constant text; detail: what is wrong with this one."""

    stamp: int
    reason: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.reason}: {self.detail}" if self.detail else self.reason
