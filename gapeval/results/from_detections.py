"""Scores of a detections file, of this program or another, in the same tables as a sweep's."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from gapeval.config import Config, Configuration
from gapeval.detections import DetectedFrame, Detections
from gapeval.errors import ConfigError, DetectionsError, LabelError
from gapeval.frame import Transform
from gapeval.labels import Labels, require_frames
from gapeval.results.manifest import label_entry, manifest
from gapeval.results.store import Store, open_store
from gapeval.results.tables import Point, point
from gapeval.sweep.evaluation import rescored
from gapeval.visibility import domain

FOREIGN = "foreign"  # the configuration of a file that does not say how it was made


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """unmatched: labelled stamps without a frame in the file."""

    sums: dict[str, float]
    unmatched: int


def score_detections(
    detections: Detections, labels: Labels, config: Config, tolerance: int, folder: Path | None
) -> Scored:
    """Score each frame that was labelled; tolerance [ns] between its stamp and a labelled one.

    Raises DetectionsError for a file without domain, ConfigError if none is given for it either.
    """
    require_frames(
        labels,
        detections.robot_frame,
        detections.fixed_frame,
        f"{detections.path} has only",
        "give it `frame_id`, `fixed_frame` and poses",
    )
    if not detections.frames:
        raise DetectionsError(f"{detections.path}: no frames; nothing to score")
    frames, unmatched = at_labelled_stamps(detections.frames, labels, tolerance)
    if labels.stamps and unmatched == len(labels.stamps):
        raise LabelError(
            f"{labels.path}: none of its {unmatched} labelled stamps is a frame of {detections.path}; "
            "use --stamp-tolerance if they are nearly so"
        )
    frames = [with_domain(frame, detections, config) for frame in frames]
    where = filed_under(detections)
    timelines = {detections.log: np.array([frame.stamp for frame in frames], dtype=np.int64)}
    block = config.scoring.block
    with (
        open_store(folder, [where], timelines, block)
        if folder
        else nullcontext(Store({}, [where], timelines, block))
    ) as store:
        for frame in frames:
            answers = rescored(frame, labels, detections.robot_frame, config.scoring)
            store.add(detections.log, frame.stamp, answers, {})
        if folder:
            entry = {
                "log": detections.log,
                "sha256": detections.log_sha256,
                "labels": labels.sha256,
                "detections": detections.path.name,
                "frames": len(frames),
                "repaired": detections.repaired,
                "unmatched_stamps": unmatched,
            }
            text = as_it_was_made(detections, config)
            scoring = config.scoring.model_dump(mode="json")
            made_from = manifest([entry], [label_entry(labels)], 1, scoring)
            store.finish(text, made_from, [detections.log])
        return Scored(store.sums(where), unmatched)


def at_labelled_stamps(
    frames: Sequence[DetectedFrame], labels: Labels, tolerance: int
) -> tuple[list[DetectedFrame], int]:
    """The frames, the nearest to each labelled stamp moved to it, and how many labelled stamps found none."""
    if labels.stamps is None:
        return list(frames), 0
    near = sorted(
        (abs(stamp - frame.stamp), stamp, index)
        for index, frame in enumerate(frames)
        for stamp in labels.stamps
        if abs(stamp - frame.stamp) <= tolerance
    )
    taken: dict[int, int] = {}  # index of a frame -> stamp
    for _, stamp, index in near:
        if index not in taken and stamp not in taken.values():
            taken[index] = stamp
    moved = [replace(frame, stamp=taken.get(index, frame.stamp)) for index, frame in enumerate(frames)]
    return moved, len(labels.stamps) - len(taken)


def with_domain(frame: DetectedFrame, detections: Detections, config: Config) -> DetectedFrame:
    """The frame as it is, or with the box of the options around the robot where it has no domain."""
    if frame.domain is not None:
        return frame
    box = config.scoring.domain
    if box is None:
        raise ConfigError(
            f"{detections.path}: no domain in the file; say where it was looked for gaps, for example "
            "-p 'scoring.domain={x_min: 0.6, r_max: 3}'"
        )
    everywhere = domain(
        box.x_min, box.r_max, (0.0, 0.0), frame.plane, Transform.identity(), -90.0, config.sensor.fov
    )
    return replace(frame, domain=everywhere)


def filed_under(detections: Detections) -> Point:
    """The configuration that a file of ours was made with; `foreign`, without parameters, for others."""
    made_with = configuration_of(detections)
    if made_with is not None:
        return point(made_with)
    given = detections.configuration
    return Point(str(given.get("id", FOREIGN)) if isinstance(given, dict) else FOREIGN, {})


def configuration_of(detections: Detections) -> Configuration | None:
    """What a file of ours was made with; None for others."""
    if not isinstance(detections.configuration, dict):
        return None
    values = {name: value for name, value in detections.configuration.items() if name != "id"}
    try:
        return Configuration.model_validate(values)
    except ValidationError:
        return None


def as_it_was_made(detections: Detections, config: Config) -> str:
    """The effective configuration in YAML: of the file, as far as it says so, and of the scoring."""
    made_with = configuration_of(detections)
    if made_with is None:
        return config.to_yaml(("scoring",))
    parts = {name: getattr(made_with, name) for name in Configuration.model_fields}
    return config.model_copy(update=parts | {"grid": {}}).to_yaml((*parts, "scoring"))
