"""gapeval baseline."""

from pathlib import Path

import click

from gapeval.cli.options import PATH


@click.command()
@click.argument("folder", type=PATH, metavar="DIR")
@click.option("-o", "--output", type=PATH, required=True, metavar="FILE", help="The baseline, a CSV file.")
@click.option(
    "--reason",
    metavar="TEXT",
    help="Why it is made; required where it takes the place of another, whose history it goes on.",
)
@click.option(
    "--without-frames",
    is_flag=True,
    help="Leave out frames and labels: smaller, but no comparison can say which of them changed.",
)
def baseline(folder: Path, output: Path, reason: str | None, without_frames: bool) -> None:
    """Keep the figures of a sweep in one file to commit, for gapeval compare.

    The file holds what the figures were made from (version, revision, hashes of logs and labels, scoring)
    and its history: why it was made and renewed, and what each renewal changed.

    \b
    Example:
      gapeval baseline results/ -o baseline.csv
      gapeval baseline results/ -o baseline.csv --reason "n_o 2 after the new laser mount"
    """
    from gapeval.cli.comparing import renew_baseline

    renew_baseline(folder, output, reason, not without_frames)
