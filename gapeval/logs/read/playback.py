"""A recording's clouds, decoded one by one."""

import hashlib
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gapeval.errors import LogError
from gapeval.frame import Frame, Transform, Viewpoint, of_body, sensor_angles
from gapeval.logs.read.container import Container, Raw, Topic
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.gathering import one_by_one
from gapeval.logs.read.laser import echoes
from gapeval.logs.read.messages.cloud import EMPTY, NO_POINT, Points, UnreadableCloudError, transformed
from gapeval.logs.read.messages.content import cloud, laser_scan, timed_cloud
from gapeval.logs.read.messages.message import UndecodableError
from gapeval.logs.read.motion import covers, moved
from gapeval.logs.read.quality import quality_at
from gapeval.logs.read.recording import Recording, RefusedScan, Scans, Sources
from gapeval.logs.read.survey import UNDECODABLE, ranked
from gapeval.logs.read.transforms import Stamps, Transforms, compose, inverse

FIRST_CLOUDS = 10  # readable clouds whose lowest rays are looked at
LOWEST_SHARE = 0.005  # quantile of their elevations
APART = 0.1  # m; viewpoints of one sensor that are nearer to each other count as one

COUNTING_LENGTH, COUNTING_ANGLE = 1e-4, 1e-5  # m and about rad; what differs by less is the same log

LOST = "not found again in the log"
DAMAGED = "in a damaged part of the log"
BEYOND = "points measured at times without transforms"

Place = tuple[int, int, int]  # topic, bag time [ns], rank: where a message is in the log


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """What one message holds, in its own frame. times: (N,) [ns] of its points; None if all are its stamp."""

    points: Points
    times: Stamps | None


Decoded = Part | RefusedScan


def read_frames(recording: Recording, first: int, last: int) -> Iterator[Frame | RefusedScan]:
    """The clouds [first, last) of a recording, decoded, one item for each, in the order of their stamps.

    Begins in the middle of the log without decoding what is before. Raises LogError for a damaged file.
    """
    span = range(len(recording.scans))[first:last]
    if not span:
        return
    with open_container(recording.path) as container:
        for run in _runs(recording.scans, span):
            yield from _read_run(recording, container, run)


def scan_digest(
    stamp: int,
    points: NDArray[np.floating],
    transforms: Iterable[Transform | None],
    times: Stamps | None = None,
) -> bytes:
    """SHA-256 over what was decoded, not over the file's bytes; the same on any machine.

    points: (N, 3), as they stand in the log. times: (N,) [ns], where each has its own. transforms: as
    interpolated, whose last bits depend on the machine; so they count in steps of 0.1 mm and 10 microradians.
    """
    digest = hashlib.sha256(struct.pack("<qQ", stamp, len(points)))
    digest.update(np.ascontiguousarray(points, dtype="<f4").data)
    for transform in transforms:
        digest.update(b"\0" if transform is None else b"\1" + _transform_bytes(transform))
    if times is not None:
        digest.update(np.ascontiguousarray(times, dtype="<i8").data)
    return digest.digest()


def measure_lowest_elevation(recording: Recording) -> float:
    """The lowest ray [rad]: a low quantile of the elevations of the first readable clouds, pooled.

    Raises LogError where no cloud is readable.
    """
    unreadable: Counter[str] = Counter()
    elevations: list[NDArray[np.float64]] = []
    for item in read_frames(recording, 0, len(recording.scans)):
        if isinstance(item, RefusedScan):
            unreadable[item.reason] += 1
            continue
        elevations.append(sensor_angles(item.sensor, item.points.astype(np.float64))[1])
        if len(elevations) == FIRST_CLOUDS:
            break
    if not elevations:
        reasons = "; ".join(f"{count} x {reason}" for reason, count in unreadable.items())
        raise LogError(f"{recording.path}: no cloud holds a point to detect in ({reasons}); record it again")
    return float(np.quantile(np.concatenate(elevations), LOWEST_SHARE))


def first_parts(recording: Recording, topic: int) -> Iterator[Part]:
    """What the first readable messages of a cloud topic hold."""
    alone = replace(recording, scans=one_by_one(recording.scans.sources, topic))
    found = 0
    with open_container(recording.path) as container:
        for run in _runs(alone.scans, range(len(alone.scans))):
            for _, parts in _parts(alone, container, run):
                found += all(isinstance(part, Part) for part in parts)
                yield from (part for part in parts if isinstance(part, Part))
                if found == FIRST_CLOUDS:
                    return


def _runs(scans: Scans, span: range) -> Iterator[range]:
    """Parts of a span in which bag times grow with stamps: one pass in file order yields each in turn."""
    start = span.start
    for i in range(span.start + 1, span.stop + 1):
        if i == span.stop or _place(scans, i) <= _place(scans, i - 1):
            yield range(start, i)
            start = i


