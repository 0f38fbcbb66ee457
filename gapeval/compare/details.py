"""What lies behind changed rows: in which frames, of which labels, and whether it is more than noise."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gapeval.compare.labels import label_changes
from gapeval.compare.noise import NAN, Pair, noises, pair
from gapeval.compare.outcome import TOLERANCE, Change, LabelChange, Noise, Row
from gapeval.compare.side import Side
from gapeval.errors import GapevalError
from gapeval.results.figures import FIGURES
from gapeval.results.store import ALL
from gapeval.scoring.metrics import SUMS

LOOKED_AT = 200_000  # frames, each under one configuration: of the worst rows; a second or so
LABELLED_ROWS = 10  # the worst, whose labels are looked up
OF_LABELS = ("asked", "hits", "covered_area", "label_area", "pairs")  # some change where a label's state does

Ids = tuple[str, str]  # of a row's configuration in BASE and in NEW


@dataclass(frozen=True, slots=True, eq=False)
class Behind:
    """The frames of both results. pairs: of each log whose frames are known. place: of each row in them.

    unknown: why those of other logs are not.
    """

    pairs: Mapping[str, Pair]
    place: Mapping[Ids, int]
    unknown: str = ""

    def of(self, log: str) -> list[Pair]:
        """The pairs that a row of this log, or of all, rests on; none where one is not known."""
        if log != ALL:
            return [self.pairs[log]] if log in self.pairs else []
        return [] if self.unknown else list(self.pairs.values())


def with_details(rows: Sequence[Row], base: Side, new: Side, block: float) -> tuple[Row, ...]:
    """Rows, worst first, with what their frames tell. block: of time [s]."""
    changed = [row for row in rows if row.changes]
    if not changed:
        return tuple(rows)
    most = max(LABELLED_ROWS, LOOKED_AT // max(1, sum(new.frames.values())))
    ids = list(dict.fromkeys((row.was, row.configuration) for row in changed))
    behind = _behind(ids[:most], base, new, block)
    changed = [row for row in changed if (row.was, row.configuration) in behind.place]
    noise = _noise(changed, behind)
    frames = {log: _changed_frames(one, tuple(SUMS)) for log, one in behind.pairs.items()}
    labelled = [row for row in changed if row.log in frames][:LABELLED_ROWS]
    try:
        labels = {(row.log, row.was): _labels(row, behind, base, new) for row in labelled}
        unknown = ""
    except GapevalError as error:  # which labels changed is worth less than the verdict
        labels, unknown = {}, str(error)
    found = []
    for row in rows:
        if row.changes and (row.was, row.configuration) not in behind.place:
            row = replace(row, unknown=f"only the frames of the worst {most} configurations were looked at")
        elif row.changes:
            row = replace(row, changes=tuple(_with_noise(row, change, noise) for change in row.changes))
            if row.log in frames:
                of_row = frames[row.log][:, behind.place[row.was, row.configuration]]
                indices = tuple(np.flatnonzero(of_row).tolist())
                of_labels = labels.get((row.log, row.was))
                row = replace(row, frames=indices, labels=of_labels, unknown=unknown)
            elif row.log != ALL:
                row = replace(row, unknown=behind.unknown)
        found.append(row)
    return tuple(found)


def _behind(ids: Sequence[Ids], base: Side, new: Side, block: float) -> Behind:
    place = {of_row: at for at, of_row in enumerate(ids)}
    unknown = base.record.unknown or new.record.unknown
    if unknown:
        return Behind({}, place, unknown)
    try:
        before = base.record.frames({one for one, _ in ids})
        after = new.record.frames({other for _, other in ids})
        pairs = {}
        for at, log in enumerate(sorted(base.logs & new.logs)):
            if log not in before or log not in after:
                unknown = f"frames of {log} are missing"
                continue
            one, other = before[log].of([one for one, _ in ids]), after[log].of([other for _, other in ids])
            if np.array_equal(one.stamps, other.stamps):
                pairs[log] = pair(one, other, block, at)
            else:
                unknown = f"{log} has frames at other stamps"
    except GapevalError as error:
        return Behind({}, place, str(error))
    return Behind(pairs, place, unknown)


def _noise(changed: Sequence[Row], behind: Behind) -> dict[tuple[str, Ids, str], Noise]:
    """Of each log, row and metric."""
    groups: dict[tuple[str, str], list[tuple[Ids, Change]]] = {}
    for row in changed:
        for change in row.changes:
            if change.difference is not None and FIGURES[change.metric].above:
                groups.setdefault((row.log, change.metric), []).append(((row.was, row.configuration), change))

    def of(group: tuple[tuple[str, str], list[tuple[Ids, Change]]]) -> tuple[Noise, ...]:
        (log, metric), members = group
        pairs = behind.of(log)
        if not pairs:
            return (Noise(NAN, NAN, behind.unknown or "its frames are not known"),) * len(members)
        places = np.array([behind.place[ids] for ids, _ in members])
        values = np.array([[change.base, change.new] for _, change in members], dtype=np.float64).T
        return noises(FIGURES[metric], pairs, places, values)

    with ThreadPoolExecutor(os.cpu_count()) as threads:
        found = threads.map(of, groups.items())
        return {
            (log, ids, metric): noise
            for ((log, metric), members), each in zip(groups.items(), found, strict=True)
            for (ids, _), noise in zip(members, each, strict=True)
        }


def _with_noise(row: Row, change: Change, noise: Mapping[tuple[str, Ids, str], Noise]) -> Change:
    return replace(change, noise=noise.get((row.log, (row.was, row.configuration), change.metric)))


def _changed_frames(one: Pair, names: Sequence[str]) -> NDArray[np.bool_]:
    """Whether any of these sums has changed, (F, C)."""
    found = np.zeros((len(one.base.stamps), len(one.base.place)), dtype=bool)
    for name in names:
        before, after = one.base.sums[name], one.new.sums[name]
        if not np.array_equal(before, after):
            found |= np.abs(after - before) > TOLERANCE * np.maximum(1.0, np.abs(before))
    return found


def _labels(row: Row, behind: Behind, base: Side, new: Side) -> tuple[LabelChange, ...]:
    pair_of = behind.pairs[row.log]
    place = behind.place[row.was, row.configuration]
    indices = np.flatnonzero(_changed_frames(_column(pair_of, place), OF_LABELS)).tolist()
    frames = [(index, int(pair_of.base.stamps[index])) for index in indices]
    return label_changes(
        frames,
        [base.record.states(row.log, stamp, row.was) for _, stamp in frames],
        [new.record.states(row.log, stamp, row.configuration) for _, stamp in frames],
    )


def _column(one: Pair, place: int) -> Pair:
    """One row of many."""
    before, after = (
        replace(
            side,
            place={"": 0},
            sums={name: side.sums[name][:, place : place + 1] for name in OF_LABELS},
        )
        for side in (one.base, one.new)
    )
    return replace(one, base=before, new=after)
