"""A sweep over logs, written to a folder."""

import os
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gapeval.config import Config
from gapeval.errors import ConfigError, GapevalError
from gapeval.labels import Labels, require_frames
from gapeval.logs.read import Recording, lowest_elevations
from gapeval.results.manifest import LogTally, label_entry, log_entry, manifest
from gapeval.results.part import FILES, UnreadablePartError, merged
from gapeval.results.parts import (
    Input,
    Order,
    There,
    keys,
    look,
    note_finished,
    read_part,
    remove_others,
    write_order,
    write_part,
)
from gapeval.results.store import Store, open_store
from gapeval.results.tables import point
from gapeval.scoring.scene import common_domain, common_plane
from gapeval.sweep.evaluation import Question
from gapeval.sweep.executor import Finished, Workers, results
from gapeval.sweep.grid import configurations
from gapeval.sweep.provenance import content_digest, content_sample
from gapeval.sweep.units import Span, Task, Unit, split


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What is to be done. label_files: as they were given, one for all logs or one for each."""

    config: Config
    label_files: tuple[Labels, ...]
    task: Task

    @property
    def frames(self) -> int:
        return sum(len(recording.scans) for recording in self.task.recordings)


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """A sweep and what is there of it. parts: their folder. keys: of each log's parts."""

    sweep: Sweep
    order: Order
    parts: Path
    keys: tuple[str, ...]
    spans: tuple[Span, ...]
    there: There

    @property
    def evaluations(self) -> tuple[int, int]:
        """Of frames under configurations: how many there are to be, and how many are missing."""
        missing = sum(len(unit.span) * len(unit.configurations) for unit in self.there.missing)
        return self.sweep.frames * len(self.sweep.task.question.configurations), missing

    @property
    def frames_there(self) -> int:
        """Frames that need no more work."""
        missing = {unit.span for unit in self.there.missing}
        return sum(len(span) for span in self.spans if span not in missing)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What was done. logs: an entry of the manifest for each."""

    store: Store
    logs: tuple[dict[str, Any], ...]

    @property
    def frames(self) -> int:
        return sum(entry["frames"] for entry in self.logs)


def plan(
    config: Config,
    recordings: Sequence[Recording],
    labels: Sequence[Labels],
    keep_gaps: bool = False,
    names: Sequence[str] = (),
) -> Sweep:
    """Raises GapevalError where logs, labels and configuration do not go together.

    labels: none, one for all recordings, or one for each. names: of the logs in the results, by default
    their paths; needed where a log is read in several ways.
    """
    if len(labels) not in (0, 1, len(recordings)):
        raise ConfigError(
            f"{len(labels)} label files for {len(recordings)} logs; give one for all, or one per log"
        )
    each = list(labels) * len(recordings) if len(labels) == 1 else list(labels)
    for recording, drawn in zip(recordings, each, strict=False):
        require_frames(drawn, recording.robot_frame, recording.fixed_frame)
    found = configurations(config)
    box = common_domain(found, config.scoring)
    question = Question(found, config.scoring, *box, keep_gaps, common_plane(found))
    called = tuple(names) or log_names([recording.path for recording in recordings])
    task = Task(tuple(recordings), called, tuple(each) or (None,) * len(recordings), question)
    return Sweep(config, tuple(labels), task)


def begin(sweep: Sweep, parts: Path) -> Begun:
    """Note what is to be done, and look what is there already. The folder must be locked."""
    task = sweep.task
    contents = tuple(content_sample(recording.path) for recording in task.recordings)
    digests = [content_digest(recording.path) for recording in task.recordings]
    order = Order(
        tuple(
            Input(one.path.resolve(), digest) for one, digest in zip(task.recordings, digests, strict=True)
        ),
        tuple(Input(drawn.path.resolve(), drawn.sha256) for drawn in sweep.label_files),
        sweep.config,
        task.question.keep_gaps,
    )
    write_order(parts, order)
    found = keys(task, sweep.config, digests)
    task = replace(task, keys=found, contents=contents)
    spans = tuple(split(task))
    return Begun(replace(sweep, task=task), order, parts, found, spans, look(parts, task, found, spans))


def evaluate_missing(
    begun: Begun, workers: Workers[Unit], advance: Callable[[int], object]
) -> Generator[Finished[Unit], None, None]:
    """Evaluate what is not there and keep each part as it comes; yields the units that failed.

    advance: called with the frames of each unit. Raises GapevalError where a part cannot be written.
    """
    with closing(results(workers, begun.there.missing)) as finished:
        for one in finished:
            if one.error is None:
                span = one.unit.span
                key = begun.keys[span.recording]
                path = write_part(begun.parts, begun.sweep.task, key, one.unit, one.made)
                begun.there.paths[span].append(path)
            advance(len(one.unit.span))
            if one.error is not None:
                yield one


def write_results(begun: Begun, failed: Sequence[Finished[Unit]], folder: Path) -> Outcome:
    """The result files, from all parts, one span at a time. Spans of which a unit failed are left out."""
    sweep, task = begun.sweep, begun.sweep.task
    lost = {one.unit.span for one in failed}
    tallies = [LogTally(dict(recording.refused)) for recording in task.recordings]
    points = [point(configuration) for configuration in task.question.configurations]
    ids = [one.id for one in points]
    timelines = {
        name: recording.scans.stamps for name, recording in zip(task.names, task.recordings, strict=True)
    }
    block = sweep.config.scoring.block
    with open_store(folder, points, timelines, block, task.question.keep_gaps) as store:
        for span in begun.spans:
            if span not in lost:
                _merge(begun, span, ids, tallies[span.recording], store)
        for index, (recording, tally) in enumerate(zip(task.recordings, tallies, strict=True)):
            if tally.frames == 0 and not any(span.recording == index for span in lost):
                reasons = "; ".join(f"{count} x {reason}" for reason, count in tally.refused.items())
                raise GapevalError(f"{recording.path}: no cloud could be used ({reasons})")
        entries = tuple(map(log_entry, task.names, task.recordings, tallies, task.labels))
        labels = [
            label_entry(drawn) | {"unmatched_stamps": len(missing)}
            for drawn, missing in unmatched_stamps(sweep).items()
        ]
        failures = [_failure(task, one) for one in sorted(failed, key=lambda one: _order(one.unit.span))]
        store.finish(
            _effective(sweep).to_yaml(),
            manifest(entries, labels, len(points), _scoring(sweep), failures),
            task.names,
        )
    note_finished(begun.parts)
    remove_others(begun.parts, begun.keys)
    return Outcome(store, entries)


def _merge(begun: Begun, span: Span, ids: Sequence[str], tally: LogTally, store: Store) -> None:
    try:
        parts = [read_part(path) for path in begun.there.paths[span]]
    except UnreadablePartError as error:
        raise GapevalError(
            f"{error}: a part that was there is damaged now; run the same command again"
        ) from error
    unit, name = (
        merged(parts, ids, [file for file in FILES if file in store.names]),
        begun.sweep.task.names[span.recording],
    )
    for reason in unit.first.refusals:
        tally.refuse(reason)
    for file, rows in unit.rows.items():
        store.write(file, rows)
    for frame, digest in enumerate(unit.first.digests):
        tally.add(digest, int(unit.first.points[frame]), int(unit.first.dropped[frame]))
        store.count(
            name, int(unit.first.stamps[frame]), unit.sums[frame], unit.first.asked[frame], unit.hits[frame]
        )
        store.time(name, [(part.spent[frame], len(part.ids)) for part in unit.parts])


def _failure(task: Task, failed: Finished[Unit]) -> dict[str, Any]:
    """An entry of the manifest."""
    span = failed.unit.span
    stamps = task.recordings[span.recording].scans.stamps[span.first : span.last].tolist()
    return {
        "log": task.names[span.recording],
        "first": stamps[0],
        "last": stamps[-1],
        "frames": len(span),
        "reason": reason(failed),
    }


def reason(failed: Finished[Unit]) -> str:
    """Why a unit failed, in one line."""
    text = " ".join(str(failed.error).split())
    return text if isinstance(failed.error, GapevalError) else f"{type(failed.error).__name__}: {text}"


def _order(span: Span) -> tuple[int, int]:
    return span.recording, span.first


def unmatched_stamps(sweep: Sweep) -> dict[Labels, list[int]]:
    """Of each label file, the stamps that were labelled and are no cloud of any log that it goes with."""
    missing: dict[Labels, set[int]] = {}
    for drawn, recording in zip(sweep.task.labels, sweep.task.recordings, strict=True):
        if drawn is not None:
            missing.setdefault(drawn, set(drawn.stamps or ())).difference_update(
                recording.scans.stamps.tolist()
            )
    return {drawn: sorted(stamps) for drawn, stamps in missing.items()}


def log_names(paths: Iterable[Path]) -> tuple[str, ...]:
    """Paths relative to the logs' common parent. Raises ConfigError if a log is named twice."""
    resolved = [path.resolve() for path in paths]
    if len(set(resolved)) < len(resolved):
        raise ConfigError("a log is named twice; name each once")
    parent = os.path.commonpath([path.parent for path in resolved])
    return tuple(path.relative_to(parent).as_posix() for path in resolved)


def _scoring(sweep: Sweep) -> dict[str, Any]:
    """How gaps are compared with labels: as configured, with domain and plane that the grid leads to.

    The plane is named only if it is not the robot's.
    """
    question = sweep.task.question
    used = {"domain": question.domain.model_dump(mode="json"), "origin": question.origin}
    used |= {"plane": question.plane} if question.plane != "robot" else {}
    return sweep.config.scoring.model_dump(mode="json") | used


def _effective(sweep: Sweep) -> Config:
    """The configuration as it was used: with what was measured in logs that their file names tell apart."""
    names = Counter(recording.path.name for recording in sweep.task.recordings)
    lowest = {
        key: elevation
        for recording in sweep.task.recordings
        for key, elevation in lowest_elevations(recording).items()
        if names[recording.path.name] == 1
    }
    log = sweep.config.log.model_copy(update={"lowest_elevation": lowest})
    return sweep.config.model_copy(update={"log": log})