def _place(scans: Scans, index: int) -> tuple[int, int]:
    main = scans.main[index]
    return int(scans.sources.bag_times[main]), int(scans.sources.ranks[main])


def _read_run(recording: Recording, container: Container, run: range) -> Iterator[Frame | RefusedScan]:
    for index, parts in _parts(recording, container, run):
        yield _frame(recording, index, parts)


def _parts(recording: Recording, container: Container, run: range) -> Iterator[tuple[int, list[Decoded]]]:
    """Each cloud of a run and what its messages hold; a message is kept for as long as a cloud needs it."""
    scans, sources = recording.scans, recording.scans.sources
    needed = {index: scans.members_of(index).tolist() for index in run}
    last_use = {source: index for index, members in needed.items() for source in members}
    places = {_source_place(sources, source): source for source in last_use}
    times = [place[1] for place in places]
    topics = {recording.cloud_topics[place[0]]: place[0] for place in places}
    until = {index: max(int(sources.bag_times[m]) for m in members) for index, members in needed.items()}
    held: dict[int, Decoded] = {}
    waiting = iter(run)
    following = next(waiting, None)
    for topic, time, rank, raw in ranked(container.messages([*topics], min(times), max(times) + 1)):
        # Only a file that changed, or is damaged, or an index that lies, ends the wait for a message.
        while following is not None and time > until[following]:
            yield following, _taken(recording, container, following, needed, held, last_use)
            following = next(waiting, None)
        source = places.get((topics[topic.name], time, rank))
        if source is not None:
            held[source] = _decoded(recording, source, topic, raw)
        while following is not None and all(member in held for member in needed[following]):
            yield following, _taken(recording, container, following, needed, held, last_use)
            following = next(waiting, None)
        if following is None:
            return
    while following is not None:
        yield following, _taken(recording, container, following, needed, held, last_use)
        following = next(waiting, None)


def _source_place(sources: Sources, source: int) -> Place:
    return int(sources.topics[source]), int(sources.bag_times[source]), int(sources.ranks[source])


def _taken(
    recording: Recording,
    container: Container,
    index: int,
    needed: dict[int, list[int]],
    held: dict[int, Decoded],
    last_use: dict[int, int],
) -> list[Decoded]:
    """What the messages of a cloud hold; those that no later cloud needs are let go."""
    is_damaged = bool(container.losses) and not recording.checked
    if recording.strict and is_damaged and any(source not in held for source in needed[index]):
        raise LogError(
            f"{recording.path}: not whole: {container.losses[-1]}; leave out --strict for the rest"
        )
    lost = DAMAGED if is_damaged else LOST
    stamps = recording.scans.sources.stamps
    parts = [held.get(source) or RefusedScan(int(stamps[source]), lost) for source in needed[index]]
    for source in needed[index]:
        if last_use[source] == index:
            held.pop(source, None)
    return parts


def _decoded(recording: Recording, source: int, topic: Topic, raw: Raw) -> Decoded:
    """The points of one message, and when they were measured where that is asked for."""
    sources = recording.scans.sources
    stamp = int(sources.stamps[source])
    try:
        if recording.planar:
            found = echoes(laser_scan(topic, raw), recording.laser)
            return Part(Points(found.points, found.no_echo, found.shadows), stamp + found.nanoseconds)
        if not recording.deskew:
            return Part(cloud(topic, raw), None)
        timed = timed_cloud(topic, raw)
    except UndecodableError as error:
        refused = RefusedScan(stamp, UNDECODABLE, str(error))
    except UnreadableCloudError as error:
        refused = RefusedScan(stamp, error.reason, error.detail)
        if error.reason in (EMPTY, NO_POINT):
            return refused
    else:
        return Part(timed.points, stamp + timed.nanoseconds)
    if recording.strict:
        raise LogError(
            f"{recording.path}: not whole: stamp {stamp}: {refused}; leave out --strict for the rest"
        )
    return refused


