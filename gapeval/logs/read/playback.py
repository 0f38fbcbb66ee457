"""A recording's scans, decoded one by one."""

import hashlib
import struct
from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from gapeval.errors import LogError
from gapeval.frame import Frame, Transform, sensor_angles
from gapeval.logs.read.cloud import UnreadableCloudError, transformed
from gapeval.logs.read.container import Container, Raw, Topic
from gapeval.logs.read.content import UndecodableError, cloud
from gapeval.logs.read.opening import open_container
from gapeval.logs.read.recording import Recording, RefusedScan, Scans
from gapeval.logs.read.survey import UNDECODABLE, ranked

FIRST_CLOUDS = 10  # readable clouds whose lowest rays are looked at
LOWEST_SHARE = 0.005  # quantile of their elevations

COUNTING_LENGTH, COUNTING_ANGLE = 1e-4, 1e-5  # m and about rad; what differs by less is the same log

LOST = "not found again in the log"


def read_frames(recording: Recording, first: int, last: int) -> Iterator[Frame | RefusedScan]:
    """The scans [first, last) of a recording, decoded, one item for each, in the order of their stamps.

    Begins in the middle of the log without decoding what is before. Raises LogError for a damaged file.
    """
    span = range(len(recording.scans))[first:last]
    if not span:
        return
    with open_container(recording.path) as container:
        for run in _runs(recording.scans, span):
            yield from _read_run(recording, container, run)


def scan_digest(stamp: int, points: NDArray[np.float32], transforms: Iterable[Transform | None]) -> bytes:
    """SHA-256 over what was decoded, not over the file's bytes; the same on any machine.

    points: (N, 3), as they stand in the log. transforms: as interpolated, whose last bits depend on the
    machine; so they count in steps of 0.1 mm and 10 microradians.
    """
    digest = hashlib.sha256(struct.pack("<qQ", stamp, len(points)))
    digest.update(np.ascontiguousarray(points, dtype="<f4").data)
    for transform in transforms:
        digest.update(b"\0" if transform is None else b"\1" + _transform_bytes(transform))
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


def _runs(scans: Scans, span: range) -> Iterator[range]:
    """Parts of a span in which bag times grow with stamps: one pass in file order yields each in turn."""
    start = span.start
    for i in range(span.start + 1, span.stop + 1):
        if i == span.stop or _place(scans, i) <= _place(scans, i - 1):
            yield range(start, i)
            start = i


def _place(scans: Scans, index: int) -> tuple[int, int]:
    return int(scans.bag_times[index]), int(scans.ranks[index])


def _read_run(recording: Recording, container: Container, run: range) -> Iterator[Frame | RefusedScan]:
    scans = recording.scans
    start, stop = int(scans.bag_times[run.start]), int(scans.bag_times[run.stop - 1]) + 1
    waiting = iter(run)
    index = next(waiting)
    for time, rank, topic, raw in ranked(container.messages([recording.cloud_topic], start, stop)):
        while (time, rank) > _place(scans, index):
            # Only a file that changed, or an index that lies, leads here.
            yield RefusedScan(int(scans.stamps[index]), LOST)
            if (following := next(waiting, None)) is None:
                return
            index = following
        if (time, rank) == _place(scans, index):
            yield _read_scan(recording, index, topic, raw)
            if (following := next(waiting, None)) is None:
                return
            index = following
    yield from (RefusedScan(int(scans.stamps[i]), LOST) for i in (index, *waiting))


def _read_scan(recording: Recording, index: int, topic: Topic, raw: Raw) -> Frame | RefusedScan:
    scans = recording.scans
    stamp = int(scans.stamps[index])
    try:
        points = cloud(topic, raw)
    except UndecodableError as error:
        return RefusedScan(stamp, UNDECODABLE, str(error))
    except UnreadableCloudError as error:
        return RefusedScan(stamp, error.reason, error.detail)
    placed, sensor = scans.cloud.at(index), scans.sensor.at(index)
    pose = None if scans.pose is None else scans.pose.at(index)
    return Frame(
        stamp=stamp,
        points=transformed(placed, points.xyz),
        sensor=sensor,
        lowest_elevation=recording.lowest_elevation,
        pose=pose,
        dropped=points.not_finite + points.zero,
        digest=scan_digest(stamp, points.xyz, (placed, sensor, pose)),
    )


def _transform_bytes(transform: Transform) -> bytes:
    steps = np.concatenate([transform.translation / COUNTING_LENGTH, transform.quaternion / COUNTING_ANGLE])
    return np.round(steps).astype("<i8").tobytes()
