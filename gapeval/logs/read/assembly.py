"""A surveyed log -> its recording: frames, transforms and clouds are settled."""

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gapeval.config import BodyBox, LogSection
from gapeval.errors import LogError
from gapeval.logs.read.attitude import quality, up
from gapeval.logs.read.container import Loss, naming
from gapeval.logs.read.gathering import by_pass, gathered, one_by_one, thinned
from gapeval.logs.read.matching import Frames, Refusals, check_matched, match, used_stamps
from gapeval.logs.read.messages.pose_file import CALIBRATION, read_pose_file
from gapeval.logs.read.passes import rotation
from gapeval.logs.read.playback import measure_lowest_elevation
from gapeval.logs.read.pose_error import error_of, errors_asked
from gapeval.logs.read.preparation import Surveyed, survey_log
from gapeval.logs.read.recording import Recording, Scans, Sources
from gapeval.logs.read.samples import pose_edge, pose_topics
from gapeval.logs.read.selection import (
    choose_fixed_frame,
    choose_pose_topic,
    choose_robot_frame,
    choose_sensor_frame,
)
from gapeval.logs.read.survey import Headers, Progress, Window, read_samples
from gapeval.logs.read.transforms import Edge, TransformTree, find_path, lookup, make_edge, with_pose


def read_recording(
    path: Path, settings: LogSection, progress: Progress | None = None, body: BodyBox | None = None
) -> Recording:
    """Everything about a log but its clouds, in one pass; progress: (messages read, all messages).

    body: what of the clouds is the robot itself, which moves on while scans are gathered.

    Raises LogError, in one line, for what cannot be read, or leaves a choice that the user must make.
    """
    return replace(recording_of(survey_log(path, settings, progress), settings), body=body)


def recording_of(surveyed: Surveyed, settings: LogSection) -> Recording:
    """Chooses the frames, looks up every transform, gathers clouds, measures the lowest ray, and errs as it
    is asked to.
    """
    with naming(surveyed.path):
        headers = _named(surveyed, settings)
        _check_whole(surveyed.losses, settings)
        cloud_frame = Counter(headers.frames).most_common(1)[0][0]
        pose_names = {topic.name for topic in pose_topics(surveyed.opened.topics)}
        posed = sorted({child for _, child, name in surveyed.survey.samples if name in pose_names and child})
        robot = choose_robot_frame(surveyed.tree, cloud_frame, posed, settings.robot_frame)
        tree = _with_poses(surveyed, settings, robot)
        if surveyed.planar:
            _check_turning(surveyed, settings, tree, robot, cloud_frame)
        fixed = choose_fixed_frame(tree, robot, settings.fixed_frame)
        sensor = choose_sensor_frame(tree, cloud_frame, robot, fixed, settings.sensor_frame)
        reference = _reference(surveyed, settings, robot, fixed)
        picked = Frames(robot, fixed, None if settings.sensor_frame is None else sensor, reference)
        sources, refusals = match(headers, surveyed.offsets, tree, picked, settings)
        check_matched(len(sources), headers, refusals, tree, settings)
        told_apart: tuple[str, ...] = ()
        if surveyed.planar or len(surveyed.cloud_topics) > 1:
            told_apart = _told(refusals)
            _check_every_topic(surveyed, sources, told_apart)
            refusals = Refusals()
        scans, total, notices = _clouds(surveyed, settings, sources, tree, robot, refusals)
        scans = thinned(scans, settings.every)
        attitude, told = up(surveyed, settings, scans, tree, robot)
        scans = replace(scans, up=attitude, quality=quality(scans, tree, robot, fixed))
    recording = Recording(
        path=surveyed.path,
        container=surveyed.opened.kind,
        topics=surveyed.opened.topics,
        cloud_topics=surveyed.cloud_topics,
        planar=surveyed.planar,
        pose_source="none" if fixed is None else "tf" if tree.pose is None else tree.pose.source,
        robot_frame=robot,
        fixed_frame=fixed,
        sensor_frame=sensor,
        cloud_frames=tuple(dict.fromkeys(headers.frames)),
        reference=reference,
        start=surveyed.opened.start,
        end=surveyed.opened.end,
        lowest_elevations=(math.nan,) * len(surveyed.cloud_topics),
        scans=scans,
        total=total,
        refused=refusals.counts,
        examples=refusals.examples,
        notices=(*surveyed.notices, *told_apart, *notices, *told),
        losses=surveyed.losses,
        laser=settings.laser,
        deskew=settings.deskew,
        checked=surveyed.checked,
        strict=settings.strict,
    )
    recording = replace(recording, lowest_elevations=_lowest_elevations(recording, settings))
    return erring(recording, settings)


