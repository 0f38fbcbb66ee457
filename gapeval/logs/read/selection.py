"""Topics and frames pick themselves where there is one choice; else one line that lists the candidates."""

from collections.abc import Iterable, Sequence

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read.container import Topic, ros1_type
from gapeval.logs.read.messages.content import role_of
from gapeval.logs.read.messages.message import POSE_TYPES, is_decodable
from gapeval.logs.read.samples import pose_topics
from gapeval.logs.read.transforms import TransformTree, ancestors, find_path, frames

READS = "gapeval reads PointCloud2, LaserScan, MultiEchoLaserScan, and what Livox and Foxglove have for them"
# Types that hold laser scans which gapeval cannot read.
OTHER_SCANS = ("PointCloud", "VelodyneScan", "PacketMsg")
ROBOT_NAMES = ("base_link", "base_footprint")
FIXED_NAMES = ("map", "odom", "world")
NEVER_ROBOT = (*FIXED_NAMES, "earth", "utm", "global", "odom_combined")
LISTED = 12  # candidates that fit into one line


def choose_cloud_topics(topics: Sequence[Topic], settings: LogSection) -> tuple[Topic, ...]:
    """The topics of the clouds or planar scans: those that are asked for, else the only one that there is.

    A planar laser is chosen by itself only where there is no topic of clouds. Raises LogError, with the
    candidates, where there is a choice, or where several are asked for that do not go together.
    """
    clouds = [t for t in topics if role_of(t) == "cloud"]
    planar = [t for t in topics if role_of(t) == "laser"]
    candidates = [t for t in clouds if t.count]
    lasers = [t for t in planar if t.count]
    asked = settings.cloud_topics or (() if settings.cloud_topic is None else (settings.cloud_topic,))
    if asked:
        found = tuple(_asked_topic(topics, [*candidates, *lasers], name) for name in asked)
        if len({topic.name for topic in found}) < len(found):
            raise LogError(f"a topic is named twice in --cloud-topic: {_listed(asked)}; name each once")
        if len(found) > 1 and any(topic in lasers for topic in found):
            raise LogError("planar scans are not merged with other topics; name one --cloud-topic")
        return found
    if len(candidates) == 1:
        return (candidates[0],)
    if candidates:
        raise LogError(
            f"several topics have clouds, choose with --cloud-topic, or name several to merge them: "
            f"{_counted(candidates)}"
        )
    if lasers and not any(role_of(t) == "tf" and t.count for t in topics):
        raise LogError(
            f"no clouds and no transforms: the log has planar scans on {_counted(lasers)}, of which "
            "gapeval makes clouds only where /tf tells how the laser turns"
        )
    if len(lasers) == 1:
        return (lasers[0],)
    if lasers:
        raise LogError(f"several topics have planar scans, choose with --cloud-topic: {_counted(lasers)}")
    if clouds or planar:
        raise LogError(f"no message on {_listed(t.name for t in (*clouds, *planar))}; record it again")
    raise LogError(_without_clouds(topics))


def choose_imu_topic(topics: Sequence[Topic], asked: str | None) -> Topic | None:
    """The topic named with log.imu_topic, else the only one there is; None where there is none, or a choice.

    Raises LogError, with the candidates, for a wrong name.
    """
    candidates = [t for t in topics if role_of(t) == "imu" and t.count]
    if asked is None:
        return candidates[0] if len(candidates) == 1 else None
    for topic in candidates:
        if _same(topic.name, asked):
            return topic
    raise LogError(f"no topic {asked} for log.imu_topic; the log has {_counted(candidates) or 'none'}")


def choose_pose_topic(topics: Sequence[Topic], asked: str) -> Topic:
    """The topic named with --pose-topic. Raises LogError, with the candidates, for a wrong name."""
    candidates = pose_topics(topics)
    for topic in topics:
        if _same(topic.name, asked) and topic.type in POSE_TYPES and topic.count and is_decodable(topic):
            return topic
    have = f"has {_counted(candidates)}" if candidates else "has none"
    types = _listed(ros1_type(kind) for kind in POSE_TYPES)
    raise LogError(f"no topic {asked} with poses ({types}) for --pose-topic; the log {have}")


def choose_robot_frame(tree: TransformTree, cloud_frame: str, posed: Sequence[str], asked: str | None) -> str:
    """The robot's frame; posed: the frames whose poses a pose topic gives.

    Raises LogError, with the candidates, where it is not plain which one that is.
    """
    known = sorted({*frames(tree), *posed})
    if asked is not None:
        asked = asked.lstrip("/")
        return _asked_frame({*known, cloud_frame}, asked, "--robot-frame")
    if not known:
        raise LogError(
            f"no transforms, so where the laser sits is unknown; add it with `log: transforms:`, or "
            f"take the clouds as they are with --robot-frame {cloud_frame} -p log.sensor_frame={cloud_frame}"
        )
    for name in ROBOT_NAMES:
        found = [frame for frame in known if _last(frame) == name]
        if name in found or len(found) == 1:
            return name if name in found else found[0]
        if found:
            raise LogError(f"several robots, choose with --robot-frame: {_listed(found)}")
    above = [frame for frame in ancestors(tree, cloud_frame) if _last(frame) not in NEVER_ROBOT] or posed
    if len(above) == 1:
        return above[0]
    candidates = above or [frame for frame in known if _last(frame) not in NEVER_ROBOT] or known
    raise LogError(f"no frame base_link, choose with --robot-frame: {_listed(candidates)}")


