"""tf and pose messages -> the edges of a transform tree."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gapeval.config import StaticTransform
from gapeval.errors import LogError
from gapeval.frame import FloatArray
from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages.content import (
    StampedPose,
    StampedTransform,
    orientation,
    pose,
    role_of,
    transforms,
)
from gapeval.logs.read.messages.foxglove_message import foxglove_type
from gapeval.logs.read.messages.message import frame_of
from gapeval.logs.read.transforms import Edge, Holds, Stamps, TransformTree, make_edge

SETTING = "log.transforms"
GRAVITY = "(gravity)"  # the frame that an IMU gives its orientation in
# Topics of pose types that say where somebody wants the robot to be.
WISHES = ("goal", "goal_pose", "initialpose", "current_goal")


@dataclass(slots=True)
class Rows:
    """Samples of one edge while they are being read. covariances: of poses, None where they have none."""

    stamps: list[int] = field(default_factory=list)
    values: list[tuple[float, ...]] = field(default_factory=list)
    covariances: list[tuple[float, ...] | None] = field(default_factory=list)


# (parent, child, topic) -> samples
Samples = dict[tuple[str, str, str], Rows]


def is_static_topic(name: str) -> bool:
    return name.endswith("tf_static")


def tf_topics(topics: Iterable[Topic], near: str | None) -> tuple[str, ...]:
    """The names of the tf topics: /tf and /tf_static, else those of the only namespace that has any, else of
    the namespace of the topic `near`. Raises LogError where that leaves a choice.
    """
    tf = [t for t in topics if role_of(t) == "tf" and t.count]
    # Foxglove puts all transforms into one tree, whatever the names of their topics.
    foreign = tuple(t.name for t in tf if foxglove_type(t))
    found = [t.name for t in tf if t.name not in foreign]
    spaces = {name: name.rpartition("/")[0] for name in found}
    distinct = sorted(set(spaces.values()))
    if "" in distinct:
        distinct = [""]
    if len(distinct) > 1 and near is not None:
        distinct = [space for space in distinct if near.startswith(space + "/")] or distinct
    if len(distinct) > 1:
        raise LogError(f"tf of several robots, in {', '.join(distinct)}; record one robot per log")
    return (*(name for name in found if spaces[name] in distinct), *foreign)


def pose_topics(topics: Iterable[Topic]) -> tuple[Topic, ...]:
    """The topics that may say where the robot is."""
    return tuple(
        t for t in topics if role_of(t) == "pose" and t.count and t.name.rpartition("/")[2] not in WISHES
    )


def add_message(samples: Samples, topic: Topic, raw: Raw) -> None:
    """Adds what a message of a tf, pose or IMU topic says. Raises UndecodableError for one that says nothing.

    The child of a pose is empty where the message has none.
    """
    role = role_of(topic)
    if role == "tf":
        add_transforms(samples, topic.name, transforms(topic, raw))
    elif role == "pose":
        add_transforms(samples, topic.name, [pose(topic, raw)])
    elif (found := orientation(topic, raw)) is not None:
        level = (0.0, 0.0, 0.0, *found.quaternion)
        item = StampedTransform(found.stamp, GRAVITY, found.frame, level)
        add_transforms(samples, topic.name, [item])


def add_transforms(samples: Samples, topic: str, items: Iterable[StampedTransform | StampedPose]) -> None:
    """Adds samples of a topic, each to those of its edge."""
    for item in items:
        rows = samples.setdefault((item.parent, item.child, topic), Rows())
        rows.stamps.append(item.stamp)
        rows.values.append(item.values)
        if isinstance(item, StampedPose):
            rows.covariances.append(item.covariance)


def build_tree(
    samples: Samples, extra: Sequence[StaticTransform], topics: Iterable[Topic] = ()
) -> tuple[TransformTree, tuple[str, ...]]:
    """The tree of the log's tf and of the transforms that its user adds, and what is worth telling of it.

    topics: of the log. Foxglove has no /tf_static: what one of its topics says but once holds for all time.
    """
    foreign = {topic.name for topic in topics if foxglove_type(topic)}
    edges: dict[tuple[str, str], Edge] = {}
    notices: list[str] = []
    # Static ones first: where an edge is in both, the moving one replaces it.
    for (parent, child, topic), rows in sorted(samples.items(), key=lambda s: not is_static_topic(s[0][2])):
        is_lone = topic in foreign and len(rows.stamps) == 1 and not is_static_topic(topic)
        holds: Holds = "always" if is_lone or is_static_topic(topic) else "at its stamps"
        edge = make_edge(parent, child, holds, rows.values, rows.stamps, topic)
        if is_lone:
            notices.append(f"{edge.name} is said once on {topic}, so it is taken to hold for all time")
        if (parent, child) in edges:
            notices.append(f"{edge.name} is on {edges[parent, child].source} and on {topic}; {topic} is used")
        edges[parent, child] = edge
    for item in extra:
        parent, child = frame_of(item.parent), frame_of(item.child)
        row = (*item.translation, *item.rotation)
        if (parent, child) in edges:
            notices.append(f"{parent}<-{child} of {SETTING} replaces the log's own")
        edges[parent, child] = make_edge(parent, child, "always", [row], [0], SETTING)
    own = [key for key in edges if key[0] == key[1]]
    notices += [f"{key[0]} is its own parent on {edges.pop(key).source}; left out" for key in own]
    return TransformTree(tuple(edges[key] for key in sorted(edges))), tuple(notices)


def pose_edge(samples: Samples, topic: str, robot_frame: str, fixed_frame: str | None) -> Edge:
    """The edge of a pose topic. Raises LogError where its messages do not agree on their frames."""
    found = {(parent, child): rows for (parent, child, name), rows in samples.items() if name == topic}
    if not found:
        raise LogError(f"no message of {topic} can be read; name another with --pose-topic")
    if len(found) > 1:
        pairs = ", ".join(f"{parent or '(no name)'}<-{child or '(robot)'}" for parent, child in sorted(found))
        raise LogError(f"{topic} changes its frames ({pairs}); name another with --pose-topic")
    ((parent, child), rows) = next(iter(found.items()))
    if not parent and fixed_frame is None:
        raise LogError(f"{topic} does not name its frame; say what to call it with --fixed-frame map")
    parent, child = parent or frame_of(str(fixed_frame)), child or robot_frame
    if parent == child:
        raise LogError(f"{topic} gives {child} in {parent}, which is itself; name another with --pose-topic")
    edge = make_edge(parent, child, "at its stamps", rows.values, rows.stamps, topic)
    return replace(edge, covariances=_covariances(rows, edge.stamps))


def _covariances(rows: Rows, stamps: Stamps) -> FloatArray | None:
    """Of the samples at these stamps, the last ones that have them; None where no sample says anything."""
    said = dict(zip(rows.stamps, rows.covariances, strict=True))
    if not any(said.values()):
        return None
    nothing = (np.nan,) * 36
    return np.array([said[stamp] or nothing for stamp in stamps.tolist()]).reshape(-1, 6, 6)


def imu_edge(samples: Samples, topic: str, robot_frame: str) -> Edge | None:
    """The attitude of an IMU against gravity; None where its messages do not tell, or change their frame."""
    found = [(child, rows) for (_, child, name), rows in samples.items() if name == topic]
    if len(found) != 1:
        return None
    child, rows = found[0]
    return make_edge(GRAVITY, child or robot_frame, "at its stamps", rows.values, rows.stamps, topic)
