"""A log's file, surveyed in one pass, with the topics that are to be read."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read.container import Container, Loss, Topic, naming
from gapeval.logs.read.containers.opening import open_container
from gapeval.logs.read.laser import increment, last_beam
from gapeval.logs.read.messages.cloud import UnreadableCloudError
from gapeval.logs.read.messages.content import head_suffices, role_of, timed_cloud
from gapeval.logs.read.messages.foxglove_message import check_extra
from gapeval.logs.read.messages.message import UndecodableError
from gapeval.logs.read.samples import Samples, build_tree, pose_topics, tf_topics
from gapeval.logs.read.selection import choose_cloud_topics, choose_pose_topic
from gapeval.logs.read.survey import Headers, Progress, Survey, Window, take_survey
from gapeval.logs.read.transforms import Stamps, TransformTree

KNOT = 5_000_000  # ns between two transforms of one deskewed cloud
LARGE = 4 << 30  # bytes
LASTS = 1.5  # times the time between two measurements; what takes longer has wrong times
LOOKED_AT = 10  # clouds whose points' times are looked at beforehand


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
    """A log after its one pass: nothing is chosen yet but the topics that were read.

    offsets: (n, K) [ns], the times since its stamp between which each message was measured. checked: whether
    all of each cloud was read, and not only its head.
    """

    path: Path
    opened: Opened
    cloud_topics: tuple[str, ...]
    planar: bool
    window: Window
    survey: Survey
    offsets: Stamps
    tree: TransformTree
    notices: tuple[str, ...]
    losses: tuple[Loss, ...]
    checked: bool


def survey_log(path: Path, settings: LogSection, progress: Progress | None = None) -> Surveyed:
    """Reads tf, poses and the headers of the clouds. Raises LogError where there are none to choose."""
    with open_container(path) as container:
        opened = Opened(container.kind, container.topics, container.start, container.end, container.notices)
        with naming(path):
            window = wanted_window(container, settings)
            clouds = choose_cloud_topics(container.topics, settings)
            names = tuple(topic.name for topic in clouds)
            planar = role_of(clouds[0]) == "laser"
            tf = tf_topics(container.topics, names[0])
            poses = _poses_to_read(container.topics, settings, tf)
            for topic in container.topics:
                if topic.name in (*names, *tf, *poses):
                    check_extra(topic)
        heads = tuple(topic.name for topic in clouds if _by_its_head(topic)) if is_large(path) else ()
        survey = take_survey(container, names, (*tf, *poses), heads, window, progress)
        with naming(path):
            offsets = _offsets(container, clouds, survey.headers, window, settings)
        losses = tuple(container.losses) or tuple(
            Loss(path.name, f"fewer messages on {name} than the log's own statistics say", messages=count)
            for name, count in survey.lacking.items()
        )
        losses += tuple(
            Loss(path.name, f"messages on {name} that cannot be decoded", messages=count)
            for name, count in survey.broken.items()
        )
    samples: Samples = {key: rows for key, rows in survey.samples.items() if key[2] in tf}
    tree, notices = build_tree(samples, settings.transforms, opened.topics)
    notices = (*opened.notices, *survey.notices, *notices)
    return Surveyed(path, opened, names, planar, window, survey, offsets, tree, notices, losses, not heads)


def is_large(path: Path) -> bool:
    """Whether opening a log should not take as long as reading it: its clouds are not checked beforehand."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file()) > LARGE


def _by_its_head(topic: Topic) -> bool:
    return head_suffices(topic) and role_of(topic) == "cloud"


