"""Sweep logs for a command: progress while frames are evaluated, then the best configurations."""

import os
from collections.abc import Sequence
from pathlib import Path

import click

from gapeval.cli.reading import open_logs, progress_bar, say, say_more, say_newly_refused
from gapeval.config import Config
from gapeval.files import make_folder
from gapeval.labels import read_labels
from gapeval.report.text import best_table, counted, timing_table
from gapeval.results.from_sweep import log_names, plan, unmatched_stamps, write_sweep
from gapeval.sweep.grid import configurations


def sweep_logs(
    config: Config,
    logs: Sequence[Path],
    label_files: Sequence[Path],
    output: Path,
    jobs: int | None,
    with_gaps: bool = False,
    also: str = "",
) -> None:
    """Evaluate a grid over logs, write its files, print what came out.

    jobs: None for all cores. also: a configuration to print though it may not be among the best.
    """
    grid = counted(len(configurations(config)), "configuration")
    log_names(logs)
    labels = [read_labels(path) for path in label_files]
    make_folder(output)
    planned = plan(config, open_logs(logs, config.log), labels, with_gaps)
    for drawn, missing in unmatched_stamps(planned).items():
        if missing:
            say(f"{drawn.path}: {len(missing)} labelled stamps are no cloud, the first {missing[0]}")
    with progress_bar(f"sweep {grid}", planned.frames, "frames") as bar:
        done = write_sweep(planned, output, jobs or os.cpu_count() or 1, bar.update)
        seconds = bar.format_dict["elapsed"]
    for recording, entry in zip(planned.task.recordings, done.logs, strict=True):
        say_newly_refused(recording, entry["refused"])
    say_more(timing_table(done.store))
    refused = sum(sum(entry["refused"].values()) for entry in done.logs)
    evaluated = len(done.store.points) * done.frames
    click.echo(f"{best_table(done.store, also)}\n")
    click.echo(
        f"evaluated  {grid} on {counted(done.frames, 'frame')} of {counted(len(logs), 'log')} "
        f"in {seconds:.1f} s ({evaluated / max(seconds, 1e-9):.0f}/s)\n"
        f"refused    {refused} of {counted(sum(entry['clouds'] for entry in done.logs), 'cloud')}\n"
        f"files      in {output}: {', '.join(done.store.names)}"
    )
