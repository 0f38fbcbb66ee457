"""The frames of a log, one after the other, for what is measured without a sweep."""

from collections.abc import Callable, Iterator, Mapping

from gapeval.frame import Frame
from gapeval.logs.read import Recording, read_frames

Advance = Callable[[int], object]  # called with the number of frames that are done
Tell = Callable[[Recording, Mapping[str, int]], object]  # what was refused of a log, with reasons


def usable_frames(recording: Recording, advance: Advance, tell: Tell) -> Iterator[Frame]:
    """Those that can be read; of the others it is told how many, and why."""
    refused = dict(recording.refused)
    for item in read_frames(recording, 0, len(recording.scans)):
        if isinstance(item, Frame):
            yield item
        else:
            refused[item.reason] = refused.get(item.reason, 0) + 1
        advance(1)
    tell(recording, refused)
