"""What a log holds and what gapeval would make of it, for `gapeval info`."""

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gapeval.config import LogSection, RotatingLaser
from gapeval.errors import LogError
from gapeval.logs.read.assembly import recording_of
from gapeval.logs.read.container import Container, Loss, Topic, ros1_type
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.laser import echoes
from gapeval.logs.read.messages.cloud import DATATYPES, PackedCloud, UnreadableCloudError, cloud_points
from gapeval.logs.read.messages.content import UndecodableError, laser_scan, packed_cloud, role_of
from gapeval.logs.read.messages.point_time import TimeField, timed_points
from gapeval.logs.read.preparation import survey_log
from gapeval.logs.read.recording import Recording
from gapeval.logs.read.samples import build_tree, tf_topics
from gapeval.logs.read.survey import Progress, Window, take_survey
from gapeval.logs.read.transforms import Edge, TransformTree


@dataclass(frozen=True, slots=True)
class TopicSummary:
    name: str
    type: str
    serialization: str
    count: int


@dataclass(frozen=True, slots=True)
class FieldSummary:
    name: str
    type: str
    offset: int
    count: int


@dataclass(frozen=True, slots=True)
class CloudSummary:
    """The first cloud of a topic. rate: clouds per second over the log; finite, not_finite, zero: points.

    problem: why it cannot be read, else empty. time: where it has the time of each point; no_time: why there
    is none.
    """

    topic: str
    frame_id: str
    width: int
    height: int
    point_step: int
    row_step: int
    is_bigendian: bool
    fields: tuple[FieldSummary, ...]
    rate: float | None
    finite: int
    not_finite: int
    zero: int
    problem: str
    time: TimeField | None
    no_time: str


@dataclass(frozen=True, slots=True)
class PlanarSummary:
    """The first scan of a topic. angles: of the first and last beam [deg]; time_increment: from beam to beam
    [s]; echoes: beams that have one within the scan's limits.
    """

    topic: str
    frame_id: str
    beams: int
    angles: tuple[float, float]
    time_increment: float
    echoes: int


@dataclass(frozen=True, slots=True)
class EdgeSummary:
    """parent<-child. start, end: first and last stamp [ns]; rate: samples per second; both None if static."""

    parent: str
    child: str
    source: str
    kind: str
    count: int
    start: int | None
    end: int | None
    rate: float | None


@dataclass(frozen=True, slots=True)
class Choice:
    """What is picked for a sweep. lowest_elevation: [deg]; refused: reason -> clouds; examples: stamps."""

    cloud_topic: str
    robot_frame: str
    fixed_frame: str | None
    sensor_frame: str
    pose_source: str
    matched: int
    total: int
    lowest_elevation: float
    first_stamp: int
    last_stamp: int
    refused: dict[str, int]
    examples: dict[str, tuple[int, ...]]


