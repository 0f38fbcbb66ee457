"""gapeval detect."""

from pathlib import Path

import click

from gapeval.cli.options import PATH, configuration, log_options


@click.command()
@click.argument("log", type=PATH)
@click.option("-o", "--output", type=PATH, metavar="FILE", help="Detections, GeoJSON.")
@click.option("--mcap", type=PATH, metavar="FILE", help="Gaps, crossings and points for RViz and Foxglove.")
@click.option("--picture", type=PATH, metavar="FILE", help="Also draw one frame from above, PNG.")
@click.option("--stages", type=PATH, metavar="FILE", help="Also draw its polar image step by step, PNG.")
@click.option(
    "--frame",
    "number",
    type=click.IntRange(min=0),
    metavar="N",
    help="Frame to draw, from 0 in the order of stamps; default: 0.",
)
@click.option("--labels", type=PATH, metavar="FILE", help="Draw these labels too, in --picture and --mcap.")
@log_options
def detect(
    log: Path,
    output: Path | None,
    mcap: Path | None,
    picture: Path | None,
    stages: Path | None,
    number: int | None,
    labels: Path | None,
    **options: str,
) -> None:
    """Detect gaps, and where they could be crossed, with one configuration.

    With -o, writes one GeoJSON feature per gap and frame, in the robot frame; `gapeval score` reads it. With
    --mcap, a log to open beside the original, see detections.md. At least one of the two.

    \b
    Example:
      gapeval detect drive.mcap -o detections.geojson --config configs/paper.yaml -p delta_r=1.05
      gapeval detect drive.mcap -o detections.geojson --picture frame.png --frame 12 --labels gaps.geojson
      gapeval detect drive.mcap -o detections.geojson --stages stages.png --frame 12
      gapeval detect drive.mcap --mcap found.mcap --labels gaps.geojson
    """
    _check_usage(output, mcap, picture, stages, number, labels)
    from gapeval.cli.detecting import detect_gaps

    config = configuration(**options)  # type: ignore[arg-type]
    detect_gaps(config, log, output, mcap, picture, stages, number or 0, labels)


def _check_usage(
    output: Path | None,
    mcap: Path | None,
    picture: Path | None,
    stages: Path | None,
    number: int | None,
    labels: Path | None,
) -> None:
    """Raises UsageError for options without the file that they are of, or a file named twice."""
    if not (output or mcap):
        raise click.UsageError("nothing to write; name -o FILE, --mcap FILE, or both")
    if labels and not (picture or mcap):
        raise click.UsageError("--labels are drawn in --picture FILE or --mcap FILE; name one")
    if number is not None and not (picture or stages):
        raise click.UsageError("--frame is the frame to draw; name --picture FILE or --stages FILE")
    files = [path.resolve() for path in (output, mcap, picture, stages) if path]
    if len(set(files)) < len(files):
        raise click.UsageError("-o, --mcap, --picture and --stages are different files; one is named twice")
