"""Ray casting: which triangle a ray hits first, how far away, and at what angle."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gapeval.errors import GapevalError
from gapeval.frame import FloatArray

AT_ONCE = 1 << 18  # rays; bounds memory
AT_ONCE_SLOWLY = 1 << 9  # trimesh's own caster takes every triangle near a ray's path into memory


@dataclass(frozen=True, slots=True, eq=False)
class Caster:
    """Triangles, ready to be hit. normals: (T, 3), of unit length; offsets: (T,) of their planes [m]."""

    first_hit: Any  # trimesh's, by embree where there is a wheel of it
    at_once: int
    normals: FloatArray
    offsets: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """What rays hit.

    distance: (N,) [m], inf where nothing; grazing: (N,) sine of the angle between ray and surface.
    """

    distance: FloatArray
    grazing: FloatArray

    def shaped(self, shape: tuple[int, ...]) -> Self:
        """The same, as rows and columns of a sensor."""
        return type(self)(self.distance.reshape(shape), self.grazing.reshape(shape))


def has_embree() -> bool:
    """Whether rays are cast fast. Raises GapevalError if they cannot be cast at all."""
    return bool(_trimesh().ray.has_embree)


def caster(triangles: FloatArray) -> Caster:
    """For triangles (T, 3, 3). Raises GapevalError without the extra that casts rays."""
    trimesh = _trimesh()
    mesh = trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False, validate=False
    )
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Caster(
        mesh.ray.intersects_first,
        AT_ONCE if trimesh.ray.has_embree else AT_ONCE_SLOWLY,
        normal,
        (normal * triangles[:, 0]).sum(axis=1),
    )


def cast(scene: Caster, origin: FloatArray, directions: FloatArray) -> Hits:
    """Rays in directions (N, 3) of unit length, from one origin (3,) or each from its own (N, 3).

    The triangle is found in float32, the distance to its plane in float64.
    """
    distance, grazing = np.full(len(directions), np.inf), np.ones(len(directions))
    for first in range(0, len(directions), scene.at_once):
        part = slice(first, first + scene.at_once)
        rays, start = directions[part], origin if origin.ndim == 1 else origin[part]
        index: NDArray[np.intp] = scene.first_hit(np.broadcast_to(start, rays.shape), rays)
        hit, normals = index >= 0, scene.normals[index]
        towards = (normals * rays).sum(axis=1)
        height = normals @ start if start.ndim == 1 else (normals * start).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            away = (scene.offsets[index] - height) / towards
        distance[part] = np.where(hit, away, np.inf)
        grazing[part] = np.where(hit, np.abs(towards), 1.0)
    return Hits(distance, grazing)


def nearer(one: Hits, other: Hits) -> Hits:
    """Of two hits of each ray, the first."""
    closer = one.distance <= other.distance
    return Hits(np.where(closer, one.distance, other.distance), np.where(closer, one.grazing, other.grazing))


def _trimesh() -> Any:
    try:
        import trimesh
    except ImportError as error:
        raise GapevalError(
            "simulating needs trimesh and embreex, which are not installed: pip install 'gapeval[simulate]'"
        ) from error
    return trimesh
