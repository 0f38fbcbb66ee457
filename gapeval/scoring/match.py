"""The gaps of one frame against its labels: who belongs to whom, what was hit, what is false."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Scoring
from gapeval.detections import METHODS, Method
from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray, distinct, sums
from gapeval.scoring.crossings import (
    CrossingsOf,
    Verdicts,
    count_gaps,
    judge_crossings,
    verdicts_of_one,
)
from gapeval.scoring.label_score import LabelComparison, LabelScore, label_scores
from gapeval.scoring.metrics import SUMS, WITHOUT_LABELS
from gapeval.scoring.near_edge import near_edges
from gapeval.scoring.overlap import (
    Outlined,
    Outlines,
    Overlaps,
    area_within,
    areas_within,
    outside_labels,
    overlap,
    pieces,
)
from gapeval.scoring.scene import Polygons, Scene
from gapeval.share import Share


@dataclass(frozen=True, slots=True)
class FrameScore:
    """What one frame adds to the sums of its configuration, and its labels one by one."""

    sums: dict[str, float]
    labels: tuple[LabelScore, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Scores:
    """What a frame adds under each configuration (C). sums: (C, len(SUMS)), in the order of SUMS.

    hits: (C, A), of the labels that are asked for.
    """

    sums: FloatArray
    labels: tuple[tuple[LabelScore, ...], ...]
    hits: NDArray[np.bool_]


def score(scene: Scene | None, polygons: Polygons, crossings: CrossingsOf, rules: Scoring) -> FrameScore:
    """Score the gaps of one frame and their crossings against its labels; see docs/scoring.md.

    scene: None for a frame that was not labelled: then only what needs no label is counted.
    """
    known = {method: verdicts_of_one(method, crossings) for method in METHODS}
    found = score_each(scene, [Outlines(polygons, pieces(polygons))], known, rules, Share())
    added = dict(zip(SUMS, found.sums[0].tolist(), strict=True))
    names = WITHOUT_LABELS if scene is None else SUMS
    return FrameScore({name: added[name] for name in names}, found.labels[0])


def score_each(
    scene: Scene | None,
    outlines: Sequence[Outlined],
    verdicts: Mapping[Method, Verdicts],
    rules: Scoring,
    share: Share,
) -> Scores:
    """The same for many sets of gaps in one frame; equal outlines are compared once."""
    place: dict[Outlined, int] = {}
    places = [place.setdefault(outlined, len(place)) for outlined in outlines]
    columns = count_gaps([len(outlined.polygons) for outlined in outlines], verdicts)
    labels: tuple[tuple[LabelScore, ...], ...] = ((),) * len(outlines)
    hits = np.zeros((len(outlines), 0), dtype=np.bool_)
    if scene is not None:
        compared = share.timed(compare, scene, list(place), rules)
        columns |= {name: values[places] for name, values in compared.sums.items()}
        judged, details = judge_crossings(compared.best[places], scene, verdicts)
        columns |= judged
        labels = share.timed(label_scores, scene, compared.labels, places, details)
        hits = compared.labels.hit[places]
    nothing = np.zeros(len(outlines))
    return Scores(np.column_stack([columns.get(name, nothing) for name in SUMS]), labels, hits)


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Sets of gaps (I) against labels (A), without their crossings.

    sums: (I,) of each. best: (I, A), the gap that overlaps a label best that was hit, else -1.
    """

    sums: dict[str, FloatArray]
    labels: LabelComparison
    best: IndexArray


def compare(scene: Scene, outlines: Sequence[Outlined], rules: Scoring) -> Comparison:
    """Hits, matches, false gaps and areas of each set of gaps."""
    polygons, which = distinct([outlined.polygons for outlined in outlines])
    overlaps = overlap(scene, polygons, rules.belongs)
    number, asked = len(outlines), scene.asked
    # Every gap of every set: whose it is, and which of the distinct gaps.
    owner = np.repeat(np.arange(number), [len(of) for of in which])
    gap = np.concatenate([np.empty(0, dtype=np.intp), *which])
    belongs = overlaps.belongs[gap]
    paired = belongs.any(axis=1)
    matched, label = match_each(overlaps.iou[gap], owner, [label.label.id for label in asked], rules.iou).T
    false, ignored, not_counted = sort_unmatched(overlaps, gap, paired, matched)
    covered, over, over_paired = covered_areas(scene, outlines, overlaps, owner, gap)
    edges = near_edges(scene, overlaps.parts, overlaps.belongs, owner, gap, number)
    areas = np.array([label.visible_area for label in asked])
    hit = covered >= rules.hit_coverage * areas
    best, iou = best_gaps(overlaps.iou[gap], belongs, owner, number)
    pairs, tp = sums(belongs, owner, number), sums(np.ones(len(matched)), owner[matched], number)
    counted = sums(~ignored & ~not_counted, owner, number)
    everywhere = np.ones(number)
    found = {
        "scored_frames": everywhere,
        "empty_frames": everywhere * (len(asked) == 0),
        "asked": everywhere * len(asked),
        "hits": hit.sum(axis=1).astype(np.float64),
        "pairs": pairs.sum(axis=1),
        "pairs_on_hits": (pairs * hit).sum(axis=1),
        "paired_gaps": sums(paired, owner, number),
        "tp": tp,
        "fp": counted - tp,
        "fn": len(asked) - tp,
        "false_gaps": sums(false, owner, number),
        "ignored": sums(ignored, owner, number),
        "not_counted": sums(not_counted, owner, number),
        "iou_sum": sums(overlaps.iou[gap[matched], label], owner[matched], number),
        "label_area": everywhere * sum(areas.tolist(), 0.0),
        "covered_area": np.array([sum(of, 0.0) for of in covered.tolist()]),
        "over_area_sum": over,
        "paired_over_area_sum": over_paired,
        "shadowed_gaps": sums(false & overlaps.shadowed[gap], owner, number),
        "edges": np.isfinite(edges.median).sum(axis=1).astype(np.float64),
        "edge_median_sum": np.nansum(edges.median, axis=1),
        "edge_max_sum": np.nansum(edges.largest, axis=1),
        "edge_rays": everywhere * edges.rays.sum(),
        "edge_rays_missed": edges.missed.sum(axis=1).astype(np.float64),
    }
    return Comparison(found, LabelComparison(covered, iou, hit, pairs, edges), np.where(hit, best, -1))


