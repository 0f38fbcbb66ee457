"""A log's file -> its recording: one pass, then topics, frames and transforms are settled."""

import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read.container import Topic, naming
from gapeval.logs.read.matching import Frames, check_matched, match
from gapeval.logs.read.opening import open_container
from gapeval.logs.read.playback import measure_lowest_elevation
from gapeval.logs.read.pose_error import errors_asked, with_errors
from gapeval.logs.read.recording import Recording
from gapeval.logs.read.samples import Samples, build_tree, pose_edge, pose_topics, tf_topics
from gapeval.logs.read.selection import (
    choose_cloud_topic,
    choose_fixed_frame,
    choose_pose_topic,
    choose_robot_frame,
    choose_sensor_frame,
)
from gapeval.logs.read.survey import CloudHeaders, Progress, Survey, read_poses, take_survey
from gapeval.logs.read.transforms import TransformTree, find_path, with_pose


@dataclass(frozen=True, slots=True)
class Opened:
    """What a log says of itself before its messages are read."""

    kind: str
    topics: tuple[Topic, ...]
    start: int | None
    end: int | None
    notices: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Surveyed:
    """A log after its one pass: nothing is chosen yet but the topics that were read."""

    path: Path
    opened: Opened
    cloud_topic: str
    survey: Survey
    tree: TransformTree
    notices: tuple[str, ...]


def read_recording(path: Path, settings: LogSection, progress: Progress | None = None) -> Recording:
    """Everything about a log but its clouds, in one pass; progress: (messages read, all messages).

    Raises LogError, in one line, for what cannot be read, or leaves a choice that the user must make.
    """
    return recording_of(survey_log(path, settings, progress), settings)


def survey_log(path: Path, settings: LogSection, progress: Progress | None = None) -> Surveyed:
    """Reads tf, poses and the headers of the clouds. Raises LogError where there are none to choose."""
    with open_container(path) as container:
        opened = Opened(container.kind, container.topics, container.start, container.end, container.notices)
        with naming(path):
            cloud_topic = choose_cloud_topic(container.topics, settings.cloud_topic).name
            tf = tf_topics(container.topics, cloud_topic)
            poses = _poses_to_read(container.topics, settings, tf)
        survey = take_survey(container, cloud_topic, tf, poses, progress)
    samples: Samples = {key: rows for key, rows in survey.samples.items() if key[2] in tf}
    tree, notices = build_tree(samples, settings.transforms, opened.topics)
    return Surveyed(path, opened, cloud_topic, survey, tree, (*opened.notices, *survey.notices, *notices))


def recording_of(surveyed: Surveyed, settings: LogSection) -> Recording:
    """Chooses the frames, looks up every transform, measures the lowest ray, and errs as it is asked to."""
    with naming(surveyed.path):
        headers = _named(surveyed, settings)
        cloud_frame = Counter(headers.frames).most_common(1)[0][0]
        pose_names = {topic.name for topic in pose_topics(surveyed.opened.topics)}
        posed = sorted({child for _, child, name in surveyed.survey.samples if name in pose_names and child})
        robot = choose_robot_frame(surveyed.tree, cloud_frame, posed, settings.robot_frame)
        tree = _with_poses(surveyed, settings, robot)
        fixed = choose_fixed_frame(tree, robot, settings.fixed_frame)
        sensor = choose_sensor_frame(tree, cloud_frame, robot, fixed, settings.sensor_frame)
        picked = Frames(robot, fixed, None if settings.sensor_frame is None else sensor)
        scans, refusals = match(headers, tree, picked, settings)
        check_matched(scans, headers, refusals, tree, settings)
    recording = Recording(
        path=surveyed.path,
        container=surveyed.opened.kind,
        topics=surveyed.opened.topics,
        cloud_topic=surveyed.cloud_topic,
        pose_source="none" if fixed is None else "tf" if tree.pose is None else tree.pose.source,
        robot_frame=robot,
        fixed_frame=fixed,
        sensor_frame=sensor,
        cloud_frames=tuple(dict.fromkeys(headers.frames)),
        start=surveyed.opened.start,
        end=surveyed.opened.end,
        lowest_elevation=settings.lowest_elevation.get(surveyed.path.name, math.nan),
        scans=scans,
        total=headers.total,
        refused=refusals.counts,
        examples=refusals.examples,
        notices=surveyed.notices,
    )
    if math.isnan(recording.lowest_elevation):
        recording = replace(recording, lowest_elevation=measure_lowest_elevation(recording))
    return erring(recording, settings)


def erring(recording: Recording, settings: LogSection) -> Recording:
    """With the errors of poses that are asked for; after all that is measured of the true ones."""
    error, noise = errors_asked(settings)
    scans = recording.scans
    cloud = with_errors(scans.cloud, scans.stamps, error, noise)
    return replace(recording, scans=replace(scans, cloud=cloud), pose_error=error, pose_noise=noise)


def _named(surveyed: Surveyed, settings: LogSection) -> CloudHeaders:
    """The headers of the clouds, those without a frame put into the sensor frame that the user named.

    Raises LogError where no cloud can be decoded, or none has a frame.
    """
    headers, topic = surveyed.survey.headers, surveyed.cloud_topic
    if not headers.total:
        raise LogError(f"no message can be read on {topic}; record it again")
    if not headers.frames:
        raise LogError(f"no cloud on {topic} can be decoded: {headers.why}; record it again")
    if settings.sensor_frame is not None:
        sensor = settings.sensor_frame.lstrip("/")
        return replace(headers, frames=tuple(name or sensor for name in headers.frames))
    if not any(headers.frames):
        raise LogError(f"the clouds on {topic} name no frame; name it with -p log.sensor_frame=...")
    return headers


def _poses_to_read(topics: tuple[Topic, ...], settings: LogSection, tf: tuple[str, ...]) -> tuple[str, ...]:
    """A pose topic that was named, or, without any tf, the only one: others are not read along."""
    if settings.pose_topic is not None:
        return (choose_pose_topic(topics, settings.pose_topic).name,)
    candidates = pose_topics(topics)
    return (candidates[0].name,) if not tf and len(candidates) == 1 else ()


def _with_poses(surveyed: Surveyed, settings: LogSection, robot: str) -> TransformTree:
    """The tree, with a pose topic where one was named, or where tf alone leaves the robot without a pose."""
    tree, samples = surveyed.tree, surveyed.survey.samples
    if settings.pose_topic is not None:
        topic = choose_pose_topic(surveyed.opened.topics, settings.pose_topic).name
    else:
        candidates = pose_topics(surveyed.opened.topics)
        if not candidates or _is_posed(tree, robot, settings.fixed_frame):
            return tree
        if len(candidates) > 1:
            listed = ", ".join(f"{t.name} ({t.count})" for t in candidates)
            raise LogError(f"tf does not place {robot} in the world, choose with --pose-topic: {listed}")
        topic = candidates[0].name
        if not any(name == topic for _, _, name in samples):
            samples = read_poses(surveyed.path, topic)
    return with_pose(tree, pose_edge(samples, topic, robot, settings.fixed_frame))


def _is_posed(tree: TransformTree, robot: str, fixed_frame: str | None) -> bool:
    """Whether tf alone leads from the robot to the fixed frame."""
    if fixed_frame is not None:
        return find_path(tree, fixed_frame.lstrip("/"), robot) is not None
    return choose_fixed_frame(tree, robot, None) is not None
