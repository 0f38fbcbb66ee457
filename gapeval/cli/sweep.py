"""gapeval sweep."""

import os
from pathlib import Path

import click

from gapeval.cli.options import PATH, configuration, log_options


@click.command()
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG...")
@click.option(
    "--labels",
    "label_files",
    multiple=True,
    type=PATH,
    metavar="FILE",
    help="Labels, GeoJSON: once for all logs, or once per log in their order.",
)
@log_options
@click.option("-o", "--output", type=PATH, default=Path("results"), show_default=True, metavar="DIR")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Worker processes; default: all cores.")
@click.option("--gaps", "with_gaps", is_flag=True, help="Also write gaps.csv: every gap of every frame.")
def sweep(
    logs: tuple[Path, ...],
    label_files: tuple[Path, ...],
    output: Path,
    jobs: int | None,
    with_gaps: bool,
    **options: str,
) -> None:
    """Evaluate a grid of configurations over all frames of all logs.

    Every combination of the values in the configuration's `grid` section and in -p is evaluated. Without
    labels, gaps and timings only. Writes summary.csv, frames.csv, labels.csv, timing.csv, config.yaml and
    manifest.json.

    \b
    Example:
      gapeval sweep a.mcap b.bag --labels gaps.geojson --config configs/paper.yaml -o results/
      gapeval sweep drive.mcap --labels gaps.geojson -p k=5,6,7 -p delta_r=1.05,1.1,2 --jobs 4
    """
    from gapeval.cli.reading import open_logs, progress_bar, say, say_more, say_newly_refused
    from gapeval.labels import read_labels
    from gapeval.report.text import best_table, timing_table
    from gapeval.results.files import make_folder
    from gapeval.results.from_sweep import log_names, plan, unmatched_stamps, write_sweep
    from gapeval.sweep.grid import configurations

    config = configuration(**options)  # type: ignore[arg-type]
    count = len(configurations(config))
    log_names(logs)
    labels = [read_labels(path) for path in label_files]
    make_folder(output)
    planned = plan(config, open_logs(logs, config.log), labels, with_gaps)
    for drawn, missing in unmatched_stamps(planned).items():
        if missing:
            say(f"{drawn.path}: {len(missing)} labelled stamps are no cloud, the first {missing[0]}")
    with progress_bar(f"sweep {count} configurations", planned.frames, "frames") as bar:
        done = write_sweep(planned, output, jobs or os.cpu_count() or 1, bar.update)
        seconds = bar.format_dict["elapsed"]
    for recording, entry in zip(planned.task.recordings, done.logs, strict=True):
        say_newly_refused(recording, entry["refused"])
    say_more(timing_table(done.store))
    refused = sum(sum(entry["refused"].values()) for entry in done.logs)
    click.echo(f"{best_table(done.store)}\n")
    click.echo(
        f"evaluated  {count} configurations on {done.frames} frames of {len(logs)} logs in {seconds:.1f} s "
        f"({count * done.frames / max(seconds, 1e-9):.0f}/s)\n"
        f"refused    {refused} of {sum(entry['clouds'] for entry in done.logs)} clouds\n"
        f"files      in {output}: {', '.join(done.store.names)}"
    )
