"""One thing about a scene or its sensor changed and all else kept, for the studies of parameters."""

from dataclasses import dataclass, replace

import numpy as np

from gapeval.errors import ConfigError
from gapeval.simulate.layouts import ROUGH, ramp
from gapeval.simulate.scene import Ground, Scene, Solid
from gapeval.simulate.sensors import Sensor

LOW = 2.0  # m; walls, posts and a van are higher than any obstacle
ROUGHEST = 0.1  # m; rougher ground would reach down to the floors of gaps
STEEPEST = 45.0  # deg
DENSEST = 100.0  # times the rays; more than fit into memory
SLOPE = "slope"  # the scene that has a ramp


@dataclass(frozen=True, slots=True)
class Variation:
    """What differs from the scene and the sensor as they are; by default nothing.

    roughness: standard deviation of the ground [m], 0 to 0.1; None: 0.01. slope: of the ramp of scene
    `slope` [deg], 0 to 45; None: drawn by the seed. obstacles: whether what is lower than 2 m stands on the
    ground. density: rays, as a multiple up to 100; by the roll step of a rolling sensor, the columns of a
    spinning one.

    Raises ConfigError for what is out of range.
    """

    roughness: float | None = None
    slope: float | None = None
    obstacles: bool = True
    density: float = 1.0

    def __post_init__(self) -> None:
        if self.roughness is not None and not 0 <= self.roughness <= ROUGHEST:
            raise ConfigError(f"roughness {self.roughness:g}: must be from 0 to {ROUGHEST:g} m")
        if self.slope is not None and not 0 <= self.slope <= STEEPEST:
            raise ConfigError(f"slope {self.slope:g}: must be from 0 to {STEEPEST:g} degrees")
        if not 0 < self.density <= DENSEST:
            raise ConfigError(f"density {self.density:g}: must be more than 0 and at most {DENSEST:g}")

    @property
    def about(self) -> dict[str, str | float]:
        """What differs, by name."""
        values: dict[str, str | float] = {}
        if self.roughness is not None and self.roughness != ROUGH:
            values["roughness"] = self.roughness
        if self.slope is not None:
            values["slope"] = self.slope
        if not self.obstacles:
            values["obstacles"] = False
        if self.density != 1.0:
            values["density"] = self.density
        return values


def varied_scene(scene: Scene, name: str, variation: Variation) -> Scene:
    """A scene, laid out already so that no draw depends on what is varied. Raises ConfigError."""
    ground = scene.ground
    if variation.slope is not None:
        if name != SLOPE:
            raise ConfigError(f"slope {variation.slope:g}: scene {name} has no ramp; choose scene {SLOPE}")
        ground = replace(ground, profile=ramp(float(np.deg2rad(variation.slope))))
    if variation.roughness is not None:
        ground = _as_rough(ground, variation.roughness)
    scene = replace(scene, ground=ground)
    if variation.obstacles:
        return scene
    passing = tuple(_high(things) for things in scene.passing)
    return replace(scene, solids=_high(scene.solids), passing=passing)


def varied_sensor(sensor: Sensor, variation: Variation) -> Sensor:
    """A sensor with as many rays as are asked for. Raises ConfigError where too few are left."""
    pattern = sensor.pattern.times(variation.density)
    if variation.density < 1 and 0 in pattern.directions(0.0).shape:
        raise ConfigError(f"density {variation.density:g}: leaves no ray; choose a larger one")
    return replace(sensor, pattern=pattern)


def _as_rough(ground: Ground, deviation: float) -> Ground:
    """The same waves, higher or lower."""
    return replace(ground, waves=ground.waves * [1.0, 1.0, 1.0, deviation / ROUGH])


def _high(solids: tuple[Solid, ...]) -> tuple[Solid, ...]:
    return tuple(solid for solid in solids if solid.top >= LOW)
