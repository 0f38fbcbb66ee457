"""Passes of a laser that turns: from its attitude at each planar scan to the scans of each cloud."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray, rotation_matrices
from gapeval.logs.read.transforms import Stamps, conjugate, product, rotation_vectors

RESTS = 0.1  # of the usual rate; what turns more slowly rests
TURNS = np.deg2rad(5.0)  # rad; what turns by less in the whole log does not turn
ROUND = 1.25 * np.pi  # rad; a turn that goes on for longer is cut into halves
WHOLE = 0.8  # of the usual extent; a pass of less is incomplete
SLIVER = 0.1  # of the usual extent; less is a joint that settles, and no pass
PAUSE = 5.0  # usual times between scans; where more are missing, a pass ends

HALF_TURNS = np.array([[0, 0, 0, 1], [0, 0, 1, 0], [0, 1, 0, 0], [1, 0, 0, 0]], dtype=np.float64)
SIGNS = np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])  # what these do to x, y and z


@dataclass(frozen=True, slots=True, eq=False)
class Rotation:
    """How a laser turned. axis: (3,), in its own frame; angles: (n,) about it [rad], unwrapped."""

    axis: FloatArray
    angles: FloatArray


@dataclass(frozen=True, slots=True)
class Pass:
    """Scans [first, last) that the laser made while it turned one way. is_whole: as far as usual."""

    first: int
    last: int
    is_whole: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Turn:
    """Scans from one turning point to the next: the first one, times [s], and the farthest angles that it has
    come to until then [rad], as they grow by its way, 1 or -1.
    """

    first: int
    times: FloatArray
    risen: FloatArray
    way: float


def rotation(quaternions: FloatArray) -> Rotation | None:
    """Of attitudes robot<-laser (n, 4) in the order of time; None for a laser that does not turn.

    The axis is the direction about which it turned most. Angle 0 is the attitude without any turn about it.
    """
    if len(quaternions) < 2:
        return None
    steps = rotation_vectors(product(conjugate(quaternions[:-1]), quaternions[1:]))
    _, vectors = np.linalg.eigh(steps.T @ steps)
    axis = vectors[:, -1]
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])  # an eigenvector has no sign of its own
    level = product(conjugate(_facing(quaternions, axis)), quaternions)
    angles = np.unwrap(2 * np.arctan2(level[:, :3] @ axis, level[:, 3]))
    return Rotation(axis, angles) if np.ptp(angles) >= TURNS else None


def passes(angles: FloatArray, stamps: Stamps) -> list[Pass]:
    """Runs of scans that turn one way, from one turning point to the next.

    A laser that goes round and round makes a pass with every half turn, through |angle| <= 90 degrees and
    on through the other half: each half sees all around. Scans made at rest belong to no pass.
    angles, stamps: (n,) [rad], [ns], in the order of time.
    """
    runs = [part for run in _runs(angles, stamps) for part in _halves(angles, run)]
    extents = np.array([_extent(angles, run) for run in runs])
    if not len(extents):
        return []
    # What the log begins or ends with, or what scans are missing of, says nothing of what is usual.
    whole = np.array([_is_bounded(run, len(angles)) for run in runs])
    known = extents[whole & (extents >= WHOLE * extents.max())]
    usual = np.median(known) if len(known) else max(np.pi, extents.max())
    return [
        Pass(run.start, run.stop, bool(extent >= WHOLE * usual))
        for run, extent in zip(runs, extents, strict=True)
        if extent >= SLIVER * usual
    ]


def _is_bounded(run: range, count: int) -> bool:
    """Whether scans were made before and after it: else the log may have cut it."""
    return run.start > 0 and run.stop < count


def untwisted(quaternions: FloatArray, axis: FloatArray) -> FloatArray:
    """Attitudes (n, 4) without their turn about an axis (3,) of the laser: how its mount stands."""
    level = product(conjugate(_facing(quaternions, axis)), quaternions)
    twist = np.column_stack([(level[:, :3] @ axis)[:, None] * axis, level[:, 3]])
    length = np.linalg.norm(twist, axis=1, keepdims=True)
    # Half a turn about another axis has none about this one.
    twist = np.where(length > 1e-9, twist / np.maximum(length, 1e-9), HALF_TURNS[0])
    return product(quaternions, conjugate(twist))


def _facing(quaternions: FloatArray, axis: FloatArray) -> FloatArray:
    """How the mount of a laser stands, roughly: as the robot, or half a turn from there; (n, 4), all alike.

    The mount's turn and that about the axis are told apart only where the mount does not reverse the axis,
    as that of a laser that looks back does. Against what is returned it turns it by at most 120 degrees.
    """
    along = np.median(rotation_matrices(quaternions) @ axis, axis=0)
    likeness = SIGNS @ (along * axis)
    if likeness[0] >= -0.5:
        return np.tile(HALF_TURNS[0], (len(quaternions), 1))
    best = int(np.argmax(likeness >= likeness.max() - 0.1))  # the first, if several are as good
    return np.tile(HALF_TURNS[best], (len(quaternions), 1))


def _runs(angles: FloatArray, stamps: Stamps) -> list[range]:
    """Longest runs of scans between which the laser turns one way without rest or pause."""
    ways = _ways(angles, stamps)
    edges = np.flatnonzero(np.diff(ways)) + 1
    bounds = [0, *edges.tolist(), len(ways)]
    # The scan at a turning point ends one pass and would begin the next; it goes to the first.
    runs = [range(first, last + 1) for first, last in itertools.pairwise(bounds) if ways[first]]
    return [
        range(run.start + (index > 0 and runs[index - 1].stop > run.start), run.stop)
        for index, run in enumerate(runs)
    ]


def _ways(angles: FloatArray, stamps: Stamps) -> FloatArray:
    """Which way the laser turns from each scan to the next, (n - 1,): 1 or -1, 0 in a rest or a pause.

    A joint's angles come in steps, and tremble: only what goes back by a good part of a pass is a turn back.
    """
    seconds = np.diff(stamps) / 1e9
    least = min(TURNS, SLIVER * float(np.ptp(angles)))
    period = float(np.median(seconds))
    parts = [0, *(np.flatnonzero(seconds > PAUSE * period) + 1).tolist(), len(angles)]
    turns = [
        _turn(first + begin, angles[first + begin : first + end + 1], stamps[first + begin : first + end + 1])
        for first, last in itertools.pairwise(parts)
        for begin, end in itertools.pairwise(_turning_points(angles[first:last].tolist(), least))
    ]
    ways = np.zeros(len(seconds))
    if turns:
        usual = float(np.median(np.concatenate([_rates(turn, least) for turn in turns])))
        span = max(PAUSE * period, least / usual)
        for turn in turns:
            ways[turn.first : turn.first + len(turn.times) - 1] = np.where(
                _rests(turn, usual, span), 0.0, turn.way
            )
    return ways


def _turning_points(angles: list[float], least: float) -> list[int]:
    """The first and last of the scans that turn, and between them those after which the angle goes back by as
    much as `least`; none where it never goes that far.
    """
    low = high = way = 0
    found: list[int] = []
    for now, angle in enumerate(angles):
        if way >= 0 and angle > angles[high]:
            high = now
        if way <= 0 and angle < angles[low]:
            low = now
        if way == 0 and angles[high] - angles[low] >= least:
            way = 1 if high > low else -1
            found.append(min(low, high))
        elif way > 0 and angles[high] - angle >= least:
            found.append(high)
            way, low = -1, now
        elif way < 0 and angle - angles[low] >= least:
            found.append(low)
            way, high = 1, now
    return [*found, high if way > 0 else low] if way else []


def _turn(first: int, angles: FloatArray, stamps: Stamps) -> _Turn:
    way = float(np.sign(angles[-1] - angles[0]))
    return _Turn(first, (stamps - stamps[0]) / 1e9, np.maximum.accumulate(way * angles), way)


def _rates(turn: _Turn, least: float) -> FloatArray:
    """How fast it turned [rad/s], in parts of equal angle, so that rests hardly count."""
    levels = np.linspace(turn.risen[0], turn.risen[-1], int((turn.risen[-1] - turn.risen[0]) / least) + 1)
    when = np.interp(levels, turn.risen, turn.times)
    return np.asarray(np.diff(levels) / np.diff(when), dtype=np.float64)


def _rests(turn: _Turn, usual: float, span: float) -> NDArray[np.bool_]:
    """Between which scans it rests: where it hardly goes on for a span [s], or at its ends."""
    middle = (turn.times[1:] + turn.times[:-1]) / 2
    begin, end = np.maximum(middle - span / 2, turn.times[0]), np.minimum(middle + span / 2, turn.times[-1])
    gone = np.interp(end, turn.times, turn.risen) - np.interp(begin, turn.times, turn.risen)
    stuck: NDArray[np.bool_] = gone < RESTS * usual * (end - begin)
    slow: NDArray[np.bool_] = stuck | (np.diff(turn.risen) <= RESTS * usual * np.diff(turn.times))
    bounds = [0, *(np.flatnonzero(np.diff(slow)) + 1).tolist(), len(slow)]
    for first, last in itertools.pairwise(bounds):
        if first > 0 and last < len(slow) and not stuck[first:last].any():
            slow[first:last] = False
    return slow


def _halves(angles: FloatArray, run: range) -> list[range]:
    if _extent(angles, run) <= ROUND:
        return [run]
    half = np.floor((angles[run.start : run.stop] + np.pi / 2) / np.pi)
    edges = (np.flatnonzero(np.diff(half)) + 1 + run.start).tolist()
    bounds = [run.start, *edges, run.stop]
    return [range(first, last) for first, last in itertools.pairwise(bounds)]


def _extent(angles: FloatArray, run: range) -> float:
    return float(np.ptp(angles[run.start : run.stop])) if run else 0.0
