"""Folders of PCD, PLY or KITTI files, with a file of poses: logs of those who have none."""

import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from gapeval.errors import LogError
from gapeval.logs.read.container import HEAD, Container, Message, Source, Topic, in_time_order, library_errors
from gapeval.logs.read.messages.file_message import KITTI, PCD, PLY, POSES, pose_message, with_head
from gapeval.logs.read.messages.measurement import StampedPose
from gapeval.logs.read.messages.message import UndecodableError
from gapeval.logs.read.messages.pcd import LONGEST_HEADER, pcd_header, viewpoint_pose
from gapeval.logs.read.messages.pose_file import CALIBRATION, is_tum, read_pose_file, read_times

SERIALIZATIONS = {".pcd": PCD, ".ply": PLY, ".bin": KITTI}
CLOUD_TOPIC, POSE_TOPIC = "/points", "/poses"
KITTI_FRAME, FRAME = "velodyne", "lidar"
# How files of poses are called, best first.
POSE_FILES = ("*.tum", "poses.txt", "*poses*.txt", "[0-9][0-9].txt")
TIMES = "times.txt"
# 1234567890.123456789, 1234567890_123456789, microseconds, nanoseconds; something else may stand in front.
NAMED = re.compile(r"(?:.*[^0-9])?(?:(\d{9,10})[._](\d{1,9})|(\d{16})|(\d{17,19}))")


def is_cloud_folder(path: Path) -> bool:
    """Whether a folder holds files of clouds."""
    with library_errors(path, "folder", "check its files"):
        return any(file.suffix.lower() in SERIALIZATIONS for file in path.iterdir())


@contextmanager
def open_cloud_folder(path: Path) -> Iterator[Container]:
    """A folder as a log of two topics. Raises LogError where nothing says when its clouds were measured."""
    with library_errors(path, "folder", "check its files"):
        files = _cloud_files(path)
    form = SERIALIZATIONS[files[0].suffix.lower()]
    frame = KITTI_FRAME if form == KITTI else FRAME
    pose_path, times_path = _pose_file(path), _beside(path, TIMES)
    stamps, source = _stamps(path, files, times_path, pose_path)
    poses, notices = _poses(path, pose_path, source, stamps)
    poses = sorted((replace(pose, child=frame) for pose in poses), key=lambda pose: pose.stamp)
    order = sorted(range(len(files)), key=lambda i: stamps[i])
    clouds = [(stamps[i], files[i]) for i in order]
    topics = [Topic(CLOUD_TOPIC, form.upper(), len(files), form)]
    if poses:
        topics.append(Topic(POSE_TOPIC, "poses", len(poses), POSES))
    read = partial(_messages, topics, clouds, poses, frame)

    def messages(names: Collection[str], start: int | None, stop: int | None) -> Iterator[Message]:
        return read((), names, start, stop)

    every = [*stamps, *(pose.stamp for pose in poses)]
    yield Container(
        kind=f"folder of {form}",
        topics=tuple(topics),
        start=min(every),
        end=max(every),
        messages=messages,
        heads=read,
        notices=(*notices, *_viewpoint_notice(form, clouds)),
    )


def _cloud_files(path: Path) -> list[Path]:
    """In the order of the numbers in their names."""
    files = [file for file in path.iterdir() if file.suffix.lower() in SERIALIZATIONS and file.is_file()]
    kinds = sorted({file.suffix.lower() for file in files})
    if not files:
        raise LogError(f"{path}: no {', '.join(SERIALIZATIONS)} file in it")
    if len(kinds) > 1:
        raise LogError(f"{path}: holds {' and '.join(kinds)} files; put each kind into a folder of its own")
    return sorted(files, key=_natural)


def _natural(file: Path) -> tuple[list[tuple[int, str]], str]:
    parts = re.split(r"(\d+)", file.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], file.name


def _beside(path: Path, name: str) -> Path | None:
    """A file in the folder, or else in the one that it is in."""
    places = (path / name, path.absolute().parent / name)
    return next((place for place in places if place.is_file()), None)


def _pose_file(path: Path) -> Path | None:
    for folder in (path, path.absolute().parent):
        for pattern in POSE_FILES:
            found = sorted(file for file in folder.glob(pattern) if file.is_file())
            if len(found) > 1:
                names = ", ".join(file.name for file in found[:6])
                raise LogError(f"{path}: several files of poses, {names}; keep one of them there")
            if found:
                return found[0]
    return None


