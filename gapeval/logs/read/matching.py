"""Clouds and transforms -> the scans that have both."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read.recording import Sources
from gapeval.logs.read.survey import UNDECODABLE, Headers
from gapeval.logs.read.transforms import (
    AFTER,
    BEFORE,
    GAP,
    Stamps,
    Transforms,
    TransformTree,
    find_path,
    frames,
    lookup,
)

EXAMPLES = 3  # stamps given for each reason
REPEATED = "stamp repeated"
APART = -1  # the tree does not connect the two frames
REASONS = {
    BEFORE: "begins up to {} s later",
    AFTER: "ends up to {} s earlier",
    GAP: "has a gap of up to {} s",
}
COMMON_CLOCK = 10**15  # ns; spans farther apart (12 days) are not of one clock

Good = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames that were picked. sensor: None where each cloud's own frame is its laser's.

    reference: the robot's, or the fixed one where clouds are gathered while the robot moves.
    """

    robot: str
    fixed: str | None
    sensor: str | None
    reference: str


@dataclass(frozen=True, slots=True)
class Missing:
    """A transform target<-source that some clouds lack. why: one of transforms' reasons, or APART."""

    target: str
    source: str
    why: int


@dataclass(slots=True)
class Refusals:
    """reason -> clouds, a few of their stamps, and the transform that is missing, if that is what it is."""

    counts: dict[str, int] = field(default_factory=dict)
    examples: dict[str, tuple[int, ...]] = field(default_factory=dict)
    missing: dict[str, Missing] = field(default_factory=dict)

    def add(self, reason: str, stamps: NDArray[Any], missing: Missing | None = None) -> None:
        if not len(stamps):
            return
        self.counts[reason] = self.counts.get(reason, 0) + len(stamps)
        known = self.examples.get(reason, ())
        self.examples[reason] = (*known, *(int(s) for s in stamps[: EXAMPLES - len(known)]))
        if missing is not None:
            self.missing[reason] = missing


def match(
    headers: Headers, offsets: Stamps, tree: TransformTree, picked: Frames, settings: LogSection
) -> tuple[Sources, Refusals]:
    """The messages that have all their transforms, and the others by reason.

    offsets: (n, K) [ns], the times between which each message was measured, since its stamp.
    Raises LogError where a frame on the way has two parents, or a transform is none.
    """
    stamps = used_stamps(headers, settings)
    refusals = Refusals()
    refusals.add(UNDECODABLE, np.array(headers.undecodable, dtype=np.int64))
    repeated = _repeated(headers.topics, stamps)
    refusals.add(REPEATED, stamps[repeated])
    good = ~repeated
    count, width = offsets.shape
    cloud, sensor = Transforms.identity(count * width), Transforms.identity(count)
    names = np.array(headers.frames, dtype=np.str_)
    for name in dict.fromkeys(headers.frames):
        own = name if picked.sensor is None else picked.sensor
        rows = good & (names == name)
        if picked.sensor is None and name in (picked.robot, picked.fixed):
            refusals.add(f"cloud in {name}, which is not a laser's own frame", stamps[rows])
            good &= ~rows
            continue
        for column, times, pair in (
            (cloud, stamps[:, None] + offsets, (picked.reference, name)),
            (sensor, stamps[:, None], (picked.robot, own)),
        ):
            good = _fill(column, times, good, good & (names == name), tree, pair, settings, refusals)
    pose = None
    if picked.fixed is not None:
        pose = Transforms.identity(count)
        pair = (picked.fixed, picked.robot)
        good = _fill(pose, stamps[:, None], good, good, tree, pair, settings, refusals)
    return _sources(headers, stamps, offsets, good, cloud, sensor, pose), refusals


def used_stamps(headers: Headers, settings: LogSection) -> Stamps:
    """The stamps that the user asked for: of the headers, or of the bag."""
    return headers.bag_times if settings.stamps == "bag" else headers.stamps


def check_matched(
    matched: int, headers: Headers, refusals: Refusals, tree: TransformTree, settings: LogSection
) -> None:
    """Raises LogError where fewer clouds than `min_matched` have all their transforms, or none has."""
    total = headers.total
    if matched and matched >= settings.min_matched * total:
        return
    few = f"only {matched} of {total} clouds have" if matched else f"none of {total} clouds has"
    worst = max(refusals.counts, key=lambda reason: refusals.counts[reason])
    missing = refusals.missing.get(worst)
    if missing is None:
        reasons = "; ".join(f"{count} x {reason}" for reason, count in refusals.counts.items())
        raise LogError(f"{few} what is needed ({reasons}); record the log again or lower --min-matched")
    why, advice = _explanation(missing, headers, tree, settings)
    raise LogError(f"{few} a transform {missing.target}<-{missing.source} ({why}); {advice}")


