"""gapeval sweep."""

from pathlib import Path

import click
from click.core import ParameterSource

from gapeval.cli.options import PATH, configuration, log_options


@click.command()
@click.argument("logs", nargs=-1, type=PATH, metavar="LOG...")
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
@click.option(
    "--executor",
    metavar="URL",
    help="dask://HOST:PORT: the workers of a Dask cluster instead; see docs/cluster.md.",
)
@click.option("--gaps", "with_gaps", is_flag=True, help="Also write gaps.csv: every gap of every frame.")
@click.option(
    "--resume",
    type=PATH,
    metavar="DIR",
    help="Finish the sweep that was begun in this folder; takes no logs, labels or parameters.",
)
@click.option("--fail-fast", is_flag=True, help="Stop at the first failure; nothing that is done is lost.")
@click.pass_context
def sweep(
    context: click.Context,
    /,
    logs: tuple[Path, ...],
    label_files: tuple[Path, ...],
    output: Path,
    jobs: int | None,
    executor: str | None,
    with_gaps: bool,
    resume: Path | None,
    fail_fast: bool,
    **options: str,
) -> None:
    """Evaluate a grid of configurations over all frames of all logs.

    Every combination of the values in the configuration's `grid` section and in -p is evaluated. Without
    labels, gaps and timings only. Writes summary.csv, frames.csv, labels.csv, hits.csv, approaches.csv,
    timing.csv, config.yaml and manifest.json, and parts/, from which the same command goes on where an
    earlier one was stopped.

    \b
    Example:
      gapeval sweep a.mcap b.bag --labels gaps.geojson --config configs/paper.yaml -o results/
      gapeval sweep drive.mcap --labels gaps.geojson -p k=5,6,7 -p delta_r=1.05,1.1,2 --jobs 4
      gapeval sweep --resume results/
    """
    given = [
        parameter.opts[-1] if parameter.param_type_name == "option" else "logs"
        for parameter in context.command.params
        if parameter.name not in ("jobs", "executor", "resume", "fail_fast")
        and context.get_parameter_source(parameter.name or "") == ParameterSource.COMMANDLINE
    ]
    if resume is not None and given:
        raise click.UsageError(f"--resume takes {given[0]} from the sweep that was begun; leave it out.")
    if jobs is not None and executor is not None:
        raise click.UsageError("--jobs is for processes of this machine, --executor for a cluster; give one.")
    if resume is None and not logs:
        raise click.UsageError("Missing argument 'LOG...'.")

    from gapeval.cli.sweeping import Way, resume_sweep, sweep_logs

    way = Way(jobs, fail_fast, executor)
    if resume is not None:
        resume_sweep(resume, way)
    else:
        config = configuration(**options)  # type: ignore[arg-type]
        sweep_logs(config, logs, label_files, output, way, with_gaps)
