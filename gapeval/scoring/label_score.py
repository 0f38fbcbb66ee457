"""Each label of a frame under each configuration: what labels.csv has of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.scoring.crossings import DETAILS
from gapeval.scoring.near_edge import NearEdges
from gapeval.scoring.scene import PlacedLabel, Scene, width


@dataclass(frozen=True, slots=True)
class LabelScore:
    """One label in one frame under one configuration: a row of labels.csv. SI units.

    covered_area to near_edge_missed: None where it was not asked for. From npca_traversable on: of the gap
    that overlaps it best, if it was hit; traversable: the label's own.
    """

    label: str
    state: str
    range: float
    length: float | None
    visible_area: float
    covered_area: float | None
    iou: float | None
    hit: bool | None
    gaps: int | None
    near_edge_median: float | None = None
    near_edge_max: float | None = None
    near_edge_rays: int | None = None
    near_edge_missed: int | None = None
    bearing: float | None = None
    width: float | None = None
    area: float | None = None
    npca_traversable: bool | None = None
    npca_length_error: float | None = None
    npca_yaw_error: float | None = None
    pca_traversable: bool | None = None
    pca_length_error: float | None = None
    pca_yaw_error: float | None = None
    axis_angle: float | None = None
    traversable: bool | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LabelComparison:
    """Sets of gaps (I) against each label that is asked for (A); (I, A) of each.

    covered: area [m2]. iou: the best with any gap. gaps: how many belong to it.
    """

    covered: FloatArray
    iou: FloatArray
    hit: NDArray[np.bool_]
    gaps: FloatArray
    edges: NearEdges


def label_scores(
    scene: Scene, compared: LabelComparison, places: Sequence[int], details: FloatArray
) -> tuple[tuple[LabelScore, ...], ...]:
    """A row for each label of the frame, of each configuration (C).

    places: (C,) of its gaps in the comparison. details: (C, A, len(DETAILS)) of crossings. What is equal is
    the same object.
    """
    placed = [(label.asked, _placed(label)) for label in scene.labels]
    known: dict[tuple[int, bytes], tuple[LabelScore, ...]] = {}
    keys = [(place, told.tobytes()) for place, told in zip(places, details, strict=True)]
    for key, place, told in zip(keys, places, details, strict=True):
        if key not in known:
            known[key] = _rows(placed, compared, place, told)
    return tuple(known[key] for key in keys)


def _rows(
    placed: Sequence[tuple[bool, LabelScore]], compared: LabelComparison, place: int, details: FloatArray
) -> tuple[LabelScore, ...]:
    """placed: whether each label of the frame is asked for, and what is known of it without any gap."""
    edges = compared.edges
    found = zip(
        compared.covered[place].tolist(),
        compared.iou[place].tolist(),
        compared.hit[place].tolist(),
        compared.gaps[place].tolist(),
        edges.median[place].tolist(),
        edges.largest[place].tolist(),
        edges.rays.tolist(),
        edges.missed[place].tolist(),
        details.tolist(),
        strict=True,
    )
    return tuple(_scored(of, *next(found)) if asked else of for asked, of in placed)


def _placed(of: PlacedLabel) -> LabelScore:
    return LabelScore(
        label=of.label.id,
        state=of.state,
        range=of.range,
        length=of.label.length,
        visible_area=of.visible_area,
        covered_area=None,
        iou=None,
        hit=None,
        gaps=None,
        bearing=of.bearing,
        width=width(of.label),
        area=of.area,
        traversable=of.label.traversable,
    )


def _scored(
    of: LabelScore,
    covered: float,
    iou: float,
    hit: bool,
    gaps: float,
    median: float,
    largest: float,
    rays: int,
    missed: int,
    details: Sequence[float],
) -> LabelScore:
    crossing = dict(zip(DETAILS, details, strict=True))
    return replace(
        of,
        covered_area=covered,
        iou=iou,
        hit=hit,
        gaps=int(gaps),
        near_edge_median=_known(median),
        near_edge_max=_known(largest),
        near_edge_rays=rays,
        near_edge_missed=missed,
        npca_traversable=_truth(crossing["npca_traversable"]),
        npca_length_error=_known(crossing["npca_length_error"]),
        npca_yaw_error=_known(crossing["npca_yaw_error"]),
        pca_traversable=_truth(crossing["pca_traversable"]),
        pca_length_error=_known(crossing["pca_length_error"]),
        pca_yaw_error=_known(crossing["pca_yaw_error"]),
        axis_angle=_known(crossing["axis_angle"]),
    )


def _known(value: float) -> float | None:
    return None if value != value else value


def _truth(value: float) -> bool | None:
    return None if value != value else bool(value)