def _check_whole(losses: Sequence[Loss], settings: LogSection) -> None:
    """Raises LogError where something is lost and that is not allowed."""
    if losses and settings.strict:
        more = f", and {len(losses) - 1} more" if len(losses) > 1 else ""
        raise LogError(f"not whole: {losses[0]}{more}; leave out --strict to use the rest")


def _lowest_elevations(recording: Recording, settings: LogSection) -> tuple[float, ...]:
    """Of each cloud topic, measured where it is not given."""
    found = []
    for number in range(len(recording.cloud_topics)):
        given = settings.lowest_elevation.get(_lowest_key(recording, number))
        if given is None:
            scans = recording.scans if recording.planar else one_by_one(recording.scans.sources, number)
            given = measure_lowest_elevation(replace(recording, scans=scans))
        found.append(given)
    return tuple(found)


def lowest_elevations(recording: Recording) -> dict[str, float]:
    """As they stand in `log.lowest_elevation` [rad]."""
    names = [_lowest_key(recording, number) for number in range(len(recording.cloud_topics))]
    return dict(zip(names, recording.lowest_elevations, strict=True))


def _lowest_key(recording: Recording, number: int) -> str:
    return recording.path.name if number == 0 else f"{recording.path.name} {recording.cloud_topics[number]}"


def erring(recording: Recording, settings: LogSection) -> Recording:
    """With the errors of poses that are asked for; after all that is measured of the true ones."""
    error, noise = errors_asked(settings)
    wrong = error_of(recording.scans.stamps, error, noise)
    return replace(recording, scans=replace(recording.scans, wrong=wrong), pose_error=error, pose_noise=noise)


def _reference(surveyed: Surveyed, settings: LogSection, robot: str, fixed: str | None) -> str:
    """Where clouds are gathered: in the fixed frame, if any time passes while they are.

    Raises LogError where that is needed and there is none.
    """
    if settings.accumulate is not None and fixed is None:
        raise LogError("log.accumulate needs the robot's poses, and there are none; record /tf or odometry")
    if settings.deskew and fixed is None:
        raise LogError("log.deskew needs the robot's poses, and there are none; record /tf or odometry")
    gathers = (
        surveyed.planar
        or settings.deskew
        or settings.accumulate is not None
        or len(surveyed.cloud_topics) > 1
    )
    return fixed if gathers and fixed is not None else robot


def _told(refusals: Refusals) -> tuple[str, ...]:
    """Messages that no cloud is made of; a cloud is made of many, so they are not counted as clouds."""
    return tuple(f"left out {count} scans: {reason}" for reason, count in refusals.counts.items())


def _check_every_topic(surveyed: Surveyed, sources: Sources, told: tuple[str, ...]) -> None:
    """Raises LogError where nothing of a topic can be used."""
    for number, name in enumerate(surveyed.cloud_topics):
        if not (sources.topics == number).any():
            reasons = "; ".join(told) or "it has no message there"
            raise LogError(f"nothing on {name} can be used ({reasons}); mend that, or leave {name} out")


def _check_turning(
    surveyed: Surveyed, settings: LogSection, tree: TransformTree, robot: str, frame: str
) -> None:
    """Raises LogError where a planar laser does not turn, before anything else is asked of its user."""
    stamps = used_stamps(surveyed.survey.headers, settings)
    turning = lookup(tree, robot, frame, stamps, settings.max_tf_gap)
    if turning is None or not turning.valid.any():
        return  # what is missing is told when all transforms are looked up
    if rotation(turning.transforms.quaternion[turning.valid]) is None:
        raise LogError(
            f"the planar laser on {surveyed.cloud_topics[0]} does not turn against {robot}, so its scans "
            "make no clouds; gapeval needs clouds, or planar scans of a laser that turns by tf"
        )


