"""gapeval demo."""

from pathlib import Path
from typing import Any

import click

from gapeval.cli.options import PATH

# Section 4.2 of the paper has k 6, n_o 1, delta_r 1.1 and Pl_th 0.1, each of which is among these.
GRID: dict[str, list[Any]] = {
    "detector.k": [5, 6, 7, 8],
    "detector.n_o": [0, 1, 2],
    "detector.delta_r": [1.05, 1.1, 1.2, 2.0],
    "detector.pl_th": [0.05, 0.1, 0.15],
}
SENSOR = "lms151"
FRAMES, SEED = 8, 0


@click.command()
@click.option("-o", "--output", type=PATH, default=Path("gapeval-demo"), show_default=True, metavar="DIR")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Worker processes; default: all cores.")
def demo(output: Path, jobs: int | None) -> None:
    """See the whole of gapeval at work, without a log or labels of your own.

    Simulates the paper's tunnel as its robot sees it, sweeps k, n_o, delta_r and Pl_th over it with the
    paper's values among them, and draws a frame.

    \b
    Example:
      gapeval demo
      gapeval demo -o somewhere/
    """
    from gapeval.cli.detecting import detect_gaps
    from gapeval.cli.simulating import simulate_log
    from gapeval.cli.sweeping import Way, sweep_logs
    from gapeval.config import Config

    simulated, log, labels = simulate_log("tunnel", SENSOR, FRAMES, SEED, "mcap", output)
    papers = Config(robot=simulated.sensor.robot)  # all else by default is the paper's
    gaps, picture = output / "detections.geojson", output / "frame.png"
    detect_gaps(papers, log, gaps, picture=picture, labels=labels)
    grid = papers.model_copy(update={"grid": GRID})
    sweep_logs(grid, [log], [labels], output / "results", Way(jobs), also=papers.base.id)
    click.echo(f"paper      configuration {papers.base.id}")
    for what, path in {"log": log, "labels": labels, "gaps": gaps, "picture": picture}.items():
        click.echo(f"{what:<10} {path}")
