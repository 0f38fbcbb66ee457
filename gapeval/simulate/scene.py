"""What a scene is made of: rough ground, holes in it, things on it, and where the robot stops."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.frame import FloatArray

WAVES = 48  # of which roughness is made
WAVELENGTHS = 0.5, 3.0  # m


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Ground in the fixed frame [m]: a profile along x, with roughness upon it.

    profile: (P, 2) x and z, linear in between, level beyond. waves: (W, 4) wave vector kx, ky [rad/m],
    phase [rad], amplitude [m]. core: x0, y0, x1, y1 of where the robot goes and the mesh is fine.
    """

    profile: FloatArray
    waves: FloatArray
    core: tuple[float, float, float, float]

    def level(self, x: FloatArray) -> FloatArray:
        """z (...) of the profile, without roughness, at x (...)."""
        z: FloatArray = np.interp(x, self.profile[:, 0], self.profile[:, 1])
        return z

    def height(self, places: FloatArray) -> FloatArray:
        """z (...) of the ground at places (..., 2)."""
        kx, ky, phase, amplitude = self.waves.T
        waves = np.cos(places[..., :1] * kx + places[..., 1:] * ky + phase) @ amplitude
        return np.asarray(self.level(places[..., 0]) + waves, dtype=np.float64)


def roughness(random: np.random.Generator, deviation: float) -> FloatArray:
    """Waves of half a metre to three metres in all directions; deviation: standard, of the sum [m]."""
    shortest, longest = np.log(WAVELENGTHS).tolist()
    number = 2 * np.pi / np.exp(random.uniform(shortest, longest, WAVES))
    direction, phase = random.uniform(0, 2 * np.pi, (2, WAVES))
    amplitude = np.full(WAVES, deviation * np.sqrt(2 / WAVES))
    return np.column_stack([number * np.cos(direction), number * np.sin(direction), phase, amplitude])


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """A gap in level ground, with upright walls and a floor. outline: fixed frame [m]; depth [m]."""

    id: str
    outline: shapely.Polygon
    depth: float


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A prism. outline: fixed frame [m]; bottom, top: z [m]."""

    outline: shapely.Polygon
    bottom: float
    top: float


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """stops: (N, 3) x, y [m] and yaw [rad] of the robot, fixed frame; a cloud is taken at each.

    passing: who is in the way at each stop and gone at the next, (N,) or empty.
    """

    ground: Ground
    holes: tuple[Hole, ...]
    solids: tuple[Solid, ...]
    stops: FloatArray
    passing: tuple[tuple[Solid, ...], ...] = ()

    def passing_at(self, stop: int) -> tuple[Solid, ...]:
        return self.passing[stop] if self.passing else ()


def block(
    centre: tuple[float, float],
    size: tuple[float, float],
    heights: tuple[float, float],
    yaw: float = 0.0,
) -> Solid:
    """A box: size along and across yaw [m], heights of bottom and top [m]."""
    return Solid(rectangle(centre, size, yaw), *heights)


def column(centre: tuple[float, float], radius: float, top: float) -> Solid:
    """A barrel, a post or a person."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.array(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Solid(shapely.Polygon(ring), 0.0, top)


def rectangle(centre: tuple[float, float], size: tuple[float, float], yaw: float = 0.0) -> shapely.Polygon:
    half = np.array(size) / 2
    return shapely.Polygon(turned(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half, yaw) + centre)


def turned(places: FloatArray, yaw: float) -> NDArray[np.float64]:
    """Places (N, 2) turned about the origin."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(places @ np.array([[c, s], [-s, c]]), dtype=np.float64)
