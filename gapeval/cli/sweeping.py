"""Sweep logs for a command: progress while frames are evaluated, then the best configurations."""

import os
import shlex
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import click

from gapeval.cli.reading import debugging, open_logs, progress_bar, say, say_more, say_newly_refused
from gapeval.config import Config
from gapeval.errors import GapevalError
from gapeval.files import make_folder
from gapeval.labels import read_labels
from gapeval.report.text import best_table, counted, timing_table
from gapeval.results.from_sweep import (
    Begun,
    begin,
    evaluate_missing,
    log_names,
    plan,
    reason,
    unmatched_stamps,
    write_results,
)
from gapeval.results.part import make_part
from gapeval.results.parts import Input, Order, locked, read_order
from gapeval.sweep.cluster import connected, on_cluster, scheduler_address
from gapeval.sweep.executor import Finished, Workers, on_this_machine
from gapeval.sweep.grid import configurations
from gapeval.sweep.units import Unit

AGAIN = "mend that, and run the same command again"


@dataclass(frozen=True, slots=True)
class Way:
    """How a sweep is done, which its results do not depend on.

    jobs: processes, None for all cores. fail_fast: stop at the first unit that fails. executor: where a
    cluster's scheduler is, instead of processes.
    """

    jobs: int | None = None
    fail_fast: bool = False
    executor: str | None = None


def sweep_logs(
    config: Config,
    logs: Sequence[Path],
    label_files: Sequence[Path],
    output: Path,
    way: Way,
    with_gaps: bool = False,
    also: str = "",
) -> None:
    """Evaluate a grid over logs, write its files, print what came out.

    also: a configuration to print though it may not be among the best. Raises GapevalError when all is done
    but for units that failed.
    """
    order = Order(tuple(map(Input, logs)), tuple(map(Input, label_files)), config, with_gaps)
    _sweep(order, output, way, also)


def resume_sweep(output: Path, way: Way) -> None:
    """Do the same as the last sweep into this folder."""
    _sweep(read_order(output), output, way)


def _sweep(order: Order, output: Path, way: Way, also: str = "") -> None:
    logs = [log.path for log in order.logs]
    if way.executor is not None:
        scheduler_address(way.executor)
    grid = counted(len(configurations(order.config)), "configuration")
    log_names(logs)
    labels = [read_labels(drawn.path) for drawn in order.labels]
    make_folder(output)
    planned = plan(order.config, open_logs(logs, order.config), labels, order.gaps)
    for drawn, missing in unmatched_stamps(planned).items():
        if missing:
            say(f"{drawn.path}: {len(missing)} labelled stamps are no cloud, the first {missing[0]}")
    with locked(output) as parts, told_how_to_go_on(output):
        begun = begin(planned, parts)
        now = (*begun.order.logs, *begun.order.labels)
        for before, after in zip((*order.logs, *order.labels), now, strict=True):
            if before.sha256 not in ("", after.sha256):
                say(f"{after.path}: has changed since that sweep began; evaluated again")
        wanted, lacking = begun.evaluations
        if lacking < wanted:
            say(
                f"resuming: {begun.frames_there} of {counted(planned.frames, 'frame')} are there, "
                f"{wanted - lacking} of {wanted} evaluations (frames x configurations)"
            )
        with progress_bar(f"sweep {grid}", planned.frames, "frames") as bar:
            bar.update(begun.frames_there)
            failed = _evaluate(begun, way, bar.update)
            seconds = bar.format_dict["elapsed"]
        if failed and way.fail_fast:
            raise GapevalError(
                f"{_told(failed, begun)}; nothing was merged; mend that, and run the same command again"
            )
        done = write_results(begun, failed, output)
    for recording, entry in zip(planned.task.recordings, done.logs, strict=True):
        say_newly_refused(recording, entry["refused"])
    say_more(timing_table(done.store))
    refused = sum(sum(entry["refused"].values()) for entry in done.logs)
    rate = f" in {seconds:.1f} s ({lacking / max(seconds, 1e-9):.0f}/s)" if lacking else ", all of it before"
    if failed:
        rate = ""
    click.echo(f"{best_table(done.store, also)}\n")
    click.echo(
        f"evaluated  {grid} on {counted(done.frames, 'frame')} of {counted(len(done.logs), 'log')}{rate}\n"
        f"refused    {refused} of {counted(sum(entry['clouds'] for entry in done.logs), 'cloud')}\n"
        f"files      in {output}: {', '.join(done.store.names)}"
    )
    if failed:
        raise GapevalError(f"{_told(failed, begun)}; {AGAIN}")


@contextmanager
def told_how_to_go_on(output: Path) -> Iterator[None]:
    """Ctrl-C with the command that finishes the sweep."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        raise KeyboardInterrupt(
            f"go on with: gapeval sweep --resume {shlex.quote(str(output))}"
        ) from interrupt


def _evaluate(begun: Begun, way: Way, advance: Callable[[int], object]) -> list[Finished[Unit]]:
    """The units that failed."""
    failed = []
    with _workers(begun, way) as workers, closing(evaluate_missing(begun, workers, advance)) as failures:
        for one in failures:
            failed.append(one)
            if debugging():
                say("".join(traceback.format_exception(one.error)))
            if way.fail_fast:
                break
    return failed


@contextmanager
def _workers(begun: Begun, way: Way) -> Iterator[Workers[Unit]]:
    task = begun.sweep.task
    jobs = min(way.jobs or os.cpu_count() or 1, len(begun.there.missing))
    if way.executor is not None and begun.there.missing:
        say(f"connecting to {way.executor}")
        with connected(way.executor) as client:
            yield on_cluster(client, way.executor, make_part, task)
    else:
        yield on_this_machine(make_part, task, jobs)


def _told(failed: Sequence[Finished[Unit]], begun: Begun) -> str:
    frames = counted(sum(len(one.unit.span) for one in failed), "frame")
    return (
        f"{len(failed)} of {counted(len(begun.there.missing), 'unit')} failed, {frames}: "
        f"the first because {reason(failed[0])}"
    )
