"""A scene as triangles: (T, 3 corners, 3) in the fixed frame [m]."""

from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.simulate.scene import Ground, Hole, Scene, Solid

PITCH = 0.1  # m, of the ground's mesh where the robot goes
FAR = (20.0, 60.0, 150.0)  # m, how far beyond that a coarse mesh goes on
SLIVER = 1e-12  # m2; what clipping leaves and no ray can hit


def static_triangles(scene: Scene) -> FloatArray:
    """All of a scene that stays."""
    return np.concatenate([ground_triangles(scene.ground, scene.holes), solid_triangles(scene.solids)])


def ground_triangles(ground: Ground, holes: tuple[Hole, ...]) -> FloatArray:
    """The ground without its holes, their walls and their floors.

    Triangles that a hole cuts are clipped exactly, so that its rim is its outline.
    """
    whole = _height_field(ground)
    if not holes:
        return whole
    outlines = shapely.union_all([hole.outline for hole in holes])
    flat = np.asarray(shapely.polygons(whole[:, :, :2]), dtype=object)
    cut = shapely.intersects(flat, outlines)
    return np.concatenate(
        [
            whole[~cut],
            _clipped(whole[cut], flat[cut], outlines),
            *(_walls(whole[cut], flat[cut], hole) for hole in holes),
            *(_at_height(triangulated(hole.outline), -hole.depth) for hole in holes),
        ]
    )


def solid_triangles(solids: Iterable[Solid]) -> FloatArray:
    """Sides, top and bottom of prisms."""
    parts = [np.empty((0, 3, 3))]
    for solid in solids:
        caps = triangulated(solid.outline)
        ring = shapely.get_coordinates(solid.outline.exterior)
        low, high = (np.full(len(ring), z) for z in (solid.bottom, solid.top))
        parts += [
            _strip(ring[:-1], ring[1:], high[:-1], high[1:], low[1:]),
            _at_height(caps, solid.top),
            _at_height(caps, solid.bottom),
        ]
    return np.concatenate(parts)


def triangulated(area: shapely.Polygon) -> FloatArray:
    """Triangles (T, 3, 2) that fill a polygon."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    triangles = triangles[shapely.area(triangles) > SLIVER]
    return np.asarray(shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3], dtype=np.float64)


def _height_field(ground: Ground) -> FloatArray:
    """Two triangles for each cell of a grid that is fine where the robot goes."""
    x0, y0, x1, y1 = ground.core
    x, y = _lines(x0, x1), _lines(y0, y1)
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    corners = np.concatenate([places, ground.height(places)[..., None]], axis=-1)
    a, b, c, d = corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]
    return np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)


def _lines(low: float, high: float) -> FloatArray:
    fine = np.linspace(low, high, round((high - low) / PITCH) + 1)
    far = np.array(FAR)
    return np.concatenate([low - far[::-1], fine, high + far])


def _clipped(whole: FloatArray, flat: NDArray[np.object_], outlines: shapely.Geometry) -> FloatArray:
    """What of triangles lies outside the outlines, each piece in the plane of its own."""
    rest = shapely.difference(flat, outlines)
    kept = shapely.area(rest) > SLIVER
    whole, pieces = whole[kept], shapely.constrained_delaunay_triangles(rest[kept])
    pieces, owner = shapely.get_parts(pieces, return_index=True)
    solid = shapely.area(pieces) > SLIVER
    corners = shapely.get_coordinates(pieces[solid]).reshape(-1, 4, 2)[:, :3]
    heights = _heights_on(whole[owner[solid]][:, None], corners)
    return np.concatenate([corners, heights[..., None]], axis=-1)


def _walls(whole: FloatArray, flat: NDArray[np.object_], hole: Hole) -> FloatArray:
    """Upright walls from the rim, as high as the ground there, to the floor."""
    pieces, owner = shapely.get_parts(shapely.intersection(flat, hole.outline.exterior), return_index=True)
    lines = shapely.get_dimensions(pieces) == 1
    places, piece = shapely.get_coordinates(pieces[lines], return_index=True)
    inner = piece[1:] == piece[:-1]
    start, end, source = places[:-1][inner], places[1:][inner], whole[owner[lines][piece[:-1][inner]]]
    floor = np.full(len(start), -hole.depth)
    return _strip(start, end, _heights_on(source, start), _heights_on(source, end), floor)


def _heights_on(triangles: FloatArray, places: FloatArray) -> FloatArray:
    """z (...) of the planes of triangles (..., 3, 3) at places (..., 2)."""
    origin = triangles[..., 0, :]
    normal = np.cross(triangles[..., 1, :] - origin, triangles[..., 2, :] - origin)
    away = places - origin[..., :2]
    slope = (normal[..., :2] * away).sum(axis=-1) / normal[..., 2]
    return np.asarray(origin[..., 2] - slope, dtype=np.float64)


def _strip(
    start: FloatArray, end: FloatArray, start_top: FloatArray, end_top: FloatArray, bottom: FloatArray
) -> FloatArray:
    """Two upright triangles below each segment from start (N, 2) to end (N, 2)."""
    a, b = np.column_stack([start, start_top]), np.column_stack([end, end_top])
    c, d = np.column_stack([end, bottom]), np.column_stack([start, bottom])
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _at_height(triangles: FloatArray, z: float) -> FloatArray:
    return np.concatenate([triangles, np.full((*triangles.shape[:2], 1), z)], axis=-1)