def _frame(recording: Recording, index: int, parts: list[Decoded]) -> Frame | RefusedScan:
    """The cloud of some messages, all put to where they are at its stamp."""
    scans, sources = recording.scans, recording.scans.sources
    main, members = int(scans.main[index]), scans.members_of(index).tolist()
    stamp = int(scans.stamps[index])
    whole: list[tuple[int, Part]] = []
    for member, part in zip(members, parts, strict=True):
        if isinstance(part, Part):
            whole.append((member, part))
        # Of several scans one may have seen nothing; one that is lost must be told.
        elif len(members) == 1 or part.reason not in (EMPTY, NO_POINT):
            return replace(part, stamp=stamp)
    pose = None if sources.pose is None else sources.pose.at(main)
    sensor = sources.sensor.at(main)
    clouds, digests = [], []
    for member, part in whole:
        knots = _knots(recording, index, member)
        times, points = part.times, part.points.xyz
        if times is not None and not covers(sources.times[member], times):
            return RefusedScan(stamp, BEYOND)
        if times is None:
            clouds.append(transformed(knots.at(0), points))
        else:
            clouds.append(moved(points, times, sources.times[member], knots).astype(np.float32))
        if recording.body is not None and member != main:
            clouds[-1] = clouds[-1][_not_body(recording, index, member, clouds[-1])]
        ends = [knots.at(knot) for knot in range(len(knots))]
        digests.append(scan_digest(int(sources.stamps[member]), points, (*ends, sensor, pose), times))
    if not any(len(points) for points in clouds):
        return RefusedScan(stamp, NO_POINT)
    return Frame(
        stamp=stamp,
        points=clouds[0] if len(clouds) == 1 else np.concatenate(clouds),
        sensor=sensor,
        lowest_elevation=recording.lowest_elevations[int(sources.topics[main])],
        pose=pose,
        dropped=sum(part.points.not_finite + part.points.zero for _, part in whole),
        digest=digests[0] if len(digests) == 1 else hashlib.sha256(b"".join(digests)).digest(),
        others=_others(recording, index, [member for member, _ in whole]),
        up=_up(scans, index),
        quality=None if scans.quality is None else quality_at(scans.quality, index),
    )


def _not_body(
    recording: Recording, index: int, member: int, points: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Which points (N, 3), in the robot frame as it is at the cloud's stamp, are not of the robot as it was
    when they were measured. Errors made on purpose do not move the robot's body.
    """
    scans, sources = recording.scans, recording.scans.sources
    own = points.astype(np.float64)
    if scans.wrong is not None:
        own = scans.wrong.at(index).apply_inverse(own)
    if sources.pose is not None and recording.reference != recording.robot_frame:
        here, there = sources.pose.at(int(scans.main[index])), sources.pose.at(member)
        own = there.apply_inverse(here.apply(own))
    return ~of_body(own.astype(np.float32), recording.body)


def _knots(recording: Recording, index: int, member: int) -> Transforms:
    """robot<-cloud of one of a cloud's messages: with the robot where it is at the cloud's stamp, (K,)."""
    scans, sources = recording.scans, recording.scans.sources
    knots = sources.knots_of(member)
    if recording.reference != recording.robot_frame:
        knots = compose(_here(sources, int(scans.main[index]), len(knots)), knots)
    if scans.wrong is not None:
        knots = compose(_repeated(scans.wrong, index, len(knots)), knots)
    return knots


def _here(sources: Sources, main: int, count: int) -> Transforms:
    """robot<-fixed at the stamp of a source, so many times."""
    assert sources.pose is not None
    return inverse(_repeated(sources.pose, main, count))


def _repeated(transforms: Transforms, index: int, count: int) -> Transforms:
    return transforms.take(np.full(count, index))


def _others(recording: Recording, index: int, members: list[int]) -> tuple[Viewpoint, ...]:
    """Where else the cloud's points were seen from; of a pass, nowhere: that is one look around."""
    scans, sources = recording.scans, recording.scans.sources
    main = int(scans.main[index])
    if recording.planar or len(members) < 2:
        return ()
    mounts = sources.sensor.take(np.array(members))
    if recording.reference != recording.robot_frame and sources.pose is not None:
        there = sources.pose.take(np.array(members))
        mounts = compose(_here(sources, main, len(members)), compose(there, mounts))
    kept = [(int(sources.topics[main]), sources.sensor.at(main))]
    for row in sorted(range(len(members)), key=lambda row: -members[row]):  # the newest are kept
        topic, mount = int(sources.topics[members[row]]), mounts.at(row)
        if members[row] != main and all(
            known != topic or np.linalg.norm(mount.translation - near.translation) > APART
            for known, near in kept
        ):
            kept.append((topic, mount))
    return tuple(Viewpoint(mount, recording.lowest_elevations[topic]) for topic, mount in kept[1:])


def _up(scans: Scans, index: int) -> tuple[float, float, float] | None:
    if scans.up is None or np.isnan(scans.up[index]).any():
        return None
    x, y, z = scans.up[index].tolist()
    return x, y, z


def _transform_bytes(transform: Transform) -> bytes:
    steps = np.concatenate([transform.translation / COUNTING_LENGTH, transform.quaternion / COUNTING_ANGLE])
    return np.round(steps).astype("<i8").tobytes()
