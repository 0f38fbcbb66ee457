"""tf: edges between frames, and transforms between any two of them at many stamps at once."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from gapeval.errors import LogError
from gapeval.frame import FloatArray, Transform, rotation_matrices

Stamps = NDArray[np.int64]
Holds = Literal["at its stamps", "always"]

OK, BEFORE, AFTER, GAP = range(4)  # why a stamp has no transform
FARTHEST = 1e12  # m; what is farther away is no place, and may overflow float32
NEARLY_EQUAL = 1 - 1e-9  # cosine of half an angle below which slerp divides by nearly nothing


@dataclass(frozen=True, slots=True, eq=False)
class Transforms:
    """n rigid transforms target<-source. translation: (n, 3) [m]; quaternion: (n, 4) x, y, z, w."""

    translation: FloatArray
    quaternion: FloatArray

    def __len__(self) -> int:
        return len(self.translation)

    def at(self, index: int) -> Transform:
        return Transform(self.translation[index], self.quaternion[index])

    def take(self, indices: NDArray[np.intp] | NDArray[np.bool_]) -> Self:
        return type(self)(self.translation[indices], self.quaternion[indices])

    def part(self, rows: slice) -> Self:
        return type(self)(self.translation[rows], self.quaternion[rows])

    @classmethod
    def identity(cls, count: int) -> Self:
        return cls(np.zeros((count, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Samples of parent<-child, sorted by stamp, one per stamp. A fixed edge has one and holds for all time.

    source: where it comes from, for error lines: a topic's name or `log.transforms`.
    covariances: (n, 6, 6) of the samples as ROS has them, NaN where one says nothing; None where none does.
    """

    parent: str
    child: str
    holds: Holds
    stamps: Stamps
    samples: Transforms
    source: str
    covariances: FloatArray | None = None

    @property
    def is_static(self) -> bool:
        return self.holds == "always"

    @property
    def name(self) -> str:
        return f"{self.parent}<-{self.child}"


@dataclass(frozen=True, slots=True, eq=False)
class TransformTree:
    """edges: one for every pair of frames. pose: the edge of a pose topic, which may lead to a frame that tf
    gives another parent, such as an IMU on the robot.
    """

    edges: tuple[Edge, ...] = ()
    pose: Edge | None = None

    @property
    def all_edges(self) -> tuple[Edge, ...]:
        return self.edges if self.pose is None else (self.pose, *self.edges)


@dataclass(frozen=True, slots=True, eq=False)
class Lookup:
    """Transforms target<-source at some stamps.

    reasons: (n,) OK, BEFORE, AFTER or GAP; transforms of other stamps than OK mean nothing.
    distances: (n,) ns by which tf begins later, ends earlier, or the width of its gap; else 0.
    """

    target: str
    source: str
    transforms: Transforms
    reasons: NDArray[np.int8]
    distances: Stamps

    @property
    def valid(self) -> NDArray[np.bool_]:
        return np.equal(self.reasons, OK)


Step = tuple[Edge, Literal["up", "down"]]


def make_edge(
    parent: str,
    child: str,
    holds: Holds,
    rows: Sequence[Sequence[float]],
    stamps: Sequence[int],
    source: str,
) -> Edge:
    """An edge of samples in the order of the log: rows of x, y, z and a quaternion x, y, z, w.

    The last sample wins among equal stamps, and altogether where the edge always holds.
    """
    values = np.asarray(rows, dtype=np.float64).reshape(-1, 7)
    times = np.asarray(stamps, dtype=np.int64)
    if holds == "always":
        values, times = values[-1:], times[-1:]
    order = np.argsort(times, kind="stable")
    values, times = values[order], times[order]
    last = np.append(times[1:] != times[:-1], True)
    return Edge(parent, child, holds, times[last], Transforms(values[last, :3], values[last, 3:]), source)


def frames(tree: TransformTree) -> tuple[str, ...]:
    """Every frame of the tree, sorted."""
    return tuple(sorted({name for edge in tree.all_edges for name in (edge.parent, edge.child)}))


def ancestors(tree: TransformTree, frame: str) -> list[str]:
    """The frames above a frame, nearest first; the first edge counts where a frame has two parents."""
    parents: dict[str, str] = {}
    for edge in tree.all_edges:
        parents.setdefault(edge.child, edge.parent)
    found: list[str] = []
    while frame in parents and parents[frame] not in found:
        frame = parents[frame]
        found.append(frame)
    return found