def _explanation(
    missing: Missing, headers: Headers, tree: TransformTree, settings: LogSection
) -> tuple[str, str]:
    """Why a transform is missing, and what to do about it."""
    if missing.why == APART:
        known = frames(tree)
        lost = [name for name in (missing.target, missing.source) if name not in known]
        what = f"{lost[0]} is not in tf" if lost else "tf does not connect them"
        listed = ", ".join(known[:12]) or "none"
        return f"{what}; frames: {listed}", "add it with `log: transforms:` in the configuration"
    if missing.why == GAP:
        return (
            f"tf has gaps of more than {settings.max_tf_gap:g} s",
            "raise it with -p log.max_tf_gap=... or lower --min-matched",
        )
    edges = [edge for edge, _ in find_path(tree, missing.target, missing.source) or () if not edge.is_static]
    tf = (max(int(e.stamps[0]) for e in edges), min(int(e.stamps[-1]) for e in edges))
    source = "tf" if all(edge is not tree.pose for edge in edges) else str(edges[0].source)
    stamps = used_stamps(headers, settings)
    clouds = (int(stamps.min()), int(stamps.max()))
    covers = f"{source} covers {_seconds(tf, tf, clouds)}, clouds {_seconds(clouds, tf, clouds)}"
    apart = clouds[1] < tf[0] or clouds[0] > tf[1]
    bag = (int(headers.bag_times.min()), int(headers.bag_times.max()))
    if apart and settings.stamps == "header" and bag[0] <= tf[1] and bag[1] >= tf[0]:
        return f"{covers}: no overlap in time", "their bag times do overlap: try -p log.stamps=bag"
    advice = f"record /{source.lstrip('/')} for the whole time"
    if apart:
        return f"{covers}: no overlap in time", f"{advice}, by the same clock"
    return covers, f"{advice} or lower --min-matched"


def _seconds(span: tuple[int, int], *spans: tuple[int, int]) -> str:
    """A span since the earliest of all; since 1970 where the clocks are plainly different ones."""
    first = min(start for start, _ in spans)
    base = first if max(start for start, _ in spans) - first < COMMON_CLOCK else 0
    return f"{(span[0] - base) / 1e9:.1f}-{(span[1] - base) / 1e9:.1f} s"


def _fill(
    column: Transforms,
    times: Stamps,
    good: Good,
    rows: Good,
    tree: TransformTree,
    pair: tuple[str, str],
    settings: LogSection,
    refusals: Refusals,
) -> Good:
    """Writes target<-source at the times (n, K) of rows that have it at each; returns which are still good.

    column: (n * K,); the first of a row's times is its stamp, or near it.
    """
    target, source = pair
    width = times.shape[1]
    asked = np.flatnonzero(rows)
    found = lookup(tree, target, source, times[asked].ravel(), settings.max_tf_gap)
    good = good.copy()
    if found is None:
        refusals.add(
            f"no transform {target}<-{source}: not connected",
            times[asked, 0],
            Missing(target, source, APART),
        )
        good[asked] = False
        return good
    reasons, distances = found.reasons.reshape(-1, width), found.distances.reshape(-1, width)
    left = np.ones(len(asked), dtype=np.bool_)
    for why, text in REASONS.items():
        failed = (reasons == why).any(axis=1) & left
        left &= ~failed
        if failed.any():
            worst = distances[failed][reasons[failed] == why].max() / 1e9
            reason = f"no transform {target}<-{source} at their stamps: tf {text.format(f'{worst:.3g}')}"
            refusals.add(reason, times[asked[failed], 0], Missing(target, source, why))
    places = (asked[:, None] * width + np.arange(width)).ravel()
    column.translation[places] = found.transforms.translation
    column.quaternion[places] = found.transforms.quaternion
    good[asked[~left]] = False
    return good


def _repeated(topics: NDArray[np.int64], stamps: Stamps) -> Good:
    """Every cloud whose stamp an earlier cloud of its topic has."""
    again = np.ones(len(stamps), dtype=np.bool_)
    again[np.unique(np.column_stack([topics, stamps]), axis=0, return_index=True)[1]] = False
    return again


def _sources(
    headers: Headers,
    stamps: Stamps,
    offsets: Stamps,
    good: Good,
    cloud: Transforms,
    sensor: Transforms,
    pose: Transforms | None,
) -> Sources:
    rows = np.flatnonzero(good)
    rows = rows[np.lexsort((headers.topics[rows], stamps[rows]))]
    width = offsets.shape[1]
    return Sources(
        topics=headers.topics[rows],
        stamps=stamps[rows],
        bag_times=headers.bag_times[rows],
        ranks=headers.ranks[rows],
        indices=headers.indices[rows],
        frames=tuple(headers.frames[i] for i in rows),
        times=stamps[rows, None] + offsets[rows],
        knots=cloud.take((rows[:, None] * width + np.arange(width)).ravel()),
        sensor=sensor.take(rows),
        pose=None if pose is None else pose.take(rows),
    )
