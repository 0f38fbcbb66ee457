"""How the robot stands at each cloud: which way is up, and how well its pose is known."""

import numpy as np

from gapeval.config import LogSection
from gapeval.frame import FloatArray, rotation_matrices
from gapeval.logs.read.preparation import Surveyed
from gapeval.logs.read.quality import nearest_covariances, pose_quality
from gapeval.logs.read.recording import Scans
from gapeval.logs.read.samples import GRAVITY, imu_edge
from gapeval.logs.read.selection import choose_imu_topic
from gapeval.logs.read.survey import read_samples
from gapeval.logs.read.transforms import Transforms, TransformTree, bracket, lookup


def up(
    surveyed: Surveyed, settings: LogSection, scans: Scans, tree: TransformTree, robot: str
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Against gravity in the robot frame, (n, 3), NaN where that is not known; and what is worth telling.

    The fixed frame's z where there is one, else by the orientation of an IMU; None without either.
    """
    if scans.pose is not None:
        return _z_of(scans.pose), ()
    topic = choose_imu_topic(surveyed.opened.topics, settings.imu_topic)
    if topic is None:
        return None, ()
    edge = imu_edge(read_samples(surveyed.path, topic.name, surveyed.window), topic.name, robot)
    if edge is None:
        return None, (f"{topic.name}: its messages have no orientation",)
    placed = TransformTree(tree.edges, edge)
    found = lookup(placed, GRAVITY, robot, scans.stamps, settings.max_tf_gap)
    if found is None:
        return None, (f"{topic.name}: where {edge.child} sits on {robot} is not in tf, so it is not used",)
    return np.where(found.valid[:, None], _z_of(found.transforms), np.nan), ()


def quality(scans: Scans, tree: TransformTree, robot: str, fixed: str | None) -> FloatArray | None:
    """Of the pose at each cloud, (n, 4); None without any."""
    pose, stamps = scans.pose, scans.stamps
    if pose is None or fixed is None:
        return None
    between = bracket(tree, fixed, robot, stamps)
    mounted = bracket(tree, robot, scans.sources.frames[int(scans.main[0])], stamps)
    covariances = None
    if tree.pose is not None and tree.pose.covariances is not None:
        covariances = nearest_covariances(stamps, tree.pose.stamps, tree.pose.covariances)
    return pose_quality(pose, between, mounted.width, covariances)


def _z_of(world: Transforms) -> FloatArray:
    """The z axis of the world in the robot's frame, (n, 3), of world<-robot."""
    return rotation_matrices(world.quaternion)[:, 2, :].copy()
