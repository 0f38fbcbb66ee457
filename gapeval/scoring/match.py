"""The gaps of one frame against its labels: who belongs to whom, what was hit, what is false."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from gapeval.config import Scoring
from gapeval.detection import Share, alone
from gapeval.detections import METHODS, Crossing, Method
from gapeval.frame import FloatArray
from gapeval.scoring.metrics import OF_CROSSINGS, WITHOUT_LABELS
from gapeval.scoring.scene import SLIVER, Polygons, Scene, union_of_labels
from gapeval.visibility import areas_only

# Of each gap, what is known of crossing it; empty where nothing is.
CrossingsOf = Sequence[Mapping[Method, Crossing]]


@dataclass(frozen=True, slots=True)
class LabelScore:
    """One label in one frame under one configuration: a row of labels.csv. Areas [m2], lengths [m]."""

    label: str
    state: str
    range: float
    length: float | None
    visible_area: float
    covered_area: float | None
    iou: float | None
    hit: bool | None
    gaps: int | None


@dataclass(frozen=True, slots=True)
class FrameScore:
    """What one frame adds to the sums of its configuration, and its labels one by one."""

    sums: dict[str, float]
    labels: tuple[LabelScore, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Gaps (rows) against the labels that are asked for (columns).

    parts: the gaps' parts that count, in the domain and out of shadow. shared: area in common [m2].
    iou: with the visible labels. belongs: which gap belongs to which label.
    """

    parts: Polygons
    areas: FloatArray
    shared: FloatArray
    iou: FloatArray
    belongs: NDArray[np.bool_]


class Outlined(Protocol):
    """Anything with gap outlines (N,), robot frame xy [m]: a detector's gaps, or those of a file."""

    @property
    def polygons(self) -> Polygons: ...


def score(
    scene: Scene | None, gaps: Outlined, crossings: CrossingsOf, rules: Scoring, share: Share = alone
) -> FrameScore:
    """Score the gaps of one frame and their crossings against its labels; see docs/scoring.md.

    scene: None for a frame that was not labelled: then only what needs no label is counted.
    """
    counted = count_gaps(len(gaps.polygons), crossings)
    if scene is None:
        return FrameScore(counted)
    compared = share(compare, scene, gaps, rules)
    judged = judge_crossings(compared, scene, crossings)
    return FrameScore(counted | compared.sums | judged, compared.labels)


