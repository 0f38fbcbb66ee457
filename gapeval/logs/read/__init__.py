"""Recorded logs -> frames."""

from gapeval.logs.read.assembly import erring, lowest_elevations, read_recording
from gapeval.logs.read.containers.opening import is_costly_to_open
from gapeval.logs.read.description import Description, describe
from gapeval.logs.read.description_text import render
from gapeval.logs.read.playback import LOST, read_frames
from gapeval.logs.read.recording import Recording, RefusedScan, Scans

__all__ = [
    "LOST",
    "Description",
    "Recording",
    "RefusedScan",
    "Scans",
    "describe",
    "erring",
    "is_costly_to_open",
    "lowest_elevations",
    "read_frames",
    "read_recording",
    "render",
]