def find_path(tree: TransformTree, target: str, source: str) -> list[Step] | None:
    """The steps from source to target, through their common ancestor; None where the tree does not connect
    them. Raises LogError where a frame on the way has two parents.
    """
    came_by: dict[str, tuple[str, Step] | None] = {source: None}
    waiting = deque([source])
    while waiting and target not in came_by:
        frame = waiting.popleft()
        for edge in tree.all_edges:
            if edge.child == frame and edge.parent not in came_by:
                came_by[edge.parent] = (frame, (edge, "up"))
                waiting.append(edge.parent)
            elif edge.parent == frame and edge.child not in came_by:
                came_by[edge.child] = (frame, (edge, "down"))
                waiting.append(edge.child)
    if target not in came_by:
        return None
    steps: list[Step] = []
    frame = target
    while (arrival := came_by[frame]) is not None:
        frame, step = arrival
        steps.append(step)
    _check_parents(tree, [edge for edge, _ in steps if edge is not tree.pose])
    return steps[::-1]


def with_pose(tree: TransformTree, pose: Edge) -> TransformTree:
    """The tree with the edge of a pose topic, which wins against tf.

    Where tf connects the two frames too, its first moving edge on the way up from the pose's child is left
    out (the first edge of all if none moves), so that there is one way between any two frames.
    """
    bare = TransformTree(tree.edges)
    steps = find_path(bare, pose.parent, pose.child)
    if not steps:
        return TransformTree(tree.edges, pose)
    moving = [edge for edge, _ in steps if not edge.is_static]
    cut = (moving or [edge for edge, _ in steps])[0]
    return TransformTree(tuple(edge for edge in tree.edges if edge is not cut), pose)


def lookup(tree: TransformTree, target: str, source: str, stamps: Stamps, max_gap: float) -> Lookup | None:
    """Transforms target<-source at stamps (n,), interpolated between neighbours at most max_gap [s] apart,
    never extrapolated; None where the tree does not connect the two frames.

    Raises LogError where a frame on the way has two parents, or an edge a quaternion without direction.
    """
    steps = find_path(tree, target, source)
    if steps is None:
        return None
    total = Transforms.identity(len(stamps))
    reasons = np.zeros(len(stamps), dtype=np.int8)
    distances = np.zeros(len(stamps), dtype=np.int64)
    for edge, direction in steps:
        part, why, distance = interpolated(edge, stamps, max_gap)
        total = compose(part if direction == "up" else inverse(part), total)
        is_first = (reasons == OK) & (why != OK)
        reasons[is_first], distances[is_first] = why[is_first], distance[is_first]
    return Lookup(target, source, total, reasons, distances)


def interpolated(edge: Edge, stamps: Stamps, max_gap: float) -> tuple[Transforms, NDArray[np.int8], Stamps]:
    """An edge at stamps (n,): its transforms, and why and by how many ns there is none."""
    quaternions = _normalised(edge)
    count = len(stamps)
    if edge.is_static:
        first = np.zeros(count, dtype=np.intp)
        nothing = np.zeros(count, dtype=np.int64)
        return (
            Transforms(edge.samples.translation[first], quaternions[first]),
            nothing.astype(np.int8),
            nothing,
        )
    times = edge.stamps
    left, right = _neighbours(times, stamps)
    width = times[right] - times[left]
    share = np.where(width > 0, stamps - times[left], 0) / np.maximum(width, 1)
    why = np.where(width > round(max_gap * 1e9), GAP, OK).astype(np.int8)
    why[stamps < times[0]], why[stamps > times[-1]] = BEFORE, AFTER
    distance = np.select(
        [why == BEFORE, why == AFTER, why == GAP], [times[0] - stamps, stamps - times[-1], width]
    )
    share = np.where(why == OK, share, 0.0)[:, None]
    a, b = edge.samples.translation[left], edge.samples.translation[right]
    rotation = slerp(quaternions[left], quaternions[right], share)
    return Transforms(a + (b - a) * share, rotation), why, distance.astype(np.int64)


