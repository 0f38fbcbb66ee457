"""gapeval report."""

from pathlib import Path

import click

from gapeval.cli.options import PATH


@click.command()
@click.argument("folders", nargs=-1, required=True, type=PATH, metavar="DIR...")
@click.option(
    "-o", "--output", type=PATH, metavar="FILE", help="The page; default: report.html, none with --png alone."
)
@click.option("--png", "pictures", type=PATH, metavar="DIR", help="Write the pictures alone, as PNG files.")
def report(folders: tuple[Path, ...], output: Path | None, pictures: Path | None) -> None:
    """Make one HTML page from the folders of sweeps and studies.

    Of a sweep: what was run on what, the recommended configuration and why, the metrics against each
    parameter and over pairs, hit rate against false gaps against time, the worst and the best frames. Of
    studies: the claims and every curve. The page is one file that loads nothing. Pictures of frames need
    the logs where they were; what each configuration takes is measured once and kept in times.csv.

    \b
    Example:
      gapeval report results/
      gapeval report studies/ results/ -o report.html
      gapeval report results/ --png pictures/
    """
    from gapeval.cli.reporting import write_report

    write_report(folders, output, pictures)
