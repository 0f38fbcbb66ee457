"""gapeval study."""

from pathlib import Path

import click

from gapeval.cli.options import PATH, config_option, configuration, parameter_option


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME...]")
@click.option("--log", type=PATH, metavar="LOG", help="A log of your own, instead of simulated scenes.")
@click.option("--labels", type=PATH, metavar="FILE", help="Its labels, GeoJSON.")
@config_option
@parameter_option
@click.option("-o", "--output", type=PATH, default=Path("studies"), show_default=True, metavar="DIR")
@click.option("--quick", is_flag=True, help="Fewer scenes, seeds and values: to see that all works.")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Worker processes; default: all cores.")
@click.option("--list", "show_list", is_flag=True, help="Show the studies, and run none.")
def study(
    names: tuple[str, ...],
    log: Path | None,
    labels: Path | None,
    output: Path,
    quick: bool,
    jobs: int | None,
    show_list: bool,
    config_file: Path | None,
    parameters: tuple[str, ...],
) -> None:
    """Run the paper's parameter studies, and judge its claims by them.

    All studies, or those that are named: ours by name, your own as a YAML file (copy one of
    configs/studies/). On simulated scenes, or with --log on a log of your own, as far as a study can be
    run on it. Writes a CSV for each study, claims.csv, and a folder for each study with the result files
    of its sweeps. What is there is not evaluated again: the same command goes on where it was stopped.

    \b
    Example:
      gapeval study --quick
      gapeval study delta_r morphology -o studies/
      gapeval study --log drive.mcap --labels gaps.geojson --config mine.yaml -o studies/
    """
    from gapeval.cli.studying import list_studies, run_studies

    if show_list:
        list_studies()
        return
    if labels is not None and log is None:
        raise click.UsageError("--labels goes with --log.")
    if log is not None and labels is None:
        raise click.UsageError("--log needs --labels: without them no claim can be judged.")
    from gapeval.studies.cases import Given

    user = configuration(config_file, parameters)
    given = Given(log, labels) if log is not None and labels is not None else None
    run_studies(names, user, given, output, quick, jobs)
