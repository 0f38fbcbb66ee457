"""Detect gaps for a command: progress while frames are read, one line on each file that was written."""

from pathlib import Path

from gapeval.cli.reading import open_logs, progress_bar, say, say_newly_refused
from gapeval.config import Config, Configuration
from gapeval.files import make_folder, write_whole
from gapeval.labels import Labels, read_labels, require_frames
from gapeval.logs.read import Recording
from gapeval.results.to_detections import Outputs, detect_log, one_frame
from gapeval.sweep.grid import the_one


def detect_gaps(
    config: Config,
    log: Path,
    output: Path | None,
    mcap: Path | None = None,
    picture: Path | None = None,
    stages: Path | None = None,
    number: int = 0,
    labels: Path | None = None,
) -> None:
    """Write the detections of one configuration, and pictures of one frame where they are asked for."""
    chosen = the_one(config)  # before anything is read
    outputs = Outputs(output, mcap, read_labels(labels) if labels else None)
    outputs.check()
    pictures = [path for path in (picture, stages) if path]
    if pictures:  # matplotlib is not imported for less
        from gapeval.report.pictures import check_picture

        for path in pictures:
            check_picture(path)
    written = [path for path in (output, mcap) if path]
    for path in (*written, *pictures):
        make_folder(path.parent)
    (recording,) = open_logs([log], config)
    if outputs.labels:
        require_frames(outputs.labels, recording.robot_frame, recording.fixed_frame)
    contents = _draw(recording, chosen, outputs.labels, number, picture, stages) if pictures else {}
    with progress_bar("detect", len(recording.scans), "frames") as bar:
        done = detect_log(config, recording, outputs, bar.update)
    say_newly_refused(recording, done.refused)
    for path in written:
        say(f"{path}: {done.gaps} gaps in {done.frames} frames, configuration {done.configuration}")
    for path, content in contents.items():
        write_whole(path, content)
        say(f"wrote {path}")


def _draw(
    recording: Recording,
    chosen: Configuration,
    drawn: Labels | None,
    number: int,
    picture: Path | None,
    stages: Path | None,
) -> dict[Path, bytes]:
    """The pictures that are asked for, in memory: what is wrong with them is told before all is detected."""
    from gapeval.report.pictures import draw_frame, draw_stages, findings, png

    frame = one_frame(recording, number)
    found = findings(recording.path.name, number, frame, chosen, drawn, recording.robot_frame)
    asked = {picture: draw_frame, stages: draw_stages}
    return {path: png(draw(found)) for path, draw in asked.items() if path}
