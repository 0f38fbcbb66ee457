"""gapeval simulate."""

from pathlib import Path

import click

from gapeval.cli.options import PATH


def print_list(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    """Every scene and sensor, a line each."""
    if not wanted or context.resilient_parsing:
        return
    from gapeval.report.text import columns
    from gapeval.simulate.layouts import SCENES
    from gapeval.simulate.sensors import SENSORS

    scenes = [(name, f"{layout.frames} frames", layout.about) for name, layout in SCENES.items()]
    click.echo(columns(("scene", "default", "what it is"), scenes))
    click.echo()
    click.echo(columns(("sensor", "what it is"), [(name, s.about) for name, s in SENSORS.items()]))
    context.exit()


@click.command()
@click.argument("scene")
@click.option("-o", "--output", type=PATH, required=True, metavar="DIR")
@click.option(
    "--sensor", default="lms151", show_default=True, metavar="NAME", help="Sensor and its robot; see --list."
)
@click.option(
    "--format",
    "container",
    type=click.Choice(["mcap", "ros1", "ros2"]),
    default="mcap",
    show_default=True,
    help="Kind of log: SCENE.mcap, SCENE.bag, or a folder SCENE.",
)
@click.option(
    "--frames",
    type=click.IntRange(min=1),
    metavar="N",
    help="Clouds; default: as many as the scene has positions.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    metavar="N",
    help="Varies layout and noise, not the character of the scene.",
)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=print_list,
    help="Show scenes and sensors, and exit.",
)
def simulate(scene: str, output: Path, sensor: str, container: str, frames: int | None, seed: int) -> None:
    """Simulate a log whose gaps are known exactly: clouds, poses and labels.

    Writes the log and labels.geojson. Labels say what can be crossed by the sensor's robot, from geometry
    alone. Same seed, same bytes.

    \b
    Example:
      gapeval simulate --list
      gapeval simulate tunnel -o tunnel/
      gapeval simulate approach --sensor os1-64 --format ros2 --frames 40 --seed 3 -o approach/
      gapeval sweep tunnel/tunnel.mcap --labels tunnel/labels.geojson --config configs/lms151.yaml
    """
    from gapeval.cli.simulating import simulate_log

    simulate_log(scene, sensor, frames, seed, container, output)
