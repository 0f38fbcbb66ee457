"""What the tests of logs ask of a recording."""

import pytest

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read import describe, read_frames, read_recording


def line(path, settings=None):
    """The one line that a log is refused with, which `describe` gives as well."""
    settings = settings or LogSection()
    with pytest.raises(LogError) as caught:
        read_recording(path, settings)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}: ")
    assert describe(path, settings).problem == text
    return text.removeprefix(f"{path}: ")


def frames_of(path, settings=None):
    recording = read_recording(path, settings or LogSection())
    return list(read_frames(recording, 0, recording.matched))
