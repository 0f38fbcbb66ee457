"""A sweep over logs, written to a folder."""

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gapeval.config import Config
from gapeval.errors import ConfigError, GapevalError
from gapeval.labels import Labels, require_frames
from gapeval.logs.read import Recording
from gapeval.results.manifest import LogTally, label_entry, log_entry, manifest
from gapeval.results.store import Store, open_store
from gapeval.results.tables import point
from gapeval.scoring.scene import common_domain
from gapeval.sweep.evaluation import Question
from gapeval.sweep.executor import Task, run
from gapeval.sweep.grid import configurations


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What is to be done. names: what each log is called in the results."""

    config: Config
    names: tuple[str, ...]
    task: Task

    @property
    def frames(self) -> int:
        return sum(len(recording.scans) for recording in self.task.recordings)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What was done. logs: an entry of the manifest for each."""

    store: Store
    logs: tuple[dict[str, Any], ...]

    @property
    def frames(self) -> int:
        return sum(entry["frames"] for entry in self.logs)


def plan(
    config: Config, recordings: Sequence[Recording], labels: Sequence[Labels], keep_gaps: bool = False
) -> Sweep:
    """Raises GapevalError where logs, labels and configuration do not go together.

    labels: none, one for all recordings, or one for each.
    """
    if len(labels) not in (0, 1, len(recordings)):
        raise ConfigError(
            f"{len(labels)} label files for {len(recordings)} logs; give one for all, or one per log"
        )
    each = list(labels) * len(recordings) if len(labels) == 1 else list(labels)
    for recording, drawn in zip(recordings, each, strict=False):
        require_frames(drawn, recording.robot_frame, recording.fixed_frame)
    found = configurations(config)
    question = Question(found, config.scoring, *common_domain(found, config.scoring), keep_gaps)
    task = Task(tuple(recordings), tuple(each) or (None,) * len(recordings), question)
    return Sweep(config, log_names([recording.path for recording in recordings]), task)


def write_sweep(sweep: Sweep, folder: Path, jobs: int, advance: Callable[[], object]) -> Outcome:
    """Evaluate all frames; `advance` is called after each. The files appear when all is done."""
    task = sweep.task
    tallies = [LogTally(dict(recording.refused)) for recording in task.recordings]
    points = [point(configuration) for configuration in task.question.configurations]
    with open_store(folder, points, task.question.keep_gaps) as store:
        for frame in run(task, jobs):
            tally = tallies[frame.recording]
            if frame.answers is None:
                tally.refuse(frame.refusal)
            else:
                tally.add(frame.digest, frame.points, frame.dropped)
                store.add(sweep.names[frame.recording], frame.stamp, frame.answers, frame.spent)
            advance()
        for recording, tally in zip(task.recordings, tallies, strict=True):
            if tally.frames == 0:
                reasons = "; ".join(f"{count} x {reason}" for reason, count in tally.refused.items())
                raise GapevalError(f"{recording.path}: no cloud could be used ({reasons})")
        entries = tuple(map(log_entry, sweep.names, task.recordings, tallies))
        labels = [
            label_entry(drawn) | {"unmatched_stamps": len(missing)}
            for drawn, missing in unmatched_stamps(sweep).items()
        ]
        store.finish(_effective(sweep).to_yaml(), manifest(entries, labels, len(points)), sweep.names)
    return Outcome(store, entries)


def unmatched_stamps(sweep: Sweep) -> dict[Labels, list[int]]:
    """Of each label file, the stamps that were labelled and are no cloud of any log that it goes with."""
    missing: dict[Labels, set[int]] = {}
    for drawn, recording in zip(sweep.task.labels, sweep.task.recordings, strict=True):
        if drawn is not None:
            missing.setdefault(drawn, set(drawn.stamps or ())).difference_update(
                recording.scans.stamps.tolist()
            )
    return {drawn: sorted(stamps) for drawn, stamps in missing.items()}


def log_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """Paths relative to the logs' common parent. Raises ConfigError if a log is named twice."""
    resolved = [path.resolve() for path in paths]
    if len(set(resolved)) < len(resolved):
        raise ConfigError("a log is named twice; name each once")
    parent = os.path.commonpath([path.parent for path in resolved])
    return tuple(path.relative_to(parent).as_posix() for path in resolved)


def _effective(sweep: Sweep) -> Config:
    """The configuration as it was used: with what was measured in logs that their file names tell apart."""
    names = Counter(recording.path.name for recording in sweep.task.recordings)
    lowest = {
        recording.path.name: recording.lowest_elevation
        for recording in sweep.task.recordings
        if names[recording.path.name] == 1
    }
    log = sweep.config.log.model_copy(update={"lowest_elevation": lowest})
    return sweep.config.model_copy(update={"log": log})