def _clouds(
    surveyed: Surveyed,
    settings: LogSection,
    sources: Sources,
    tree: TransformTree,
    robot: str,
    refusals: Refusals,
) -> tuple[Scans, int, list[str]]:
    """The clouds, how many there are with those that were refused, and what is worth telling."""
    notices: list[str] = []
    names = surveyed.cloud_topics
    if not surveyed.planar:
        many = settings.accumulate is not None or len(names) > 1
        scans = gathered(sources, names, settings.accumulate, refusals) if many else one_by_one(sources)
        headers = surveyed.survey.headers
        total = headers.total if len(names) == 1 else int((headers.topics == 0).sum())
        if settings.sensor_frame is not None and len(names) > 1:
            notices.append(f"log.sensor_frame: all of {' + '.join(names)} count as seen from there")
    else:
        if settings.accumulate is not None:
            raise LogError("log.accumulate is for clouds; the scans of a rotating laser are gathered by pass")
        frame = Counter(sources.frames).most_common(1)[0][0]
        turning = lookup(tree, robot, frame, sources.stamps, settings.max_tf_gap)
        assert turning is not None
        found = by_pass(sources, turning.transforms, refusals)
        scans, total = found.scans, found.found
        least, most = np.rad2deg(found.extents)
        notices.append(
            f"{names[0]}: {len(sources)} planar scans, {found.found} passes of the laser, the whole ones of "
            f"{least:.0f} to {most:.0f} deg, {found.resting} scans in none of them"
        )
        if not surveyed.offsets.any():
            notices.append(
                f"{names[0]}: no time from beam to beam in its scans; give -p log.laser.time_increment=..."
            )
    if not len(scans):
        reasons = "; ".join(f"{count} x {reason}" for reason, count in refusals.counts.items())
        raise LogError(f"no whole cloud on {' + '.join(names)} ({reasons}); use a longer part of the log")
    if settings.every > 1:
        kept = len(range(0, len(scans), settings.every))
        notices.append(f"every {settings.every}: {kept} of {len(scans)} clouds are used")
    return scans, total, notices


def _named(surveyed: Surveyed, settings: LogSection) -> Headers:
    """The headers of the clouds, those without a frame put into the sensor frame that the user named.

    Raises LogError where no cloud can be decoded, or none has a frame.
    """
    headers, topic = surveyed.survey.headers, " + ".join(surveyed.cloud_topics)
    if not headers.total and surveyed.window != Window():
        raise LogError(f"no message on {topic} in that part of the log; give another --start and --end")
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


def _with_poses(surveyed: Surveyed, settings: LogSection, robot: str) -> TransformTree:
    """The tree, with the poses of a file or a topic where one was named, or of the only topic where tf alone
    leaves the robot without a pose.
    """
    tree, samples = surveyed.tree, surveyed.survey.samples
    if settings.poses is not None:
        return with_pose(tree, _file_edge(Path(settings.poses), surveyed, settings, robot))
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
            samples = read_samples(surveyed.path, topic, surveyed.window)
    return with_pose(tree, pose_edge(samples, topic, robot, settings.fixed_frame))


def _file_edge(path: Path, surveyed: Surveyed, settings: LogSection, robot: str) -> Edge:
    """The edge fixed<-robot of a file of poses. KITTI's have no times: those of the clouds, one by one."""
    stamps = np.unique(used_stamps(surveyed.survey.headers, settings)).tolist()
    calibration = path.with_name(CALIBRATION)
    poses = read_pose_file(path, stamps, calibration if calibration.is_file() else None)
    content = hashlib.sha256(path.read_bytes()).hexdigest()[:8]
    return make_edge(
        (settings.fixed_frame or poses[0].parent).lstrip("/"),
        robot,
        "at its stamps",
        [pose.values for pose in poses],
        [pose.stamp for pose in poses],
        f"{path.name} (sha256 {content})",
    )


def _is_posed(tree: TransformTree, robot: str, fixed_frame: str | None) -> bool:
    """Whether tf alone leads from the robot to the fixed frame."""
    if fixed_frame is not None:
        return find_path(tree, fixed_frame.lstrip("/"), robot) is not None
    return choose_fixed_frame(tree, robot, None) is not None
