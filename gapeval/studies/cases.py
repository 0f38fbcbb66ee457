"""The logs of a run: one for each scene, seed and combination of conditions, or the one that a user has."""

import itertools
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from gapeval.config import Config, LogSection, PoseError, PoseNoise, resolved_grid, validation_message
from gapeval.errors import ConfigError
from gapeval.simulate.layouts import ROUGH
from gapeval.simulate.sensors import SENSORS
from gapeval.simulate.simulation import Simulation, simulation
from gapeval.simulate.variation import Variation
from gapeval.studies.definition import OF_NOISE, OF_POSES, OF_SCENES, Run, Study, Value, merged
from gapeval.sweep.grid import configurations

USUAL: dict[str, Value] = {"obstacles": True, "density": 1.0}  # of a log that is taken as it is


@dataclass(frozen=True, slots=True)
class Recipe:
    """All that decides a simulated log."""

    scene: str
    sensor: str
    frames: int | None
    seed: int
    variation: Variation

    @property
    def name(self) -> str:
        """Of its folder."""
        parts = [self.scene, self.sensor, f"seed{self.seed}"]
        parts += [] if self.frames is None else [f"frames{self.frames}"]
        usual = Variation()
        for key in OF_SCENES:
            if (value := getattr(self.variation, key)) != getattr(usual, key):
                parts.append(f"{key}{value:g}" if isinstance(value, float) else f"{key}_{value}".lower())
        return "-".join(parts)

    def simulation(self) -> Simulation:
        return simulation(self.scene, self.sensor, self.frames, self.seed, self.variation)


@dataclass(frozen=True, slots=True)
class Given:
    """A user's own log, and its labels."""

    log: Path
    labels: Path


@dataclass(frozen=True, slots=True)
class Case:
    """A log under conditions. name: in the result files. source: how it is made, or where it is.

    scene: of what its rows are, beside `all`: the scene, or the log's name.
    """

    name: str
    scene: str
    seed: int
    conditions: tuple[tuple[str, Value], ...]
    source: Recipe | Given
    pose_error: PoseError
    pose_noise: PoseNoise

    def settings(self, settings: LogSection) -> LogSection:
        """How it is read."""
        return settings.model_copy(update={"pose_error": self.pose_error, "pose_noise": self.pose_noise})


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A run, settled: its effective configuration and its logs. columns: its conditions' names."""

    run: Run
    config: Config
    cases: tuple[Case, ...]
    columns: tuple[str, ...]


def plan_runs(name: str, study: Study, user: Mapping[str, Any], given: Given | None) -> tuple[Planned, ...]:
    """The runs of a study that can be done. user: what the user's configuration says, which wins.

    Raises ConfigError for one of which no run can be done, or whose grid cannot be.
    """
    runs = tuple(
        Planned(run, config_of(name, study, run, user, given), cases_of(run, given), columns_of(study))
        for run in study.runs
        if given is None or not run.simulated
    )
    if not runs:
        raise ConfigError(f"study {name}: makes sense on simulated scenes only; leave --log out")
    for planned in runs:
        try:
            configurations(planned.config)
        except ConfigError as error:
            raise ConfigError(f"study {name}: {error}; -p sets other values") from error
    return runs


def columns_of(study: Study) -> tuple[str, ...]:
    """The names of all conditions of a study, in their order."""
    named = itertools.chain.from_iterable((*run.conditions, *run.vary) for run in study.runs)
    sensors = ("sensor",) if len({run.sensor for run in study.runs}) > 1 else ()
    return tuple(dict.fromkeys((*sensors, *named)))


def config_of(name: str, study: Study, run: Run, user: Mapping[str, Any], given: Given | None) -> Config:
    """The run's over the user's over the study's; and the robot that carries the sensor.

    Of the user's grid, only what the study varies.
    """
    robot = {} if given else {"robot": SENSORS[run.sensor].robot.model_dump(exclude_defaults=True)}
    values = merged(merged(merged(robot, study.config), user), run.config)
    grid = dict(study.grid if run.grid is None else run.grid)
    own = resolved_grid(grid, f"study {name}, run {run.name}")
    values["grid"] = {key: user.get("grid", {}).get(key, choices) for key, choices in own.items()}
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise ConfigError(f"study {name}, run {run.name}: {validation_message(error)}") from error


def cases_of(run: Run, given: Given | None) -> tuple[Case, ...]:
    """Seeds vary fastest, then scenes, then conditions. A log of the user's is taken as it is."""
    vary = {key: values for key, values in run.vary.items() if given is None or key not in OF_SCENES}
    found = []
    for values in itertools.product(*vary.values()):
        varied = dict(zip(vary, values, strict=True))
        found += [_case(run, varied, *source) for source in _sources(run, given, varied)]
    return tuple(found)


def _sources(
    run: Run, given: Given | None, varied: Mapping[str, Value]
) -> Iterator[tuple[str, int, Recipe | Given]]:
    if given is not None:
        yield given.log.name, 0, given
        return
    values = {
        key: value
        for key, value in varied.items()
        if key in OF_SCENES and (key, value) != ("roughness", ROUGH)
    }
    variation = Variation(**values)  # type: ignore[arg-type]
    for scene in run.scenes:
        for seed in range(run.seeds):
            yield scene, seed, Recipe(scene, run.sensor, run.frames, seed, variation)


def _case(run: Run, varied: Mapping[str, Value], scene: str, seed: int, source: Recipe | Given) -> Case:
    error = {key: varied[key] for key in OF_POSES if key in varied}
    tilt = varied.get("tilt_noise", 0.0)
    # Simulated logs have equal stamps, but shall not have equal errors.
    draws = zlib.crc32(f"{scene} {seed}".encode())
    noise = {"roll": tilt, "pitch": tilt, "height": varied.get("height_noise", 0.0), "seed": draws}
    name = source.name if isinstance(source, Recipe) else source.log.name
    suffix = [f"{key} {varied[key]:g}" for key in (*OF_POSES, *OF_NOISE) if key in varied]
    usual: dict[str, Value] = {key: USUAL[key] for key in run.vary if key in USUAL}
    sensor = run.sensor if isinstance(source, Recipe) else "its own"
    conditions = {"sensor": sensor} | usual | run.conditions | dict(varied)
    return Case(
        ", ".join([name, *suffix]),
        scene,
        seed,
        tuple(conditions.items()),
        source,
        PoseError.model_validate(error),
        PoseNoise.model_validate(noise),
    )
