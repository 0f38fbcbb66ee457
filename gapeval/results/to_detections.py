"""One configuration over one log, written as a detections file, and as a log to look at."""

import json
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gapeval.config import Config, Scoring
from gapeval.detection import detect
from gapeval.detections import OPENING, DetectedFrame, write_detections
from gapeval.errors import ConfigError, GapevalError
from gapeval.files import whole_file
from gapeval.frame import Frame
from gapeval.labels import Labels
from gapeval.logs.read import Recording, read_frames
from gapeval.logs.write.display import Shown, display, require_display
from gapeval.results.manifest import LogTally
from gapeval.results.to_markers import classified_points, crossing_markers, gap_markers, label_markers
from gapeval.scoring.scene import common_domain, common_plane
from gapeval.sweep.evaluation import Question, described, rescored
from gapeval.sweep.executor import one_thread
from gapeval.sweep.grid import the_one


@dataclass(frozen=True, slots=True)
class Detected:
    """What was written, and why clouds were refused: reason -> clouds."""

    configuration: str
    frames: int
    gaps: int
    refused: dict[str, int]


def check_replaceable(output: Path) -> None:
    """Raises GapevalError rather than replace a log, labels or anything else that is no detections file."""
    if output.is_dir():
        raise GapevalError(f"{output}: is a folder; name a file with -o")
    if output.exists():
        with output.open("rb") as file:
            if not file.read(len(OPENING)).decode("utf-8", "replace").startswith(OPENING):
                raise GapevalError(f"{output}: exists and is no detections file; name another with -o")


def one_frame(recording: Recording, number: int) -> Frame:
    """The cloud at this place among the log's, from 0 in the order of their stamps.

    Raises ConfigError where there is none, GapevalError if it cannot be used.
    """
    count = len(recording.scans)
    if number >= count:
        raise ConfigError(
            f"{recording.path}: no frame {number}: the log has {count}; choose --frame from 0 to {count - 1}"
        )
    (item,) = read_frames(recording, number, number + 1)
    if isinstance(item, Frame):
        return item
    raise GapevalError(
        f"{recording.path}: frame {number} (stamp {item.stamp}): {item}; choose another --frame"
    )


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where what is detected goes: detections (GeoJSON), and a log to look at (MCAP) with these labels in it.

    None for what is not wanted; one of the two is.
    """

    detections: Path | None
    display: Path | None = None
    labels: Labels | None = None

    def check(self) -> None:
        """Raises GapevalError rather than replace what is not of the same kind."""
        if self.detections:
            check_replaceable(self.detections)
        if self.display:
            require_display(self.display)


def detect_log(
    config: Config, recording: Recording, outputs: Outputs, advance: Callable[[], object]
) -> Detected:
    """Raises ConfigError for a grid with a choice, GapevalError if no cloud could be used."""
    one_thread()
    chosen = the_one(config)
    outputs.check()
    box = common_domain([chosen], config.scoring)
    question = Question((chosen,), config.scoring, *box, plane=common_plane([chosen]))
    tally = LogTally(dict(recording.refused))
    header: dict[str, Any] = {
        "frame_id": recording.robot_frame,
        "fixed_frame": recording.fixed_frame,
        "configuration": {"id": chosen.id} | json.loads(chosen.model_dump_json()),
    }

    def frames(show: Callable[[Shown], None] | None) -> Iterator[DetectedFrame]:
        for item in read_frames(recording, 0, len(recording.scans)):
            if isinstance(item, Frame):
                tally.add(item.digest, len(item.points) + item.dropped, item.dropped)
                detection = detect(item, chosen)
                found = described(item, detection, chosen, question)
                if show:
                    for shown in shown_of(found, outputs.labels, recording.robot_frame, config.scoring):
                        show(shown)
                    show(classified_points(item, detection, chosen, recording.robot_frame))
                yield found
            else:
                tally.refuse(str(item))
            advance()
        if tally.frames == 0:
            raise GapevalError(f"{recording.path}: no cloud could be used ({'; '.join(tally.refused)})")
        header["log"] = {"name": recording.path.name, "sha256": tally.identity.hexdigest()}

    with display(outputs.display) if outputs.display else nullcontext() as show:
        if outputs.detections is None:
            gaps = sum(len(frame.polygons) for frame in frames(show))
        else:
            with whole_file(outputs.detections) as file:
                gaps = write_detections(file, header, frames(show))
    return Detected(chosen.id, tally.frames, gaps, tally.refused)


def shown_of(
    found: DetectedFrame, labels: Labels | None, robot_frame: str, scoring: Scoring
) -> Iterator[Shown]:
    """What is drawn of a frame, and of the labels in it, with what they are worth."""
    yield gap_markers(found, robot_frame)
    yield crossing_markers(found, robot_frame)
    if labels is not None:
        (scores,) = rescored(found, labels, robot_frame, scoring).labels
        yield label_markers(found, labels, scores, robot_frame)
