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
    help="Stops, each of a cloud; default: as many as the scene has positions.",
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
    "--roughness",
    type=float,
    metavar="M",
    help="Standard deviation of the ground, 0 to 0.1 m; default: 0.01.",
)
@click.option(
    "--slope",
    type=float,
    metavar="DEG",
    help="Angle of the ramp of scene slope, 0 to 45 degrees; default: by the seed.",
)
@click.option("--without-obstacles", is_flag=True, help="Leave out what stands lower than 2 m.")
@click.option(
    "--density",
    type=float,
    default=1.0,
    show_default=True,
    metavar="N",
    help="So many times the rays: scans of a rolling sensor, columns of a spinning one.",
)
@click.option(
    "--scans",
    is_flag=True,
    help="Write the planar scans of a rolling sensor, and the joint that it rolls about, not clouds.",
)
@click.option(
    "--moving",
    is_flag=True,
    help="Measure while the robot drives: skewed clouds with the time of each point, or scans.",
)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=print_list,
    help="Show scenes and sensors, and exit.",
)
def simulate(
    scene: str,
    output: Path,
    sensor: str,
    container: str,
    frames: int | None,
    seed: int,
    roughness: float | None,
    slope: float | None,
    without_obstacles: bool,
    density: float,
    scans: bool,
    moving: bool,
) -> None:
    """Simulate a log whose gaps are known exactly: clouds, poses and labels.

    Writes the log and labels.geojson. Labels say what can be crossed by the sensor's robot, from geometry
    alone. Same seed, same bytes.

    \b
    Example:
      gapeval simulate --list
      gapeval simulate tunnel -o tunnel/
      gapeval simulate approach --sensor os1-64 --format ros2 --frames 40 --seed 3 -o approach/
      gapeval simulate slope --slope 20 --roughness 0.03 -o slope-20/
      gapeval simulate street --scans --moving -o scans/
      gapeval sweep tunnel/tunnel.mcap --labels tunnel/labels.geojson --config configs/lms151.yaml
    """
    from gapeval.cli.simulating import simulate_log
    from gapeval.simulate.simulation import Taking
    from gapeval.simulate.variation import Variation

    variation = Variation(roughness, slope, not without_obstacles, density)
    simulate_log(scene, sensor, frames, seed, container, output, variation, Taking(scans, moving))
