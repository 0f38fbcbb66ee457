"""gapeval score."""

from pathlib import Path

import click

from gapeval.cli.options import PATH, config_option, configuration, parameter_option


@click.command()
@click.argument("detections", type=PATH)
@click.argument("labels", type=PATH)
@click.option("-o", "--output", type=PATH, metavar="DIR", help="Also write CSV files there.")
@config_option
@parameter_option
@click.option(
    "--stamp-tolerance",
    type=click.FloatRange(min=0),
    default=0.0,
    metavar="SECONDS",
    help="How far a frame may be from a labelled stamp; default: 0, equal.",
)
def score(
    detections: Path, labels: Path, output: Path | None, stamp_tolerance: float, **options: str
) -> None:
    """Score detections, of this program or any other that writes the format, against labels.

    docs/detections.md describes the format. The domain in the file is used; a file without one needs
    scoring.domain from --config or -p, then as a box around the robot. Prints every metric, a dash for
    what is undefined.

    \b
    Example:
      gapeval score detections.geojson labels.geojson
      gapeval score theirs.geojson labels.geojson -p 'scoring.domain={x_min: 0.6, r_max: 3}' -o results/
    """
    from gapeval.cli.reading import say
    from gapeval.detections import read_detections
    from gapeval.labels import read_labels
    from gapeval.report.text import metrics_table
    from gapeval.results.from_detections import score_detections

    config = configuration(**options)  # type: ignore[arg-type]
    found, drawn = read_detections(detections), read_labels(labels)
    if config.scoring.domain and any(frame.domain is not None for frame in found.frames):
        say(f"{detections}: its own domain is used, not scoring.domain; that is for detect")
    scored = score_detections(found, drawn, config, round(stamp_tolerance * 1e9), output)
    if found.repaired:
        say(f"{detections}: repaired {found.repaired} invalid polygons")
    if scored.unmatched:
        say(f"{labels}: {scored.unmatched} labelled stamps have no frame in {detections}")
    click.echo(metrics_table(scored.sums))