def wanted_window(container: Container, settings: LogSection) -> Window:
    """Bag times of what is asked for. Raises LogError where nothing of the log lies there."""
    if settings.start is None and settings.end is None:
        return Window()
    if container.start is None or container.end is None:
        raise LogError("when it begins is not known before it is read whole; leave out --start and --end")
    length = (container.end - container.start) / 1e9
    first, last = settings.start or 0.0, length if settings.end is None else settings.end
    if first > length or last < 0 or first > last:
        span = f"from {first:g} to {last:g} s"
        raise LogError(f"nothing {span}, it is {length:.1f} s long; give another --start and --end")
    begin = container.start + round(first * 1e9)
    stop = None if settings.end is None else container.start + round(settings.end * 1e9) + 1
    return Window(None if settings.start is None else begin, stop)


def _offsets(
    container: Container, clouds: tuple[Topic, ...], headers: Headers, window: Window, settings: LogSection
) -> Stamps:
    """When the first and last points of each message were measured, since its stamp, (n, K) [ns]."""
    count = len(headers.stamps)
    if role_of(clouds[0]) == "laser":
        scans = zip(headers.beams.tolist(), headers.increments.tolist(), strict=True)
        ends = [last_beam(beams, increment(own, settings.laser)) for beams, own in scans]
        _check_lasting(
            clouds[0].name,
            "a scan",
            max(map(abs, ends), default=0),
            headers.stamps,
            "log.laser.time_increment",
        )
        # Time may run backwards through a scan.
        return np.array([(min(end, 0), max(end, 0)) for end in ends], dtype=np.int64).reshape(count, 2)
    if not settings.deskew:
        return np.zeros((count, 1), dtype=np.int64)
    spans = [
        _measured_span(container, topic.name, window, headers.stamps[headers.topics == number])
        for number, topic in enumerate(clouds)
    ]
    knots = max(2, *(math.ceil((last - first) / KNOT) + 1 for first, last in spans))
    table = np.array([np.linspace(*span, knots) for span in spans])
    return np.round(table).astype(np.int64)[headers.topics]


def _check_lasting(name: str, what: str, span: int, stamps: Stamps, advice: str) -> None:
    """Raises LogError where one measurement would go on long after the next has begun; span: [ns]."""
    if len(stamps) < 2:
        return
    period = int(np.median(np.diff(np.sort(stamps))))
    if span > LASTS * period:
        raise LogError(
            f"{what} on {name} would last {span / 1e9:.3g} s by the times in it, and they come every "
            f"{period / 1e9:.3g} s; {advice}"
        )


def _measured_span(container: Container, name: str, window: Window, stamps: Stamps) -> tuple[int, int]:
    """Between which times since its stamp a message's points are measured, with room: of the first ones.

    stamps: (n,) of all of them [ns].
    """
    firsts, lasts, why = [], [], ""
    for topic, _, raw in container.messages([name], window.start, window.stop):
        try:
            times = timed_cloud(topic, raw).nanoseconds
        except (UndecodableError, UnreadableCloudError) as error:
            why = why or str(error)
            continue
        firsts.append(int(times.min()))
        lasts.append(int(times.max()))
        if len(firsts) == LOOKED_AT:
            break
    if not firsts:
        raise LogError(f"log.deskew needs the time of each point of {name} ({why}); leave it out")
    span = max(lasts) - min(firsts)
    _check_lasting(name, "a cloud", span, stamps, "record it again, or leave out log.deskew")
    room = max(span // 50, 10**5)  # a turn is not always equally long
    period = int(np.median(np.diff(stamps))) if len(stamps) > 1 else 0
    # Where turn follows turn, part of one may have had no echo in the first clouds.
    room = max(room, period - span) if period <= 2 * span else room
    return min(firsts) - room, max(lasts) + room


def _poses_to_read(topics: tuple[Topic, ...], settings: LogSection, tf: tuple[str, ...]) -> tuple[str, ...]:
    """A pose topic that was named, or, without any tf, the only one: others are not read along."""
    if settings.pose_topic is not None:
        return (choose_pose_topic(topics, settings.pose_topic).name,)
    candidates = pose_topics(topics)
    return (candidates[0].name,) if not tf and len(candidates) == 1 else ()