def count_gaps(count: int, crossings: CrossingsOf) -> dict[str, float]:
    """The sums that need no labels: gaps, which can be crossed, and how far npca and pca agree."""
    sums: dict[str, float] = dict.fromkeys(WITHOUT_LABELS, 0)
    sums |= {"frames": 1, "gaps": count}
    for of_gap in crossings:
        for method, crossing in of_gap.items():
            sums[f"traversable_{method}"] += crossing.traversable
        if len(of_gap) == len(METHODS):
            sums["axis_angles"] += 1
            sums["axis_angle_sum"] += axial_angle(of_gap["npca"].yaw, of_gap["pca"].yaw)
    return sums


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Gaps against labels, without their crossings. best: the gap nearest to each label that was hit."""

    sums: dict[str, float]
    labels: tuple[LabelScore, ...]
    best: dict[int, int]


def compare(scene: Scene, gaps: Outlined, rules: Scoring) -> Comparison:
    """Hits, matches, false gaps and areas of one frame."""
    overlaps = overlap(scene, gaps.polygons, rules.belongs)
    matched = match(overlaps.iou, [label.label.id for label in scene.asked], rules.iou)
    unmatched = np.ones(len(gaps.polygons), dtype=np.bool_)
    unmatched[[gap for gap, _ in matched]] = False
    false, ignored, not_counted = sort_unmatched(scene, gaps.polygons, overlaps, unmatched)
    covered = covered_areas(scene, overlaps)
    rows = label_scores(scene, overlaps, covered, rules)
    hit = np.array([row.hit for row in rows if row.hit is not None], dtype=np.bool_)
    counted = len(gaps.polygons) - int(ignored.sum()) - int(not_counted.sum())
    best = np.where(overlaps.belongs, overlaps.iou, -1.0)
    sums: dict[str, float] = {
        "scored_frames": 1,
        "empty_frames": int(len(scene.asked) == 0),
        "asked": len(scene.asked),
        "hits": int(hit.sum()),
        "pairs": int(overlaps.belongs.sum()),
        "pairs_on_hits": int(overlaps.belongs[:, hit].sum()),
        "paired_gaps": int(overlaps.belongs.any(axis=1).sum()),
        "tp": len(matched),
        "fp": counted - len(matched),
        "fn": len(scene.asked) - len(matched),
        "false_gaps": int(false.sum()),
        "ignored": int(ignored.sum()),
        "not_counted": int(not_counted.sum()),
        "iou_sum": sum((float(overlaps.iou[pair]) for pair in matched), 0.0),
        "label_area": sum((float(label.visible.area) for label in scene.asked), 0.0),
        "covered_area": sum(covered, 0.0),
        "over_area_sum": over_area(scene, overlaps),
    }
    return Comparison(
        sums,
        tuple(rows),
        {
            int(label): int(best[:, label].argmax())
            for label in np.flatnonzero(hit & overlaps.belongs.any(axis=0))
        },
    )


def overlap(scene: Scene, polygons: Polygons, belongs: float) -> Overlaps:
    """Belongs: area(d and g) >= 0.1 min(area d, area g)."""
    shapely.prepare(scene.visible)
    parts = polygons.copy()
    cut = ~np.asarray(shapely.covers(scene.visible, polygons), dtype=np.bool_)
    parts[cut] = [areas_only(part) for part in shapely.intersection(polygons[cut], scene.visible)]
    areas = np.asarray(shapely.area(parts), dtype=np.float64)
    visible = np.array([label.visible for label in scene.asked], dtype=object)
    label_areas = np.asarray(shapely.area(visible), dtype=np.float64)
    shared = np.zeros((len(parts), len(visible)))
    if shared.size:
        label, gap = shapely.STRtree(parts).query(visible, predicate="intersects")
        shared[gap, label] = shapely.area(shapely.intersection(parts[gap], visible[label]))
    shared[shared < SLIVER] = 0.0
    iou = shared / np.maximum(areas[:, None] + label_areas - shared, SLIVER)
    threshold = belongs * np.minimum(areas[:, None], label_areas)
    return Overlaps(parts, areas, shared, iou, (shared > 0) & (shared >= threshold))


def sort_unmatched(
    scene: Scene, polygons: Polygons, overlaps: Overlaps, unmatched: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
    """Of the gaps (N,) that are not matched: which are false, which ignored, which do not count.

    One that belongs to no label and lies outside the domain, or touches only labels that are not asked for,
    counts neither way. One wholly in shadow is false unless it touches a label (Section 4.3).
    """
    unpaired = unmatched & ~overlaps.belongs.any(axis=1)
    hidden = overlaps.areas < SLIVER
    in_domain = ~hidden | (_shared(polygons, scene.view.domain, hidden) > SLIVER)
    touches_asked, touches_other = np.zeros(len(polygons), bool), np.zeros(len(polygons), bool)
    for label in scene.labels:
        touched = _shared(polygons, label.whole, unpaired) > SLIVER
        if label.asked:
            touches_asked |= touched
        else:
            touches_other |= touched
    excused = (touches_other & ~touches_asked) | (hidden & (touches_asked | touches_other))
    not_counted = unpaired & (~in_domain | excused)
    judged = np.where(hidden, polygons, overlaps.parts)
    ignorable = unmatched & ~not_counted
    ignored = ignorable & (_shared(judged, scene.ignore, ignorable) > 0.5 * shapely.area(judged))
    return unpaired & ~not_counted & ~ignored, ignored, not_counted


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


def covered_areas(scene: Scene, overlaps: Overlaps) -> list[float]:
    """Of each label that is asked for, the visible area that any gap covers [m2]."""
    covered = []
    for column, label in enumerate(scene.asked):
        touching = overlaps.parts[overlaps.shared[:, column] > 0]
        covered.append(float(shapely.intersection(shapely.union_all(touching), label.visible).area))
    return covered


def label_scores(
    scene: Scene, overlaps: Overlaps, covered: Sequence[float], rules: Scoring
) -> list[LabelScore]:
    """One row per label of the frame; what was not asked for has neither hit nor miss."""
    rows, column = [], 0
    for placed in scene.labels:
        name, length, area = placed.label.id, placed.label.length, float(placed.visible.area)
        if not placed.asked:
            rows.append(LabelScore(name, placed.state, placed.range, length, area, None, None, None, None))
            continue
        belonging = overlaps.belongs[:, column]
        rows.append(
            LabelScore(
                name,
                placed.state,
                placed.range,
                length,
                area,
                covered[column],
                float(overlaps.iou[:, column].max(initial=0.0)),
                covered[column] >= rules.hit_coverage * area,
                int(belonging.sum()),
            )
        )
        column += 1
    return rows


def over_area(scene: Scene, overlaps: Overlaps) -> float:
    """Detected area outside every label [m2]."""
    if len(overlaps.parts) == 0:
        return 0.0
    return float(shapely.difference(shapely.union_all(overlaps.parts), union_of_labels(scene)).area)


def judge_crossings(compared: Comparison, scene: Scene, crossings: CrossingsOf) -> dict[str, float]:
    """What the labels say of the crossing of the gap that overlaps each of them best."""
    sums: dict[str, float] = dict.fromkeys(OF_CROSSINGS, 0)
    for column, gap in compared.best.items():
        placed = scene.asked[column]
        for method, crossing in crossings[gap].items():
            if placed.label.traversable is not None:
                sums[f"{method}_judged"] += 1
                sums[f"{method}_right"] += crossing.traversable == placed.label.traversable
            if placed.label.length is not None:
                sums[f"{method}_lengths"] += 1
                sums[f"{method}_length_error_sum"] += abs(crossing.length - placed.label.length)
            if placed.yaw is not None:
                sums[f"{method}_yaws"] += 1
                sums[f"{method}_yaw_error_sum"] += axial_angle(crossing.yaw, placed.yaw)
    return sums


def axial_angle(one: float, other: float) -> float:
    """Angle between two axes [rad], 0 ... pi/2."""
    difference = abs(one - other) % np.pi
    return float(min(difference, np.pi - difference))


def _shared(polygons: Polygons, region: BaseGeometry, wanted: NDArray[np.bool_]) -> FloatArray:
    """Area [m2] that each wanted polygon shares with a region; 0 for the others."""
    shared = np.zeros(len(polygons))
    touching = wanted & np.asarray(shapely.intersects(polygons, region), dtype=np.bool_)
    shared[touching] = shapely.area(shapely.intersection(polygons[touching], region))
    return shared
