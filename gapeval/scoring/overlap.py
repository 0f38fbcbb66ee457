"""Areas [m2] that gaps have in common with labels, with what can be seen and with each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.frame import FloatArray
from gapeval.scoring.scene import SLIVER, Polygons, Scene


class Outlined(Protocol):
    """Anything with gap outlines (N,), robot frame xy [m]: a detector's gaps, or those of a file.

    pieces: polygons that cover the same ground, and none of it twice; a file's gaps may overlap.
    """

    @property
    def polygons(self) -> Polygons: ...
    @property
    def pieces(self) -> Polygons: ...


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Outlines without a detector."""

    polygons: Polygons
    pieces: Polygons


def pieces(polygons: Polygons) -> Polygons:
    """The polygons, or one that covers the same ground if any two overlap."""
    together = shapely.union_all(polygons)
    if shapely.area(polygons).sum() - together.area < SLIVER:
        return polygons
    return np.array([together], dtype=object)


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Distinct gaps (M) against the labels that are asked for (A).

    parts: those that count, in the domain and out of shadow; areas: of them [m2]. over: of that, outside
    every label [m2]. shared: area in common with the visible labels [m2]; iou: with them. belongs: to which
    label. uncounted: if it belongs to none, it counts neither way. ignorable: mostly in an `ignore` polygon.
    shadowed: belongs to none, and of its area in the domain more than half lies in shadow.
    """

    parts: Polygons
    areas: FloatArray
    over: FloatArray
    shared: FloatArray
    iou: FloatArray
    belongs: NDArray[np.bool_]
    uncounted: NDArray[np.bool_]
    ignorable: NDArray[np.bool_]
    shadowed: NDArray[np.bool_]


def overlap(scene: Scene, polygons: Polygons, belongs: float) -> Overlaps:
    """Belongs: area(d and g) >= 0.1 min(area d, area g)."""
    parts = parts_within(polygons, scene.visible)
    areas = shapely.area(parts)
    hidden = areas < SLIVER
    visible = [label.visible for label in scene.asked]
    shared = areas_within(polygons, visible)
    label_areas = np.array([float(region.area) for region in visible])
    iou = shared / np.maximum(areas[:, None] + label_areas - shared, SLIVER)
    threshold = belongs * np.minimum(areas[:, None], label_areas)
    belonging = (shared > 0) & (shared >= threshold)
    alone = ~belonging.any(axis=1)
    # One that belongs to no label and lies outside the domain, or touches only labels that are not asked
    # for, counts neither way. One wholly in shadow is false unless it touches a label (Section 4.3).
    outside = np.zeros(len(polygons), dtype=np.bool_)
    outside[hidden] = area_within(polygons[hidden], scene.view.domain) <= SLIVER
    touches_other = _touches_any(polygons, alone, [label.whole for label in scene.labels if not label.asked])
    matters = alone & (hidden | touches_other)
    touches_asked = _touches_any(polygons, matters, [label.whole for label in scene.asked])
    excused = (touches_other & ~touches_asked) | (hidden & (touches_asked | touches_other))
    ignored = np.zeros(len(polygons))
    ignored[hidden] = area_within(polygons[hidden], scene.ignore) / shapely.area(polygons[hidden])
    ignored[~hidden] = area_within(polygons[~hidden], scene.visible_ignore) / areas[~hidden]
    shadowed = alone & (areas < 0.5 * shapely.area(polygons))
    shadowed[shadowed] = areas[shadowed] < 0.5 * area_within(polygons[shadowed], scene.view.domain) - SLIVER
    return Overlaps(
        parts,
        areas,
        outside_labels(scene, polygons, areas, shared),
        shared,
        iou,
        belonging,
        outside | excused,
        ignored > 0.5,
        shadowed,
    )


def outside_labels(scene: Scene, polygons: Polygons, areas: FloatArray, shared: FloatArray) -> FloatArray:
    """Of the visible areas of polygons, what lies outside every label [m2], (M,).

    shared: (M, A), what lies in labels that are asked for.
    """
    over: FloatArray = areas - shared.sum(axis=1) - area_within(polygons, scene.otherwise_labelled)
    over[over < SLIVER] = 0.0
    return over


def _touches_any(
    polygons: Polygons, wanted: NDArray[np.bool_], regions: Sequence[BaseGeometry]
) -> NDArray[np.bool_]:
    """Which of the wanted polygons have an area in common with any region, (M,)."""
    touches = np.zeros(len(polygons), dtype=np.bool_)
    for region in regions:
        touches[wanted] |= area_within(polygons[wanted], region) > SLIVER
    return touches


def area_within(polygons: Polygons, region: BaseGeometry) -> FloatArray:
    """Area [m2] that each polygon has in common with a region, (M,)."""
    areas: FloatArray = shapely.area(parts_within(polygons, region))
    return areas


def parts_within(polygons: Polygons, region: BaseGeometry) -> Polygons:
    """What each polygon has in common with a region, (M,); points and lines may be left in it."""
    parts = np.full(len(polygons), shapely.Polygon(), dtype=object)
    shapely.prepare(region)
    touching = np.flatnonzero(shapely.intersects(region, polygons))
    # What touches nothing else in the region's bounds is cut by them at most: by one side of the sensory box.
    others = shapely.difference(shapely.box(*region.bounds), region) if len(touching) else region
    shapely.prepare(others)
    cut = np.asarray(shapely.intersects(others, polygons[touching]), dtype=np.bool_)
    alone, rest = touching[~cut], touching[cut]
    parts[alone] = shapely.clip_by_rect(polygons[alone], *region.bounds)
    parts[rest] = shapely.intersection(polygons[rest], region)
    return parts


def areas_within(polygons: Polygons, regions: Sequence[BaseGeometry]) -> FloatArray:
    """The same for several regions, without slivers, (M, A)."""
    areas = np.column_stack([np.zeros((len(polygons), 0)), *(area_within(polygons, one) for one in regions)])
    areas[areas < SLIVER] = 0.0
    return areas
