"""Run studies for a command: progress over all of them, a line for each, then the claims."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gapeval.cli.reading import open_logs, progress_bar, say, say_newly_refused
from gapeval.config import Config
from gapeval.errors import ConfigError, GapevalError
from gapeval.files import make_folder
from gapeval.logs.read import Recording
from gapeval.report.text import columns, counted
from gapeval.results.parts import locked
from gapeval.simulate.casting import has_embree
from gapeval.simulate.layouts import SCENES
from gapeval.studies.cases import Given, Planned, Recipe, plan_runs
from gapeval.studies.claims import Judged, check_rules, judge
from gapeval.studies.columns import check_columns
from gapeval.studies.definition import NAMES, Study, quickly, read_study
from gapeval.studies.folder import about, write_claims, write_study
from gapeval.studies.frames import Tell
from gapeval.studies.logs import LOGS, make, missing
from gapeval.studies.rows import Row
from gapeval.studies.runs import Recordings, rows_of_run
from gapeval.sweep.executor import on_this_machine, results

if TYPE_CHECKING:
    from tqdm import tqdm


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """A study that is to be run."""

    name: str
    study: Study
    runs: tuple[Planned, ...]


@dataclass(frozen=True, slots=True)
class Told:
    """The logs of which it was said what was refused when they were read: once, however often they are."""

    logs: set[Path]

    def of(self, recording: Recording, refused: Mapping[str, int]) -> None:
        if recording.path not in self.logs:
            self.logs.add(recording.path)
            say_newly_refused(recording, refused)


def list_studies() -> None:
    """The studies of ours."""
    known = [(name, read_study(name)[1]) for name in NAMES]
    click.echo(
        columns(("study", "paper", "question"), [(name, one.paper, one.question) for name, one in known])
    )


def run_studies(
    names: Sequence[str],
    user: Config,
    given: Given | None,
    output: Path,
    quick: bool,
    jobs: int | None,
) -> None:
    """Simulate what is missing, run each study, write its CSV, judge the claims, print them.

    Raises GapevalError when all is done but for studies that failed.
    """
    said = user.model_dump(mode="json", exclude_unset=True)
    if names:
        ready = [_ready(name, said, given, quick) for name in names]
    else:
        ready = _those_that_can_be(said, given, quick)
    varied = {key for one in ready for run in one.runs for key in run.config.grid}
    for key in user.grid:
        if key not in varied:
            say(f"grid.{key}: no study of these varies it; set one value outside of `grid` to have it used")
    if len({one.name for one in ready}) < len(ready):
        raise ConfigError("a study is named twice; name each once")
    if given is not None:
        open_logs([given.log], ready[0].runs[0].config)  # says what was picked, and what is refused
    make_folder(output)
    try:
        with locked(output / LOGS), progress_bar("studies", 0, "clouds") as bar:
            judged, failed = _run(ready, output, jobs or os.cpu_count() or 1, about(said, given, quick), bar)
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt("go on with the same command: what is done stays") from interrupt
    lines = [_line(one) for of_study in judged.values() for one in of_study]
    click.echo(columns(("study", "claim", "verdict", "measured"), lines))
    click.echo(f"\nfiles      in {output}: claims.csv, {', '.join(f'{name}.csv' for name in judged)}")
    if failed:
        raise GapevalError(f"{len(failed)} of {len(ready)} studies failed; the first: {failed[0]}")


def _run(
    ready: Sequence[Ready], output: Path, jobs: int, made_from: Mapping[str, Any], bar: "tqdm[Any]"
) -> tuple[dict[str, list[Judged]], list[str]]:
    """The claims of each study that was done, and why others were not. What is done is written at once."""
    recordings, told = Recordings(output, {}), Told(set())
    lacking = missing([case for one in ready for run in one.runs for case in run.cases], output)
    bar.total = _clouds(ready, lacking, recordings)
    _simulate(lacking, output, jobs, bar)
    judged: dict[str, list[Judged]] = {}
    failed = []
    for one in ready:
        bar.set_description(f"study {one.name}")
        try:
            rows = _rows(one, recordings, output, jobs, bar.update, told.of)
            judged[one.name] = judge(one.name, one.study, rows)
            path = write_study(output, one.name, one.study, rows)
            write_claims(output, made_from, one.name, judged[one.name])
            line = f"{path}: {counted(len(rows), 'row')}"
        except GapevalError as error:
            failed.append(f"study {one.name}: {error}")
            line = failed[-1]
        with bar.external_write_mode():
            say(line)
    return judged, failed


def _those_that_can_be(user: dict[str, Any], given: Given | None, quick: bool) -> list[Ready]:
    """All of ours; of those that cannot be run on a log, it is said why."""
    ready = []
    for name in NAMES:
        try:
            ready.append(_ready(name, user, given, quick))
        except ConfigError as error:
            if given is None:
                raise
            say(f"left out: {error}")
    return ready


def _ready(name: str, user: dict[str, Any], given: Given | None, quick: bool) -> Ready:
    called, study = read_study(name)
    check_columns(called, study)
    check_rules(called, study)
    if quick:
        study = study.model_copy(update={"runs": tuple(map(quickly, study.runs))})
    try:
        return Ready(called, study, plan_runs(called, study, user, given))
    except ConfigError as error:
        about = f"study {called}"
        raise ConfigError(str(error) if str(error).startswith(about) else f"{about}: {error}") from error


def _clouds(ready: Sequence[Ready], lacking: Sequence[Recipe], recordings: Recordings) -> int:
    """How many are to be simulated, and evaluated."""
    return sum(map(_frames, lacking)) + sum(
        _frames(case.source)
        if isinstance(case.source, Recipe)
        else len(recordings.of(case, run.config.log).scans)
        for one in ready
        for run in one.runs
        for case in run.cases
    )


def _frames(recipe: Recipe) -> int:
    return recipe.frames or SCENES[recipe.scene].frames


def _simulate(lacking: Sequence[Recipe], output: Path, jobs: int, bar: "tqdm[Any]") -> None:
    """Logs that are not there, several at a time. Raises GapevalError."""
    if not lacking:
        return
    if not has_embree():
        say("embreex is not installed here: casting rays by trimesh alone, which takes minutes per cloud")
    bar.set_description("simulate")
    workers = on_this_machine(_make, output, min(jobs, len(lacking)))
    with closing(results(workers, lacking)) as finished:
        for one in finished:
            if one.error is not None:
                raise one.error
            bar.update(_frames(one.unit))


def _make(output: Path, recipe: Recipe, stopped: Callable[[], bool]) -> bytes:
    make(recipe, output, stopped)
    return b""


def _rows(
    one: Ready, recordings: Recordings, output: Path, jobs: int, advance: Callable[[int], object], tell: Tell
) -> list[Row]:
    folder = output / one.name
    return [
        row
        for planned in one.runs
        for row in rows_of_run(planned, one.study, recordings, folder, jobs, advance, tell)
    ]


def _line(one: Judged) -> tuple[str, str, str, str]:
    measured = one.measured if len(one.measured) <= 80 else one.measured[:77] + "..."
    return one.study, one.claim, one.verdict, measured
