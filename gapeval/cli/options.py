"""Options that several commands share, and the configuration that they make."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from gapeval.config import Config

F = TypeVar("F", bound=Callable[..., Any])


class _Path(click.Path):
    """A path that is not empty: that would be the folder that one happens to be in."""

    def convert(self, value: Any, param: click.Parameter | None, context: click.Context | None) -> Any:
        if value == "":
            self.fail("a path cannot be empty", param, context)
        return super().convert(value, param, context)


PATH = _Path(path_type=Path)

config_option = click.option(
    "--config", "config_file", type=PATH, metavar="FILE", help="Configuration in YAML; see configs/."
)
parameter_option = click.option(
    "-p",
    "--parameter",
    "parameters",
    multiple=True,
    metavar="KEY=VALUE[,VALUE...]",
    help="Set a parameter, dotted where its name is not unique; wins over the file. May be repeated.",
)
LOG_OPTIONS = (
    click.option("--cloud-topic", metavar="TOPIC", help="Clouds to read, if there are several topics."),
    click.option("--pose-topic", metavar="TOPIC", help="Odometry or pose topic to use instead of tf."),
    click.option("--robot-frame", metavar="FRAME", help="Frame of the robot; default: base_link."),
    click.option(
        "--fixed-frame", metavar="FRAME", help="Frame that stands still; default: map, odom or world."
    ),
    click.option(
        "--min-matched",
        type=click.FloatRange(0, 1),
        metavar="SHARE",
        help="Fail if a smaller share of the clouds has transforms; default: 0.5.",
    ),
)


def log_options(command: F) -> F:
    """The options that say how a log is read."""
    for option in reversed((config_option, parameter_option, *LOG_OPTIONS)):
        command = option(command)
    return command


def configuration(
    config_file: Path | None,
    parameters: tuple[str, ...],
    cloud_topic: str | None = None,
    pose_topic: str | None = None,
    robot_frame: str | None = None,
    fixed_frame: str | None = None,
    min_matched: float | None = None,
) -> "Config":
    """Explicit options win over -p, -p over the file, the file over defaults."""
    from gapeval.config import load_config

    return load_config(
        config_file,
        parameters,
        log__cloud_topic=cloud_topic,
        log__pose_topic=pose_topic,
        log__robot_frame=robot_frame,
        log__fixed_frame=fixed_frame,
        log__min_matched=min_matched,
    )
