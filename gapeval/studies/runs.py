"""The runs of a study over their logs: swept, timed, or their bins measured."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from gapeval.config import BodyBox, LogSection
from gapeval.errors import GapevalError
from gapeval.labels import read_labels
from gapeval.logs.read import Recording, erring, read_recording
from gapeval.results.from_sweep import Outcome, begin, evaluate_missing, plan, reason, write_results
from gapeval.results.part import make_part
from gapeval.results.parts import locked
from gapeval.studies.bins import bin_rows
from gapeval.studies.cases import Case, Planned
from gapeval.studies.definition import Study
from gapeval.studies.frames import Advance, Tell
from gapeval.studies.logs import place
from gapeval.studies.rows import Row, rows_of
from gapeval.studies.tally import read_tables
from gapeval.studies.timing import time_rows
from gapeval.sweep.executor import on_this_machine


@dataclass(slots=True)
class Recordings:
    """Opened logs, each opened once, whatever poses it is then read with."""

    folder: Path
    opened: dict[tuple[Path, str], Recording]

    def of(self, case: Case, settings: LogSection, body: BodyBox | None = None) -> Recording:
        log = place(case, self.folder).log
        key = log, f"{settings.model_dump_json()} {body}"
        if key not in self.opened:
            self.opened[key] = read_recording(log, settings, body=body)
        return erring(self.opened[key], case.settings(settings))


def rows_of_run(
    planned: Planned,
    study: Study,
    recordings: Recordings,
    folder: Path,
    jobs: int,
    advance: Advance,
    tell: Tell,
) -> list[Row]:
    """Do a run, or what is missing of it. folder: of the study. advance: called with frames that are done.

    Raises GapevalError where frames could not be evaluated.
    """
    opened = [recordings.of(case, planned.config.log, planned.config.robot.body) for case in planned.cases]
    if planned.run.kind == "time":
        return time_rows(planned, opened, advance, tell)
    if planned.run.kind == "bins":
        return bin_rows(planned, opened, advance, tell)
    done = sweep(planned, opened, recordings.folder, folder / planned.run.name, jobs, advance)
    for recording, entry in zip(opened, done.logs, strict=True):
        tell(recording, entry["refused"])
    return list(rows_of(planned, study, read_tables(planned, folder / planned.run.name)))


def sweep(
    planned: Planned,
    opened: Sequence[Recording],
    logs: Path,
    folder: Path,
    jobs: int,
    advance: Advance,
) -> Outcome:
    """The result files of a run, as those of any sweep."""
    read = {path: read_labels(path) for path in {place(case, logs).labels for case in planned.cases}}
    labels = [read[place(case, logs).labels] for case in planned.cases]
    names = tuple(case.name for case in planned.cases)
    ready = plan(planned.config, opened, labels, planned.run.gaps, names)
    with locked(folder) as parts:
        begun = begin(ready, parts)
        advance(begun.frames_there)
        task, count = begun.sweep.task, min(jobs, len(begun.there.missing))
        workers = on_this_machine(make_part, task, count)
        with closing(evaluate_missing(begun, workers, advance)) as failures:
            failed = list(failures)
        done = write_results(begun, failed, folder)
    if failed:
        raise GapevalError(f"{folder}: {len(failed)} units failed, the first because {reason(failed[0])}")
    return done
