"""One frame under many configurations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from gapeval.config import Configuration, Domain, Scoring
from gapeval.detection import Detection, Gaps, detect, detect_each
from gapeval.detection.certainty import weights
from gapeval.detections import METHODS, Crossing, DetectedFrame, Method
from gapeval.frame import FloatArray, Frame, PoseQuality
from gapeval.labels import Labels
from gapeval.scoring.crossings import Verdicts, verdicts_of_one
from gapeval.scoring.label_score import LabelScore
from gapeval.scoring.match import score_each
from gapeval.scoring.metrics import SUMS
from gapeval.scoring.overlap import Outlines, pieces
from gapeval.scoring.scene import AskedLabel, Scene, View, asked_labels, scene, view
from gapeval.share import Share
from gapeval.traversability import Crossings, assess, assess_each, by_gap

# Of all images that are held at a time: about 100 MB with what is worked out from them, whatever the grid.
MOST_CELLS = 1 << 23


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked of every frame.

    domain, origin: see scoring.scene.common_domain. keep_gaps: hand on each gap, for gaps.csv. plane: see
    common_plane.
    """

    configurations: tuple[Configuration, ...]
    scoring: Scoring
    domain: Domain
    origin: str
    keep_gaps: bool = False
    plane: str = "robot"


@dataclass(frozen=True, slots=True)
class GapAnswer:
    """One gap: its area [m2], its crossings by method, and how sure it is, see certainty; None if unknown."""

    area: float
    crossings: dict[Method, Crossing]
    weight: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """One frame under all configurations (C), in their order.

    sums: (C, len(SUMS)), columns in the order of scoring.metrics.SUMS; no scored_frames: it has no labels.
    labels: of each configuration. asked: the labels (A) that were asked for; hits: (C, A) of them.
    fallbacks: why its plane is not the one asked for, or empty. gaps: empty unless asked to keep them.
    quality: of the robot's pose.
    """

    sums: FloatArray
    labels: tuple[tuple[LabelScore, ...], ...]
    fallbacks: tuple[str, ...]
    gaps: tuple[tuple[GapAnswer, ...], ...]
    asked: tuple[AskedLabel, ...]
    hits: NDArray[np.bool_]
    quality: PoseQuality | None = None


def evaluate(
    frame: Frame, question: Question, labels: Labels | None, robot_frame: str
) -> tuple[Answers, dict[str, list[float]]]:
    """The answers in the order of the configurations, and the seconds that each step took each time."""
    share = Share()
    asked = None
    if labels is not None and labels.cover(frame.stamp):
        chosen = question.configurations[0]
        box, origin, kind = question.domain, question.origin, question.plane
        seen = share.timed(view, frame, box, origin, chosen, question.scoring, kind)
        asked = share.timed(scene, frame.stamp, frame.pose, seen, labels, robot_frame, question.scoring)
    parts, spent = [], share.spent
    for batch in batches(question.configurations, MOST_CELLS):
        share = Share()
        parts.append(evaluate_together(frame, batch, asked, question, share))
        for step, seconds in share.spent.items():
            spent.setdefault(step, []).extend(seconds)
    return joined(parts), spent


def batches(configurations: Sequence[Configuration], most: int) -> Iterator[tuple[Configuration, ...]]:
    """Runs of configurations whose images have at most so many cells together, or that are one alone."""
    batch: list[Configuration] = []
    held = 0
    for configuration in configurations:
        cells = configuration.detector.height * configuration.detector.width
        if batch and held + cells > most:
            yield tuple(batch)
            batch, held = [], 0
        batch.append(configuration)
        held += cells
    if batch:
        yield tuple(batch)


def evaluate_together(
    frame: Frame,
    configurations: Sequence[Configuration],
    asked: Scene | None,
    question: Question,
    share: Share,
) -> Answers:
    """The answers of some of the question's configurations, which share what is equal."""
    detections = detect_each(frame, configurations, share)
    crossings = assess_each(
        [(found, c.robot, c.crossing) for found, c in zip(detections, configurations, strict=True)], share
    )
    gaps = [detection.gaps for detection in detections]
    scores = score_each(asked, gaps, verdicts(crossings), question.scoring, share)
    fallbacks = tuple(detection.fallback for detection in detections)
    kept: tuple[tuple[GapAnswer, ...], ...] = ((),) * len(gaps)
    if question.keep_gaps:
        kept = tuple(
            _kept(of, by_gap(crossings.of(index)), weights(of.polygons, frame.quality, c.detector.pl_th))
            for index, (of, c) in enumerate(zip(gaps, configurations, strict=True))
        )
    return Answers(
        with_fallbacks(scores.sums, fallbacks),
        scores.labels,
        fallbacks,
        kept,
        () if asked is None else asked_labels(asked),
        scores.hits,
        frame.quality,
    )


def joined(parts: Sequence[Answers]) -> Answers:
    """The answers of all batches, one after the other."""
    return Answers(
        np.concatenate([part.sums for part in parts]),
        tuple(labels for part in parts for labels in part.labels),
        tuple(fallback for part in parts for fallback in part.fallbacks),
        tuple(gaps for part in parts for gaps in part.gaps),
        parts[0].asked,
        np.concatenate([part.hits for part in parts]),
        parts[0].quality,
    )


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


def _kept(
    gaps: Gaps, crossings: Sequence[dict[Method, Crossing]], weights: Sequence[float | None]
) -> tuple[GapAnswer, ...]:
    return tuple(map(GapAnswer, shapely.area(gaps.polygons).tolist(), crossings, weights))


def detected(frame: Frame, configuration: Configuration, question: Question) -> DetectedFrame:
    """One frame under one configuration, as the detections format holds it."""
    return described(frame, detect(frame, configuration), configuration, question)


def described(
    frame: Frame, detection: Detection, configuration: Configuration, question: Question
) -> DetectedFrame:
    """What was detected in a frame, as the detections format holds it."""
    crossings = by_gap(assess(detection, configuration.robot, configuration.crossing))
    box, origin, kind = question.domain, question.origin, question.plane
    seen = view(frame, box, origin, configuration, question.scoring, kind)
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
        quality=frame.quality,
        weights=weights(detection.gaps.polygons, frame.quality, configuration.detector.pl_th),
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
    return Answers(
        with_fallbacks(scores.sums, fallbacks),
        scores.labels,
        fallbacks,
        ((),),
        () if asked is None else asked_labels(asked),
        scores.hits,
        frame.quality,
    )
