"""gapeval detect."""

from pathlib import Path

import click

from gapeval.cli.options import PATH, configuration, log_options


@click.command()
@click.argument("log", type=PATH)
@click.option("-o", "--output", type=PATH, required=True, metavar="FILE", help="Detections, GeoJSON.")
@log_options
def detect(log: Path, output: Path, **options: str) -> None:
    """Detect gaps, and where they could be crossed, with one configuration.

    Writes one GeoJSON feature per gap and frame, in the robot frame; `gapeval score` reads it.

    \b
    Example:
      gapeval detect drive.mcap -o detections.geojson --config configs/paper.yaml -p delta_r=1.05
    """
    from gapeval.cli.reading import open_logs, progress_bar, say, say_newly_refused
    from gapeval.results.files import make_folder
    from gapeval.results.to_detections import check_replaceable, detect_log
    from gapeval.sweep.grid import the_one

    config = configuration(**options)  # type: ignore[arg-type]
    the_one(config)  # before anything is read
    check_replaceable(output)
    make_folder(output.parent)
    (recording,) = open_logs([log], config.log)
    with progress_bar("detect", len(recording.scans), "frames") as bar:
        done = detect_log(config, recording, output, bar.update)
    say_newly_refused(recording, done.refused)
    say(f"{output}: {done.gaps} gaps in {done.frames} frames, configuration {done.configuration}")