def _stamps(
    path: Path, files: Sequence[Path], times: Path | None, poses: Path | None
) -> tuple[list[int], Path | None]:
    """When the clouds were measured [ns], and the file that says it; None where their names do."""
    named = [_named(file.stem) for file in files]
    if all(stamp is not None for stamp in named):
        return [stamp for stamp in named if stamp is not None], None
    count = len(files)
    if times is not None:
        stamps = read_times(times)
        if len(stamps) != count:
            raise LogError(f"{times}: {len(stamps)} times for {count} clouds in {path}; both must be as many")
        return stamps, times
    if poses is not None and is_tum(poses):
        stamps = [pose.stamp for pose in read_pose_file(poses)]
        if len(stamps) == count:
            return stamps, poses
        have = f"; {poses.name} has {len(stamps)} poses for {count} clouds"
    else:
        have = ""
    raise LogError(
        f"{path}: nothing says when its clouds were measured{have}; name them by their times, as "
        f"1234567890.123456789{files[0].suffix}, or add {TIMES} with a line of seconds for each"
    )


def _named(stem: str) -> int | None:
    """The time in a file's name [ns]."""
    found = NAMED.fullmatch(stem)
    if found is None:
        return None
    seconds, fraction, microseconds, whole = found.groups()
    if seconds is not None:
        return int(seconds) * 1_000_000_000 + int(fraction.ljust(9, "0"))
    return int(microseconds) * 1_000 if microseconds is not None else int(whole)


def _poses(
    path: Path, found: Path | None, source: Path | None, stamps: list[int]
) -> tuple[list[StampedPose], tuple[str, ...]]:
    """The poses of the laser, and what is worth telling of them."""
    if found is None:
        wanted = ", ".join(POSE_FILES)
        return [], (f"no file of poses ({wanted}) in {path.name or path} or the folder that it is in",)
    if is_tum(found):
        return read_pose_file(found), ()
    calibration = _beside(path, CALIBRATION)
    poses = read_pose_file(found, stamps, calibration)
    if calibration is not None:
        return poses, ()
    return poses, (
        f"no {CALIBRATION} beside {found.name}: its poses are taken for the laser's, not a camera's",
    )


def _viewpoint_notice(form: str, clouds: list[tuple[int, Path]]) -> tuple[str, ...]:
    """That the points of the first file are moved."""
    if form != PCD:
        return ()
    try:
        with clouds[0][1].open("rb") as file:
            pose = viewpoint_pose(pcd_header(memoryview(file.read(LONGEST_HEADER))))
    except (OSError, UndecodableError):
        # It is refused, with this reason, when it is read.
        return ()
    if pose is None:
        return ()
    return (f"{clouds[0][1].name} has a VIEWPOINT, by which its points are moved",)


def _messages(
    topics: Sequence[Topic],
    clouds: Sequence[tuple[int, Path]],
    poses: Sequence[StampedPose],
    frame: str,
    names: Collection[str],
    whole: Collection[str],
    start: int | None,
    stop: int | None,
) -> Iterator[Message]:
    """Messages in the order of their stamps, which are their bag times; of `names` the heads alone."""

    def is_wanted(stamp: int) -> bool:
        return (start is None or start <= stamp) and (stop is None or stamp < stop)

    def cloud_messages(limit: int) -> Iterator[Message]:
        for stamp, file in clouds:
            if is_wanted(stamp):
                yield topics[0], stamp, with_head(stamp, frame, _content(file, limit))

    def pose_messages() -> Iterator[Message]:
        for pose in poses:
            if is_wanted(pose.stamp):
                yield topics[1], pose.stamp, pose_message(pose)

    sources = []
    if CLOUD_TOPIC in (*names, *whole):
        sources.append(Source(clouds[0][0], partial(cloud_messages, -1 if CLOUD_TOPIC in whole else HEAD)))
    if poses and POSE_TOPIC in (*names, *whole):
        sources.append(Source(poses[0].stamp, pose_messages))
    return in_time_order(sources)


def _content(file: Path, limit: int) -> bytes:
    """A file, or its beginning; nothing of one that cannot be read, which is one cloud less."""
    try:
        with file.open("rb") as stream:
            return stream.read(limit)
    except OSError:
        return b""
