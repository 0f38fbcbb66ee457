"""One frame under many configurations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from gapeval.config import Configuration, Domain, Scoring
from gapeval.detection import Gaps, detect, detect_each
from gapeval.detections import METHODS, Crossing, DetectedFrame, Method
from gapeval.frame import FloatArray, Frame
from gapeval.labels import Labels
from gapeval.scoring.crossings import Verdicts, verdicts_of_one
from gapeval.scoring.match import LabelScore, score_each
from gapeval.scoring.metrics import SUMS
from gapeval.scoring.overlap import Outlines, pieces
from gapeval.scoring.scene import View, scene, view
from gapeval.share import Share
from gapeval.traversability import Crossings, assess, assess_each, by_gap


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of every frame.

    domain, origin: see scoring.scene.common_domain. keep_gaps: hand on each gap, for gaps.csv.
    """

    configurations: tuple[Configuration, ...]
    scoring: Scoring
    domain: Domain
    origin: str
    keep_gaps: bool = False


@dataclass(frozen=True, slots=True)
class GapAnswer:
    """One gap: its area [m2] and its crossings by method."""

    area: float
    crossings: dict[Method, Crossing]


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """One frame under all configurations (C), in their order.

    sums: (C, len(SUMS)), columns in the order of scoring.metrics.SUMS; no scored_frames: it has no labels.
    labels: of each configuration. fallbacks: why its plane is not the one asked for, or empty.
    gaps: of each configuration; empty unless asked to keep them.
    """

    sums: FloatArray
    labels: tuple[tuple[LabelScore, ...], ...]
    fallbacks: tuple[str, ...]
    gaps: tuple[tuple[GapAnswer, ...], ...]


def evaluate(
    frame: Frame, question: Question, labels: Labels | None, robot_frame: str
) -> tuple[Answers, dict[str, list[float]]]:
    """The answers in the order of the configurations, and the seconds that each step took each time."""
    share, configurations = Share(), question.configurations
    asked = None
    if labels is not None and labels.cover(frame.stamp):
        seen = share(view, frame, question.domain, question.origin, configurations[0], question.scoring)
        asked = share(scene, frame.stamp, frame.pose, seen, labels, robot_frame, question.scoring)
    detections = detect_each(frame, configurations, share)
    crossings = assess_each(
        [(found, c.robot, c.crossing) for found, c in zip(detections, configurations, strict=True)], share
    )
    gaps = [detection.gaps for detection in detections]
    scores = score_each(asked, gaps, verdicts(crossings), question.scoring, share)
    fallbacks = tuple(detection.fallback for detection in detections)
    kept: tuple[tuple[GapAnswer, ...], ...] = ((),) * len(gaps)
    if question.keep_gaps:
        kept = tuple(_kept(of, by_gap(crossings.of(index))) for index, of in enumerate(gaps))
    return Answers(with_fallbacks(scores.sums, fallbacks), scores.labels, fallbacks, kept), share.spent


def verdicts(crossings: Crossings) -> dict[Method, Verdicts]:
    """What is scored of crossings, by method."""
    found: dict[Method, Verdicts] = {}
    for index, method in enumerate(METHODS):
        of = np.flatnonzero(crossings.method == index)
        found[method] = Verdicts(
            crossings.detection[of],
            crossings.gap[of],
            np.asarray(crossings.reason[of] == "", dtype=np.bool_),
            crossings.length[of],
            crossings.yaw[of],
        )
    return found


def with_fallbacks(sums: FloatArray, fallbacks: Sequence[str]) -> FloatArray:
    """Sums (C, len(SUMS)) that also count the planes that are not those asked for."""
    counted = sums.copy()
    counted[:, list(SUMS).index("plane_fallbacks")] = [fallback != "" for fallback in fallbacks]
    return counted


def _kept(gaps: Gaps, crossings: Sequence[dict[Method, Crossing]]) -> tuple[GapAnswer, ...]:
    return tuple(map(GapAnswer, shapely.area(gaps.polygons).tolist(), crossings))


def detected(frame: Frame, configuration: Configuration, question: Question) -> DetectedFrame:
    """One frame under one configuration, as the detections format holds it."""
    detection = detect(frame, configuration)
    crossings = by_gap(assess(detection, configuration.robot, configuration.crossing))
    seen = view(frame, question.domain, question.origin, configuration, question.scoring)
    return DetectedFrame(
        stamp=frame.stamp,
        pose=frame.pose,
        plane=seen.plane,
        gap_plane=detection.plane,
        domain=seen.domain,
        shadow=seen.shadow,
        origin=seen.origin,
        polygons=detection.gaps.polygons,
        crossings=crossings,
        fallback=detection.fallback,
    )


def rescored(frame: DetectedFrame, labels: Labels, robot_frame: str, scoring: Scoring) -> Answers:
    """The answers, of one configuration, for one frame of a detections file, which must have a domain."""
    asked = None
    if labels.cover(frame.stamp) and frame.domain is not None:
        hidden = shapely.MultiPolygon() if frame.shadow is None else frame.shadow
        seen = View(frame.plane, frame.domain, hidden, frame.origin)
        asked = scene(frame.stamp, frame.pose, seen, labels, robot_frame, scoring)
    known = {method: verdicts_of_one(method, frame.crossings) for method in METHODS}
    outlines = Outlines(frame.polygons, pieces(frame.polygons))
    scores = score_each(asked, [outlines], known, scoring, Share())
    fallbacks = (frame.fallback,)
    return Answers(with_fallbacks(scores.sums, fallbacks), scores.labels, fallbacks, ((),))