def _neighbours(times: Stamps, stamps: Stamps) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The samples before and after each stamp (n,), the same one twice where it is at the stamp."""
    right = np.minimum(np.searchsorted(times, stamps, side="left"), len(times) - 1)
    # A stamp that is in the log needs no neighbour.
    return np.where(times[right] == stamps, right, np.maximum(right - 1, 0)), right


@dataclass(frozen=True, slots=True, eq=False)
class Bracket:
    """Transforms target<-source of the samples before and after some stamps, and how far apart these are.

    width: (n,) [ns], the widest of all edges on the way; 0 where nothing was interpolated.
    """

    before: Transforms
    after: Transforms
    width: Stamps


def bracket(tree: TransformTree, target: str, source: str, stamps: Stamps) -> Bracket:
    """What `lookup` interpolated between, at stamps (n,) for which it found transforms."""
    before = after = Transforms.identity(len(stamps))
    width = np.zeros(len(stamps), dtype=np.int64)
    for edge, direction in find_path(tree, target, source) or ():
        left = right = np.zeros(len(stamps), dtype=np.intp)
        if not edge.is_static:
            left, right = _neighbours(edge.stamps, stamps)
            width = np.maximum(width, edge.stamps[right] - edge.stamps[left])
        samples = Transforms(edge.samples.translation, _normalised(edge))
        parts = (samples.take(left), samples.take(right))
        if direction == "down":
            parts = (inverse(parts[0]), inverse(parts[1]))
        before, after = compose(parts[0], before), compose(parts[1], after)
    return Bracket(before, after, width)


def slerp(a: FloatArray, b: FloatArray, share: FloatArray) -> FloatArray:
    """Between unit quaternions (n, 4), along the shorter arc; share: (n, 1)."""
    cosine = np.sum(a * b, axis=1, keepdims=True)
    b = np.where(cosine < 0, -b, b)
    cosine = np.minimum(np.abs(cosine), 1.0)
    angle = np.arccos(cosine)
    is_near = cosine > NEARLY_EQUAL
    sine = np.where(is_near, 1.0, np.sin(angle))
    weight_a = np.where(is_near, 1 - share, np.sin((1 - share) * angle) / sine)
    weight_b = np.where(is_near, share, np.sin(share * angle) / sine)
    mixed = weight_a * a + weight_b * b
    # At share 0 and 1 the sample itself comes out, to the last bit.
    unit = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    return np.where(share == 0, a, np.where(share == 1, b, unit))


def compose(outer: Transforms, inner: Transforms) -> Transforms:
    """outer after inner, row by row."""
    turned = np.einsum("nij,nj->ni", rotation_matrices(outer.quaternion), inner.translation)
    return Transforms(turned + outer.translation, product(outer.quaternion, inner.quaternion))


def product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Quaternions (n, 4): one after the other, row by row."""
    x1, y1, z1, w1 = one.T
    x2, y2, z2, w2 = other.T
    return np.stack(
        [
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        ],
        axis=1,
    )


def conjugate(quaternions: FloatArray) -> FloatArray:
    """The way back of unit quaternions (n, 4)."""
    return quaternions * [-1.0, -1.0, -1.0, 1.0]


def rotation_vectors(quaternions: FloatArray) -> FloatArray:
    """Axis times angle (n, 3) [rad] of unit quaternions (n, 4), by the short way."""
    shortest = np.where(quaternions[:, 3:] < 0, -quaternions, quaternions)
    sine = np.linalg.norm(shortest[:, :3], axis=1)
    angle = 2 * np.arctan2(sine, shortest[:, 3])
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return shortest[:, :3] * scale[:, None]


def inverse(transforms: Transforms) -> Transforms:
    back = conjugate(transforms.quaternion)
    return Transforms(-np.einsum("nij,nj->ni", rotation_matrices(back), transforms.translation), back)


def _normalised(edge: Edge) -> FloatArray:
    quaternions = edge.samples.quaternion
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    near = (np.abs(edge.samples.translation) < FARTHEST).all(axis=1)
    sound = (norms[:, 0] > 1e-6) & np.isfinite(norms[:, 0]) & near
    if not sound.all():
        bad = int(np.flatnonzero(~sound)[0])
        values = [float(v) for v in (*edge.samples.translation[bad], *quaternions[bad])]
        raise LogError(
            f"{edge.name} of {edge.source} at stamp {edge.stamps[bad]} is no transform: {values}; "
            "record it with finite numbers and a quaternion other than zero"
        )
    return np.where(np.abs(norms - 1) < 1e-12, quaternions, quaternions / norms)


def _check_parents(tree: TransformTree, used: Iterable[Edge]) -> None:
    parents: dict[str, dict[str, str]] = {}
    for edge in tree.edges:
        parents.setdefault(edge.child, {})[edge.parent] = edge.source
    for edge in used:
        if len(parents[edge.child]) > 1:
            both = " and ".join(f"{name} ({source})" for name, source in parents[edge.child].items())
            raise LogError(
                f"frame {edge.child} has two parents, {both}; record only one of the two transforms"
            )
