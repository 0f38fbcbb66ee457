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
    click.option(
        "--cloud-topic",
        "cloud_topics",
        multiple=True,
        metavar="TOPIC",
        help="Clouds to read, if there are several topics; given again: clouds to merge with them.",
    ),
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
    click.option("--start", type=float, metavar="SECONDS", help="Leave out what is earlier in the log."),
    click.option("--end", type=float, metavar="SECONDS", help="Leave out what is later in the log."),
    click.option("--every", type=click.IntRange(min=1), metavar="N", help="Use only every Nth cloud."),
    click.option("--strict", is_flag=True, help="Fail if a part of the log cannot be read."),
)


def log_options(command: F) -> F:
    """The options that say how a log is read."""
    for option in reversed((config_option, parameter_option, *LOG_OPTIONS)):
        command = option(command)
    return command


def configuration(
    config_file: Path | None,
    parameters: tuple[str, ...],
    cloud_topics: tuple[str, ...] = (),
    pose_topic: str | None = None,
    robot_frame: str | None = None,
    fixed_frame: str | None = None,
    min_matched: float | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int | None = None,
    strict: bool = False,
) -> "Config":
    """Explicit options win over -p, -p over the file, the file over defaults."""
    from gapeval.config import load_config

    return load_config(
        config_file,
        parameters,
        log__cloud_topic=cloud_topics[0] if len(cloud_topics) == 1 else None,
        log__cloud_topics=(list(cloud_topics) if len(cloud_topics) > 1 else []) if cloud_topics else None,
        log__pose_topic=pose_topic,
        log__robot_frame=robot_frame,
        log__fixed_frame=fixed_frame,
        log__min_matched=min_matched,
        log__start=start,
        log__end=end,
        log__every=every,
        log__strict=strict or None,
    )
