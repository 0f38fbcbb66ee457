"""gapeval labels check, gapeval labels image."""

from pathlib import Path

import click

from gapeval.cli.options import PATH, configuration, log_options


@click.group()
def labels() -> None:
    """Check labels, and make pictures to draw them on."""


@labels.command()
@click.argument("labels", type=PATH)
@click.option("--log", type=PATH, metavar="LOG", help="Also check them against this log's frames and time.")
@log_options
def check(labels: Path, log: Path | None, **options: str) -> None:
    """List every problem of a label file, by feature. Exit status 1 if there is any.

    \b
    Example:
      gapeval labels check gaps.geojson
      gapeval labels check gaps.geojson --log drive.mcap
    """
    from gapeval.cli.reading import open_logs
    from gapeval.errors import LabelError
    from gapeval.labels import check_labels
    from gapeval.report.label_check import problems_in_log

    found, problems = check_labels(labels)
    if log is not None:
        config = configuration(**options)  # type: ignore[arg-type]
        (recording,) = open_logs([log], config)
        problems += problems_in_log(found, recording, config)
    for problem in problems:
        click.echo(problem)
    if problems:
        raise LabelError(f"{labels}: {len(problems)} problems")
    click.echo(f"{labels}: {len(found.labels)} labels, no problem")


@labels.command()
@click.argument("log", type=PATH)
@click.option("-o", "--output", type=PATH, required=True, metavar="DIR")
@click.option(
    "--resolution",
    type=click.FloatRange(min=0.001),
    default=0.05,
    show_default=True,
    metavar="M",
    help="Pixel.",
)
@click.option(
    "--range",
    "reach",
    type=click.FloatRange(min=0.1),
    default=20.0,
    show_default=True,
    metavar="M",
    help="Leave out points that are farther from the robot.",
)
@click.option("--labels", type=PATH, metavar="FILE", help="Draw these labels, violet.")
@click.option("--detections", type=PATH, metavar="FILE", help="Draw these gaps of all frames, blue.")
@log_options
def image(
    log: Path,
    output: Path,
    resolution: float,
    reach: float,
    labels: Path | None,
    detections: Path | None,
    **options: str,
) -> None:
    """Draw a log from above, in its fixed frame, to draw labels on in QGIS.

    Writes LOG.png, a world file (LOG.pgw) and a sidecar (LOG.json: resolution, origin, frame). Colour is
    the lowest height seen in a pixel, from blue (a metre below the ground) to red (a metre above); nothing
    was seen where it is transparent. The robot's way is drawn in black.

    \b
    Example:
      gapeval labels image drive.mcap -o labelling/
      gapeval labels image drive.mcap -o labelling/ --labels gaps.geojson --detections detections.geojson
    """
    from gapeval.cli.reading import open_logs, progress_bar, say
    from gapeval.detections import read_detections
    from gapeval.files import make_folder
    from gapeval.labels import read_labels, require_frames
    from gapeval.report import birdseye

    config = configuration(**options)  # type: ignore[arg-type]
    drawn = read_labels(labels) if labels else None
    found = read_detections(detections) if detections else None
    make_folder(output)
    (recording,) = open_logs([log], config)
    with progress_bar("draw", len(recording.scans), "frames") as bar:
        picture = birdseye.draw_log(recording, config.robot, resolution, reach, bar.update)
    if found:
        birdseye.draw_outlines(picture, birdseye.gap_outlines(found), birdseye.GAP_COLOUR)
    if drawn:
        require_frames(drawn, recording.robot_frame, recording.fixed_frame)
        outlines = birdseye.label_outlines(drawn, picture.frame_id)
        birdseye.draw_outlines(picture, outlines, birdseye.LABEL_COLOUR)
    for path in picture.write(output, log.name):
        say(f"wrote {path}")
