"""Open the logs of a command: progress while they are surveyed, one line on what was picked in each."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from tqdm import tqdm

    from gapeval.config import Config
    from gapeval.logs.read import Recording


def open_logs(paths: Sequence[Path], config: "Config") -> list["Recording"]:
    """Survey each log; what was picked, refused or is worth a notice goes to stderr."""
    from gapeval.logs.read import read_recording

    recordings = []
    for path in paths:
        with progress_bar(f"open {path.name}", 0, "messages") as bar:

            def show(done: int, total: int, bar: "tqdm[Any]" = bar) -> None:
                bar.total = total
                bar.update(done - bar.n)

            recording = read_recording(path, config.log, show, config.robot.body)
        recordings.append(recording)
        frame = f", in {recording.fixed_frame} by {recording.pose_source}" if recording.fixed_frame else ""
        say(
            f"{path}: {recording.matched} of {recording.total} clouds of {recording.cloud_topic}, "
            f"robot {recording.robot_frame}{frame}"
        )
        say_more(
            f"{path}: {recording.container}, sensor {recording.sensor_frame}, "
            f"lowest ray {math.degrees(recording.lowest_elevation):.2f} deg"
        )
        for reason, count in recording.refused.items():
            stamps = ", ".join(str(stamp) for stamp in recording.examples.get(reason, ()))
            say(f"{path}: refused {count}: {reason}" + (f" (stamps {stamps})" if stamps else ""))
        for loss in recording.losses:
            say(f"{path}: lost: {loss}")
        for notice in recording.notices:
            say(f"{path}: {notice}")
        for name in ("pose_error", "pose_noise"):
            if error := getattr(recording, name):
                say(f"{path}: {name} {error}: points are not where they were measured")
    return recordings


def say(line: str) -> None:
    """Everything but results goes to stderr."""
    click.echo(line, err=True)


def say_more(text: str) -> None:
    """Only with --verbose."""
    if click.get_current_context().find_root().obj["verbose"]:
        say(text)


def debugging() -> bool:
    """Whether --debug was given."""
    return bool(click.get_current_context().find_root().obj["debug"])


def say_newly_refused(recording: "Recording", refused: Mapping[str, int]) -> None:
    """What was refused since the recording was opened."""
    for reason, count in refused.items():
        if new := count - recording.refused.get(reason, 0):
            say(f"{recording.path}: refused {new}: {reason}")


@contextmanager
def progress_bar(title: str, total: int, unit: str) -> Iterator["tqdm[Any]"]:
    """A live bar on a terminal; elsewhere a line every half minute."""
    from tqdm import tqdm

    interval = 0.1 if sys.stderr.isatty() else 30.0
    with tqdm(
        total=total or None,
        desc=title,
        unit=f" {unit}",
        leave=not sys.stderr.isatty(),  # in a file, what follows begins a line of its own
        mininterval=interval,
        delay=0.0 if sys.stderr.isatty() else interval,
        dynamic_ncols=True,
    ) as bar:
        yield bar