def sort_unmatched(
    overlaps: Overlaps, gap: IndexArray, paired: NDArray[np.bool_], matched: IndexArray
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Of the gaps (N,) that are not matched: which are false, which ignored, which do not count."""
    unmatched = np.ones(len(gap), dtype=np.bool_)
    unmatched[matched] = False
    not_counted = unmatched & ~paired & overlaps.uncounted[gap]
    ignored = unmatched & ~not_counted & overlaps.ignorable[gap]
    return unmatched & ~paired & ~not_counted & ~ignored, ignored, not_counted


def best_gaps(
    iou: FloatArray, belongs: NDArray[np.bool_], owner: IndexArray, number: int
) -> tuple[IndexArray, FloatArray]:
    """Of each set and label, the gap that belongs to it and overlaps it best, else -1, and the best IoU of
    any gap, (I, A). Of equal ones, the first."""
    first = np.searchsorted(owner, np.arange(number + 1))
    best, largest = np.full((number, iou.shape[1]), -1), np.zeros((number, iou.shape[1]))
    if iou.shape[1] == 0:
        return best, largest
    for index in np.flatnonzero(np.diff(first)):
        own = slice(first[index], first[index + 1])
        largest[index] = iou[own].max(axis=0)
        nearest = np.where(belongs[own], iou[own], -1.0).argmax(axis=0)
        best[index] = np.where(belongs[own].any(axis=0), nearest, -1)
    return best, largest


def match_each(iou: FloatArray, owner: IndexArray, label_ids: Sequence[str], threshold: float) -> IndexArray:
    """`match` for many sets of gaps; pairs (gap, label), (P, 2), where gaps count through all sets."""
    gap, label = np.nonzero((iou >= threshold) & (iou > 0))
    competing = np.zeros(owner[-1] + 1 if len(owner) else 0, dtype=np.bool_)
    for taken in (gap, owner[gap] * len(label_ids) + label):
        order = np.argsort(taken, kind="stable")
        competing[owner[gap[order[1:][np.diff(taken[order]) == 0]]]] = True
    alone = ~competing[owner[gap]]
    pairs = list(zip(gap[alone].tolist(), label[alone].tolist(), strict=True))
    for index in np.flatnonzero(competing):
        first, last = np.searchsorted(owner, (index, index + 1)).tolist()
        pairs += [(first + gap, label) for gap, label in match(iou[first:last], label_ids, threshold)]
    return np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)


def match(iou: FloatArray, label_ids: Sequence[str], threshold: float) -> list[tuple[int, int]]:
    """One to one pairs (gap, label) of the largest total IoU over pairs with at least this IoU.

    Of equally good matchings, the one that gives the first label (by id) the first gap, and so on.
    """
    allowed = np.where((iou >= threshold) & (iou > 0), iou, 0.0)
    gaps, labels = np.nonzero(allowed)
    if len(set(gaps)) == len(gaps) and len(set(labels)) == len(labels):
        return sorted(zip(gaps.tolist(), labels.tolist(), strict=True))
    from scipy.optimize import linear_sum_assignment

    def best_total(weights: FloatArray) -> float:
        return float(weights[linear_sum_assignment(weights, maximize=True)].sum())

    matched: list[tuple[int, int]] = []
    for label in sorted(set(labels.tolist()), key=lambda index: label_ids[index]):
        best = best_total(allowed)
        for gap in np.flatnonzero(allowed[:, label]).tolist():
            rest = allowed.copy()
            rest[gap, :] = rest[:, label] = 0.0
            if allowed[gap, label] + best_total(rest) >= best - 1e-12:
                matched.append((gap, label))
                allowed = rest
                break
        else:
            allowed[:, label] = 0.0
    return sorted(matched)


def covered_areas(
    scene: Scene, outlines: Sequence[Outlined], overlaps: Overlaps, owner: IndexArray, gap: IndexArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each label that is asked for, the visible area that any gap covers (I, A); of the area found
    outside every label all of it, and what is of gaps that belong to one (I,) [m2]."""
    number = len(outlines)
    covered, over = sums(overlaps.shared[gap], owner, number), sums(overlaps.over[gap], owner, number)
    paired = np.asarray(overlaps.belongs.any(axis=1), dtype=np.bool_)[gap]
    over_paired = sums(overlaps.over[gap] * paired, owner, number)
    for index, outlined in enumerate(outlines):
        if outlined.pieces is not outlined.polygons:
            covered[index], over[index] = _covered(scene, outlined.pieces)
            belonging = outlined.polygons[paired[owner == index]]
            over_paired[index] = _covered(scene, pieces(belonging))[1]
    whole = np.array([label.visible_area for label in scene.asked])
    return np.minimum(covered, whole), over, over_paired  # what adds up to a hair more is rounding


def _covered(scene: Scene, apart: Polygons) -> tuple[FloatArray, float]:
    """What polygons that do not overlap cover of each label, and outside every label [m2]."""
    shared = areas_within(apart, [label.visible for label in scene.asked])
    over = outside_labels(scene, apart, area_within(apart, scene.visible), shared)
    return shared.sum(axis=0), float(over.sum())
