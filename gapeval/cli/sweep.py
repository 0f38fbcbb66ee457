"""gapeval sweep."""

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
    from gapeval.cli.sweeping import sweep_logs

    config = configuration(**options)  # type: ignore[arg-type]
    sweep_logs(config, logs, label_files, output, jobs, with_gaps)