@dataclass(frozen=True, slots=True)
class Description:
    """start, end: bag times [ns]. choice: None where picking fails, and problem says why, in one line.

    losses: what cannot be read.
    """

    path: str
    container: str
    start: int | None
    end: int | None
    topics: tuple[TopicSummary, ...]
    clouds: tuple[CloudSummary, ...]
    scans: tuple[PlanarSummary, ...]
    transforms: tuple[EdgeSummary, ...]
    choice: Choice | None
    problem: str | None
    notices: tuple[str, ...]
    losses: tuple[Loss, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON; stamps are strings, since 2**53 is too small for them."""
        values: dict[str, Any] = _with_text_stamps(asdict(self))
        return values


STAMPS = ("start", "end", "first_stamp", "last_stamp")


def describe(path: Path, settings: LogSection, progress: Progress | None = None) -> Description:
    """Describes a log, also one that cannot be swept. Raises LogError for what cannot be opened at all."""
    with open_container(path) as container:
        topics, start, end, notices = container.topics, container.start, container.end, container.notices
        kind = container.kind
        clouds, scans = tuple(_clouds(container)), tuple(_planar_scans(container))
        losses = tuple(container.losses)
    problem, choice, tree = None, None, TransformTree()
    try:
        surveyed = survey_log(path, settings, progress)
        tree, notices, losses = surveyed.tree, surveyed.notices, surveyed.losses
        times = surveyed.survey.headers.bag_times
        clouds = tuple(_with_rate(c, times) if c.topic == surveyed.cloud_topics[0] else c for c in clouds)
        recording = recording_of(surveyed, settings)
        choice, notices = _choice(recording), recording.notices
    except LogError as error:
        problem = str(error)
        if not tree.edges:
            tree = _tf_alone(path, settings, progress)
    return Description(
        path=str(path),
        container=kind,
        start=start,
        end=end,
        topics=tuple(TopicSummary(t.name, ros1_type(t.type), t.serialization, t.count) for t in topics),
        clouds=clouds,
        scans=scans,
        transforms=tuple(_edge(edge) for edge in tree.all_edges),
        choice=choice,
        problem=problem,
        notices=notices,
        losses=losses,
    )


def _with_text_stamps(value: Any, name: str = "") -> Any:
    if isinstance(value, dict):
        return {
            key: _with_text_stamps(item, "examples" if name == "examples" else key)
            for key, item in value.items()
        }
    if isinstance(value, list | tuple):
        return [_with_text_stamps(item, name) for item in value]
    return str(value) if name in (*STAMPS, "examples") and isinstance(value, int) else value


def _clouds(container: Container) -> list[CloudSummary]:
    """The first cloud of every topic that has any."""
    topics = {t.name: t for t in container.topics if role_of(t) == "cloud" and t.count}
    summaries = []
    for name, topic in topics.items():
        messages = container.messages([name], None, None)
        try:
            found, _, raw = next(messages)
            summaries.append(_cloud(topic, packed_cloud(found, raw), _rate(topic, container)))
        except (StopIteration, LogError, UndecodableError, UnreadableCloudError):
            # The problem comes up again, in full, when the log is surveyed.
            continue
    return summaries


def _planar_scans(container: Container) -> list[PlanarSummary]:
    """The first scan of every topic of planar scans that has any."""
    summaries = []
    for topic in container.topics:
        if role_of(topic) != "laser" or not topic.count:
            continue
        try:
            found, _, raw = next(container.messages([topic.name], None, None))
            scan = laser_scan(found, raw)
        except (StopIteration, LogError, UndecodableError):
            continue
        last = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
        summaries.append(
            PlanarSummary(
                topic=topic.name,
                frame_id=scan.frame,
                beams=len(scan.ranges),
                angles=(math.degrees(scan.angle_min), math.degrees(last)),
                time_increment=scan.time_increment,
                echoes=len(echoes(scan, RotatingLaser()).points),
            )
        )
    return summaries


def _rate(topic: Topic, container: Container) -> float | None:
    if container.start is None or container.end is None or container.end <= container.start:
        return None
    return topic.count / ((container.end - container.start) / 1e9)


def _with_rate(cloud: CloudSummary, times: NDArray[np.int64]) -> CloudSummary:
    """The rate between the topic's own first and last cloud, which matters for short logs."""
    span = int(times.max() - times.min()) if len(times) else 0
    return replace(cloud, rate=(len(times) - 1) / (span / 1e9)) if span > 0 else cloud


def _cloud(topic: Topic, cloud: PackedCloud, rate: float | None) -> CloudSummary:
    finite, not_finite, zero, problem = 0, 0, 0, ""
    time, no_time = None, ""
    try:
        points = cloud_points(cloud)
        finite, not_finite, zero = len(points.xyz), points.not_finite, points.zero
        _, time = timed_points(cloud)
    except UnreadableCloudError as error:
        problem, no_time = (str(error), "") if not finite else ("", error.detail)
    fields = tuple(
        FieldSummary(f.name, DATATYPES.get(f.datatype, (f"type {f.datatype}", ""))[0], f.offset, f.count)
        for f in cloud.fields
    )
    return CloudSummary(
        topic=topic.name,
        frame_id=cloud.frame,
        width=cloud.width,
        height=cloud.height,
        point_step=cloud.point_step,
        row_step=cloud.row_step,
        is_bigendian=cloud.is_bigendian,
        fields=fields,
        rate=rate,
        finite=finite,
        not_finite=not_finite,
        zero=zero,
        problem=problem,
        time=time,
        no_time=no_time,
    )


def _tf_alone(path: Path, settings: LogSection, progress: Progress | None) -> TransformTree:
    """The tree of a log whose clouds are the problem."""
    try:
        with open_container(path) as container:
            names = tf_topics(container.topics, settings.cloud_topic)
            survey, topics = take_survey(container, (), names, (), Window(), progress), container.topics
        return build_tree(survey.samples, settings.transforms, topics)[0]
    except LogError:
        # The problem is told already.
        return TransformTree()


def _edge(edge: Edge) -> EdgeSummary:
    count = len(edge.stamps)
    if edge.is_static:
        return EdgeSummary(edge.parent, edge.child, edge.source, "static", count, None, None, None)
    start, end = int(edge.stamps[0]), int(edge.stamps[-1])
    rate = (count - 1) / ((end - start) / 1e9) if end > start else None
    return EdgeSummary(edge.parent, edge.child, edge.source, "dynamic", count, start, end, rate)


def _choice(recording: Recording) -> Choice:
    stamps = recording.scans.stamps
    return Choice(
        cloud_topic=recording.cloud_topic,
        robot_frame=recording.robot_frame,
        fixed_frame=recording.fixed_frame,
        sensor_frame=recording.sensor_frame,
        pose_source=recording.pose_source,
        matched=recording.matched,
        total=recording.total,
        lowest_elevation=math.degrees(recording.lowest_elevation),
        first_stamp=int(stamps[0]),
        last_stamp=int(stamps[-1]),
        refused=dict(recording.refused),
        examples=dict(recording.examples),
    )
