"""gapeval compare."""

from pathlib import Path

import click

from gapeval.cli.options import PATH

FORMATS = ("text", "md", "json", "csv", "junit", "github", "bench")


@click.command()
@click.argument("base", type=PATH)
@click.argument("new", type=PATH)
@click.option(
    "--max-drop",
    "drops",
    multiple=True,
    metavar="METRIC=AMOUNT",
    help="How far a metric may fall, as 0.01 or 1%; default: not at all. May be repeated.",
)
@click.option(
    "--max-rise",
    "rises",
    multiple=True,
    metavar="METRIC=AMOUNT",
    help="The same for metrics of which less is better, and for time and time.STAGE. May be repeated.",
)
@click.option(
    "--config",
    "config_file",
    type=PATH,
    metavar="FILE",
    help="Limits of its section `compare`; those of options win.",
)
@click.option("--format", "form", type=click.Choice(FORMATS), default="text", show_default=True)
@click.option("-o", "--output", type=PATH, metavar="FILE", help="Write there instead of to the terminal.")
@click.pass_context
def compare(
    context: click.Context,
    /,
    base: Path,
    new: Path,
    drops: tuple[str, ...],
    rises: tuple[str, ...],
    config_file: Path | None,
    form: str,
    output: Path | None,
) -> None:
    """Compare results with earlier ones: the regression gate.

    BASE and NEW are folders of results, or their summary.csv; BASE may be a file of gapeval baseline. Rows
    are joined on log and parameters. Any accuracy metric that got worse by more than its limit is a
    regression, and so is a row that is missing or failed in NEW. Times are shown and fail only by a limit.

    Exit status: 0 no regression, 1 error, 2 usage, 3 regression, 4 rows that are not comparable (other
    labels, log contents or scoring). docs/ci.md says what to do with each.

    \b
    Example:
      gapeval compare baseline.csv results/
      gapeval compare old/ new/ --max-drop pq=1% --max-rise fp_per_frame=0.1 --max-rise time=20%
      gapeval compare baseline.csv results/ --format junit -o compare.xml
    """
    from gapeval.cli.comparing import write_comparison

    context.exit(write_comparison(base, new, drops, rises, config_file, form, output))
