"""Pictures of the frames that were chosen, and the stages of one."""

from collections.abc import Callable, Sequence

import numpy as np

from gapeval.errors import GapevalError
from gapeval.frame import Frame
from gapeval.logs.read import Recording, read_frames
from gapeval.report.exhibit import Photo
from gapeval.report.pictures import Findings, draw_frame, draw_stages, findings, png
from gapeval.report.sweeps.frames import Choice
from gapeval.report.sweeps.logs import Source, Sources
from gapeval.results.written import Row

TITLES = {
    "worst": "Worst frame {}",
    "best": "Best frame",
    "alike": "One frame of all, which are alike",
    "most": "The frame with the most gaps",
}
NAMES = {"worst": "worst-{}", "best": "best", "alike": "frame", "most": "frame"}


def photos(
    choices: Sequence[Choice], sources: Sources, base: Row, source: str, advance: Callable[[int], object]
) -> list[Photo]:
    """A picture of each chosen frame from above, and the stages of the first."""
    made: list[Photo] = []
    for rank, choice in enumerate(choices, 1):
        title = TITLES[choice.kind].format(rank)
        name = NAMES[choice.kind].format(rank)
        rows = f"{source}, row with log = {choice.log}, stamp = {choice.stamp}, "
        rows += f"configuration = {base['configuration']}"
        opened = sources.of(choice.log)
        found, missing = _findings(choice, opened, sources, base)
        about = f"{choice.log}, stamp {choice.stamp}: {choice.why}."
        if opened.unlabelled and found is not None:
            about += f" Drawn {opened.unlabelled}."
        if found is None:
            made.append(Photo(name, title, b"", "", about, rows, missing))
            continue
        alt = f"From above: {about} {len(found.detection.gaps)} gaps were found."
        made.append(Photo(name, title, png(draw_frame(found)), alt, about, rows))
        if rank == 1:
            stages = f"The steps of detection (the paper's Fig. 4) in the frame of {title.lower()}. {about}"
            alt = f"The binary polar image, the image after erosion and dilation, and contours. {about}"
            made.append(Photo("stages", "Step by step", png(draw_stages(found)), alt, stages, rows))
        advance(1)
    return [photo for photo in made if photo.name != "stages"] + [p for p in made if p.name == "stages"]


def _findings(choice: Choice, opened: Source, sources: Sources, base: Row) -> tuple[Findings | None, str]:
    """All that a picture shows, or why there is none."""
    recording = opened.recording
    if recording is None:
        return None, opened.missing
    try:
        frame, place = _frame(recording, choice.stamp)
        configuration = sources.configurations[base["configuration"]]
        return findings(choice.log, place, frame, configuration, opened.labels, recording.robot_frame), ""
    except GapevalError as error:
        return None, str(error)


def _frame(recording: Recording, stamp: int) -> tuple[Frame, int]:
    """The frame of this stamp, and its place in the log. Raises GapevalError."""
    places = np.flatnonzero(recording.scans.stamps == stamp).tolist()
    for place in places:
        for item in read_frames(recording, place, place + 1):
            if isinstance(item, Frame):
                return item, place
    raise GapevalError(f"{recording.path}: no cloud with the stamp {stamp} that can be used")