def choose_fixed_frame(tree: TransformTree, robot_frame: str, asked: str | None) -> str | None:
    """The frame in which the world stands still; None where nothing moves against the robot frame.

    Raises LogError, with the candidates, where it is not plain which one that is.
    """
    if asked is not None:
        return _asked_frame({*frames(tree), robot_frame}, asked.lstrip("/"), "--fixed-frame")
    if tree.pose is not None:
        return tree.pose.parent
    above = ancestors(tree, robot_frame)
    for name in FIXED_NAMES:
        found = [frame for frame in above if _last(frame) == name]
        if found:
            return found[0]
    # What is bolted to the robot, such as a base_footprint above base_link, is no fixed frame.
    moving = [frame for frame in above if _moves(tree, frame, robot_frame)]
    if len(moving) > 1:
        raise LogError(f"no frame map, odom or world, choose with --fixed-frame: {_listed(moving)}")
    return moving[0] if moving else None


def choose_sensor_frame(
    tree: TransformTree, cloud_frame: str, robot_frame: str, fixed_frame: str | None, asked: str | None
) -> str:
    """The laser's frame: the clouds' own, unless they are not in a laser's frame.

    Raises LogError, with the candidates, for clouds in the robot frame or in one that is fixed.
    """
    if asked is not None:
        return _asked_frame({*frames(tree), cloud_frame}, asked.lstrip("/"), "-p log.sensor_frame=")
    no_laser = {robot_frame, fixed_frame, *ancestors(tree, robot_frame)}
    if cloud_frame not in no_laser:
        return cloud_frame
    candidates = [frame for frame in frames(tree) if frame not in no_laser]
    choice = (
        f"one of {_listed(candidates)}"
        if candidates
        else (f"{cloud_frame} if it sits there; or add where it sits on the robot with `log: transforms:`")
    )
    raise LogError(
        f"the clouds are in {cloud_frame}, which is not the laser's own frame; say where the laser is with "
        f"-p log.sensor_frame=..., {choice}"
    )


def _asked_topic(topics: Sequence[Topic], candidates: Sequence[Topic], asked: str) -> Topic:
    for topic in candidates:
        if _same(topic.name, asked):
            return topic
    have = f"clouds are on {_counted(candidates)}" if candidates else _without_clouds(topics)
    for topic in topics:
        is_scan = role_of(topic) in ("cloud", "laser")
        if _same(topic.name, asked) and is_scan:
            raise LogError(f"no message on --cloud-topic {asked}; {have}")
        if _same(topic.name, asked):
            kind = _described_type(topic)
            raise LogError(f"--cloud-topic {asked} is {kind}, and {READS}; {have}")
    raise LogError(f"no topic {asked} for --cloud-topic; {have}")


def _without_clouds(topics: Sequence[Topic]) -> str:
    if not any(topic.count for topic in topics):
        return "no messages at all; record it again"
    scans = [t for t in topics if t.count and (_last(t.type) in OTHER_SCANS or not is_decodable_type(t))]
    found = [t for t in topics if t.count and t in scans] or [t for t in topics if t.count]
    shown = _listed(f"{_described_type(t)} on {t.name} ({t.count})" for t in found)
    return f"no clouds: {READS}, and the log has {shown}"


def is_decodable_type(topic: Topic) -> bool:
    """Whether a topic is in one of ROS's own serializations."""
    return topic.serialization in ("ros1", "cdr")


def _described_type(topic: Topic) -> str:
    kind = ros1_type(topic.type) or "a type without name"
    return kind if is_decodable_type(topic) else f"{kind} as {topic.serialization or 'unknown'}"


def _asked_frame(known: Iterable[str], asked: str, option: str) -> str:
    if asked in known:
        return asked
    raise LogError(f"no frame {asked} for {option}; the log has {_listed(sorted(known)) or 'none'}")


def _moves(tree: TransformTree, frame: str, robot_frame: str) -> bool:
    return any(not edge.is_static for edge, _ in find_path(tree, frame, robot_frame) or ())


def _same(name: str, asked: str) -> bool:
    return name.lstrip("/") == asked.lstrip("/")


def _last(name: str) -> str:
    return name.replace(".", "/").rpartition("/")[2]


def _counted(topics: Iterable[Topic]) -> str:
    return _listed(f"{topic.name} ({topic.count})" for topic in topics)


def _listed(names: Iterable[str]) -> str:
    every = list(names)
    more = f" and {len(every) - LISTED} more" if len(every) > LISTED else ""
    return ", ".join(every[:LISTED]) + more
