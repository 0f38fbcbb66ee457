"""One frame under many configurations."""

from dataclasses import dataclass

import shapely

from gapeval.config import Configuration, Domain, Scoring
from gapeval.detection import detect
from gapeval.detections import Crossing, DetectedFrame, Method
from gapeval.frame import Frame
from gapeval.labels import Labels
from gapeval.scoring.match import LabelScore, score
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


@dataclass(frozen=True, slots=True)
class Answer:
    """One configuration on one frame. fallback: why its plane is not the one asked for, or empty."""

    sums: dict[str, float]
    labels: tuple[LabelScore, ...]
    fallback: str
    gaps: tuple[GapAnswer, ...]


def evaluate(
    frame: Frame, question: Question, labels: Labels | None, robot_frame: str
) -> tuple[list[Answer], dict[str, list[float]]]:
    """The answers in the order of the configurations, and the seconds that each step took each time."""
    memory = Memory()
    asked = None
    if labels is not None and labels.cover(frame.stamp):
        seen = memory(
            view, frame, question.domain, question.origin, question.configurations[0], question.scoring
        )
        asked = memory(scene, frame.stamp, frame.pose, seen, labels, robot_frame, question.scoring)
    margin = common_margin(question.configurations)
    answers = []
    for configuration in question.configurations:
        detection = detect(frame, configuration, memory, margin)
        crossings = by_gap(assess(detection, configuration.robot, configuration.crossing, memory))
        scored = score(asked, detection.gaps, crossings, question.scoring, memory)
        sums = scored.sums | {"plane_fallbacks": int(detection.fallback != "")}
        areas = shapely.area(detection.gaps.polygons).tolist() if question.keep_gaps else []
        gaps = tuple(GapAnswer(area, crossings[index]) for index, area in enumerate(areas))
        answers.append(Answer(sums, scored.labels, detection.fallback, gaps))
    return answers, memory.spent


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


def rescored(frame: DetectedFrame, labels: Labels, robot_frame: str, scoring: Scoring) -> Answer:
    """The answer for one frame of a detections file, which must have a domain."""
    asked = None
    if labels.cover(frame.stamp) and frame.domain is not None:
        hidden = shapely.MultiPolygon() if frame.shadow is None else frame.shadow
        seen = View(frame.plane, frame.domain, hidden, frame.origin)
        asked = scene(frame.stamp, frame.pose, seen, labels, robot_frame, scoring)
    scored = score(asked, frame, frame.crossings, scoring)
    sums = scored.sums | {"plane_fallbacks": int(frame.fallback != "")}
    return Answer(sums, scored.labels, frame.fallback, ())
