"""One configuration over one log, written as a detections file."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gapeval.config import Config
from gapeval.detections import OPENING, DetectedFrame, write_detections
from gapeval.errors import ConfigError, GapevalError
from gapeval.files import whole_file
from gapeval.frame import Frame
from gapeval.logs.read import Recording, read_frames
from gapeval.results.manifest import LogTally
from gapeval.scoring.scene import common_domain, common_plane
from gapeval.sweep.evaluation import Question, detected
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


def detect_log(config: Config, recording: Recording, output: Path, advance: Callable[[], object]) -> Detected:
    """Raises ConfigError for a grid with a choice, GapevalError if no cloud could be used."""
    one_thread()
    chosen = the_one(config)
    check_replaceable(output)
    box = common_domain([chosen], config.scoring)
    question = Question((chosen,), config.scoring, *box, plane=common_plane([chosen]))
    tally = LogTally(dict(recording.refused))
    header: dict[str, Any] = {
        "frame_id": recording.robot_frame,
        "fixed_frame": recording.fixed_frame,
        "configuration": {"id": chosen.id} | json.loads(chosen.model_dump_json()),
    }

    def frames() -> Iterator[DetectedFrame]:
        for item in read_frames(recording, 0, len(recording.scans)):
            if isinstance(item, Frame):
                tally.add(item.digest, len(item.points) + item.dropped, item.dropped)
                yield detected(item, chosen, question)
            else:
                tally.refuse(str(item))
            advance()
        if tally.frames == 0:
            raise GapevalError(f"{recording.path}: no cloud could be used ({'; '.join(tally.refused)})")
        header["log"] = {"name": recording.path.name, "sha256": tally.identity.hexdigest()}

    with whole_file(output) as file:
        gaps = write_detections(file, header, frames())
    return Detected(chosen.id, tally.frames, gaps, tally.refused)
