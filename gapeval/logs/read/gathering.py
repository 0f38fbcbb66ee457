"""Messages -> clouds: one by one, by the passes of a laser, over time, of several sensors."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Accumulate
from gapeval.logs.read.matching import Refusals
from gapeval.logs.read.passes import Pass, passes, rotation, untwisted
from gapeval.logs.read.recording import Scans, Sources
from gapeval.logs.read.transforms import Stamps, Transforms

INCOMPLETE = "incomplete pass of the rotating laser"
TOO_EARLY = "begins before enough scans are there to accumulate"
ALONE = "no cloud of {} within half its period"

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Passes:
    """Sources whose mount does not turn with the laser any more, the clouds of the whole passes, and what
    was found: passes, scans in none of them, and how far the whole ones go [rad], least and most.
    """

    scans: Scans
    found: int
    resting: int
    extents: tuple[float, float]


def one_by_one(sources: Sources, topic: int = 0) -> Scans:
    """Each message of a topic is a cloud."""
    own = np.flatnonzero(sources.topics == topic)
    return Scans(sources, own, own, np.arange(len(own) + 1))


def by_pass(sources: Sources, turning: Transforms, refusals: Refusals) -> Passes:
    """A cloud for each whole pass of a rotating laser, at the stamp of the pass's last scan.

    turning: robot<-laser at the stamps, whose turn is left out of the sensor's mount where that is the same.
    """
    found = rotation(turning.quaternion)
    if found is None:  # too few scans are left of a laser that turns
        return Passes(_clouds_of(sources, []), 0, len(sources), (0.0, 0.0))
    every = passes(found.angles, sources.stamps)
    cut = [one for one in every if not one.is_whole]
    refusals.add(INCOMPLETE, sources.stamps[[one.last - 1 for one in cut]])
    if np.array_equal(turning.quaternion, sources.sensor.quaternion):
        mount = Transforms(sources.sensor.translation, untwisted(turning.quaternion, found.axis))
        sources = replace(sources, sensor=mount)
    whole = [one for one in every if one.is_whole]
    resting = len(sources) - sum(one.last - one.first for one in every)
    extents = [float(np.ptp(found.angles[one.first : one.last])) for one in whole] or [0.0]
    return Passes(_clouds_of(sources, whole), len(every), resting, (min(extents), max(extents)))


def _clouds_of(sources: Sources, every: list[Pass]) -> Scans:
    members = [np.arange(one.first, one.last) for one in every]
    ends = np.cumsum([0, *map(len, members)])
    main = np.array([one.last - 1 for one in every], dtype=np.int64)
    return Scans(sources, main, np.concatenate([*members, np.arange(0)]), ends)


def gathered(
    sources: Sources, topics: tuple[str, ...], window: Accumulate | None, refusals: Refusals
) -> Scans:
    """A cloud at each message of the first topic: with those before it, and with those of the other topics
    that are nearest in time to any of these. Clouds for which something is missing are refused.
    """
    own = np.flatnonzero(sources.topics == 0)
    stamps = sources.stamps[own]
    firsts = _first_in_window(stamps, window)
    refusals.add(TOO_EARLY, stamps[firsts < 0])
    kept = firsts >= 0
    nearest = []
    for number, name in enumerate(topics[1:], start=1):
        found = _nearest(sources, number, stamps)
        # A cloud needs its partners at each of its own scans.
        alone = np.concatenate([[0], np.cumsum(found < 0)])
        lonely = kept & (alone[np.arange(1, len(own) + 1)] > alone[np.maximum(firsts, 0)])
        refusals.add(ALONE.format(name), stamps[lonely])
        kept &= ~lonely
        nearest.append(found)
    members, main = [], np.flatnonzero(kept)
    for index in main:
        scans = slice(firsts[index], index + 1)
        members.append(np.unique(np.concatenate([own[scans], *(found[scans] for found in nearest)])))
    ends = np.cumsum([0, *map(len, members)])
    return Scans(sources, own[main], np.concatenate([*members, np.arange(0)]), ends)


def thinned(scans: Scans, every: int) -> Scans:
    """Each so manieth cloud."""
    chosen = np.arange(0, len(scans), every)
    members = [scans.members_of(int(index)) for index in chosen]
    ends = np.cumsum([0, *map(len, members)])
    return replace(
        scans, main=scans.main[chosen], members=np.concatenate([*members, np.arange(0)]), ends=ends
    )


def _first_in_window(stamps: Stamps, window: Accumulate | None) -> Indices:
    """Of each scan (n,) the first one that is gathered with it; -1 where the window begins before the log."""
    places = np.arange(len(stamps))
    if window is None:
        return places
    if window.scans is not None:
        return np.where(places >= window.scans - 1, places - window.scans + 1, -1)
    assert window.seconds is not None
    begin = stamps - round(window.seconds * 1e9)
    firsts = np.searchsorted(stamps, begin, side="right")
    # The first window that is full may lack what came just before the log.
    slack = int(np.median(np.diff(stamps))) if len(stamps) > 1 else 0
    return np.where(begin >= stamps[0] - slack, firsts, -1)


def _nearest(sources: Sources, topic: int, stamps: Stamps) -> Indices:
    """The source of a topic nearest to each stamp (n,); -1 where that is more than half its period away."""
    theirs = np.flatnonzero(sources.topics == topic)
    if not len(theirs):
        return np.full(len(stamps), -1)
    times = sources.stamps[theirs]
    limit = int(np.median(np.diff(times))) // 2 + 1 if len(times) > 1 else 5 * 10**7
    right = np.minimum(np.searchsorted(times, stamps), len(times) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(stamps - times[left]) <= np.abs(times[right] - stamps), left, right)
    return np.where(np.abs(times[nearer] - stamps) <= limit, theirs[nearer], -1)
