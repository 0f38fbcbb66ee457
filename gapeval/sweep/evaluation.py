"""One frame under many configurations."""

from dataclasses import dataclass

import numpy as np
import shapely

from gapeval.config import Configuration, Domain, Scoring
from gapeval.detection import detect
from gapeval.detections import Crossing, DetectedFrame, Method
from gapeval.frame import FloatArray, Frame
from gapeval.labels import Labels
from gapeval.scoring.match import FrameScore, LabelScore, score
from gapeval.scoring.metrics import SUMS
from gapeval.scoring.scene import View, scene, view
from gapeval.sweep.grid import common_margin
from gapeval.sweep.memory import Memory
from gapeval.traversability import assess, by_gap


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
    memory = Memory()
    asked = None
    if labels is not None and labels.cover(frame.stamp):
        seen = memory(
            view, frame, question.domain, question.origin, question.configurations[0], question.scoring
        )
        asked = memory(scene, frame.stamp, frame.pose, seen, labels, robot_frame, question.scoring)
    margin = common_margin(question.configurations)
    sums = np.zeros((len(question.configurations), len(SUMS)))
    scores: list[tuple[LabelScore, ...]] = []
    fallbacks: list[str] = []
    gaps: list[tuple[GapAnswer, ...]] = []
    for row, configuration in zip(sums, question.configurations, strict=True):
        detection = detect(frame, configuration, memory, margin)
        crossings = by_gap(assess(detection, configuration.robot, configuration.crossing, memory))
        scored = score(asked, detection.gaps, crossings, question.scoring, memory)
        row[:] = sums_of(scored, detection.fallback)
        areas = shapely.area(detection.gaps.polygons).tolist() if question.keep_gaps else []
        scores.append(scored.labels)
        fallbacks.append(detection.fallback)
        gaps.append(tuple(GapAnswer(area, crossings[index]) for index, area in enumerate(areas)))
    return Answers(sums, tuple(scores), tuple(fallbacks), tuple(gaps)), memory.spent


def sums_of(scored: FrameScore, fallback: str) -> FloatArray:
    """One row of Answers.sums."""
    sums = scored.sums | {"plane_fallbacks": int(fallback != "")}
    return np.array([sums.get(name, 0) for name in SUMS], dtype=np.float64)


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
    scored = score(asked, frame, frame.crossings, scoring)
    sums = sums_of(scored, frame.fallback)[None]
    return Answers(sums, (scored.labels,), (frame.fallback,), ((),))
