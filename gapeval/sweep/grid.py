"""From a configuration file's grid to its configurations."""

import itertools

from pydantic import ValidationError

from gapeval.config import Config, Configuration, set_parameter, validation_message
from gapeval.errors import ConfigError


def configurations(config: Config) -> tuple[Configuration, ...]:
    """Every combination of the grid's values, in the order of the file, the last key varying fastest.

    Combinations that mean the same (i_height and i_width given, k varied) are one configuration.
    Raises ConfigError for a combination that cannot be.
    """
    base = config.base.model_dump()
    distinct: dict[str, Configuration] = {}
    for values in itertools.product(*config.grid.values()):
        point = base
        for key, value in zip(config.grid, values, strict=True):
            point = set_parameter(point, key, value)
        try:
            configuration = Configuration.model_validate(point)
        except ValidationError as error:
            combination = ", ".join(f"{key}={value}" for key, value in zip(config.grid, values, strict=True))
            raise ConfigError(f"grid ({combination}): {validation_message(error)}") from error
        distinct.setdefault(configuration.id, configuration)
    return tuple(distinct.values())


def the_one(config: Config) -> Configuration:
    """The configuration of a file without choice. Raises ConfigError if its grid has more than one."""
    found = configurations(config)
    if len(found) > 1:
        keys = ", ".join(key.partition(".")[2] for key, values in config.grid.items() if len(values) > 1)
        raise ConfigError(
            f"the grid has {len(found)} configurations; detect runs one: choose {keys} with -p, or use sweep"
        )
    return found[0]
