"""What one configuration alone takes: nothing is shared with others, as on a robot (Section 4.8)."""

import time

from gapeval.config import Configuration
from gapeval.detection import detect
from gapeval.frame import Frame
from gapeval.traversability import assess


def seconds_alone(frame: Frame, configuration: Configuration) -> float:
    """Gap detection and traversability analysis of one frame [s]."""
    begin = time.perf_counter()
    assess(detect(frame, configuration), configuration.robot, configuration.crossing)
    return time.perf_counter() - begin
