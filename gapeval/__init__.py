"""Terrain-gap detection (Sinha & Papadakis, Robotica 2013) on recorded logs, swept and scored.

The two verbs of the paper work on plain data, without any log:

    detection = gapeval.detect(frame, configuration)
    crossings = gapeval.assess(detection, configuration.robot, configuration.crossing)
"""

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
__all__ = ["assess", "detect"]

if TYPE_CHECKING:
    from gapeval.detection import detect
    from gapeval.traversability import assess


def __getattr__(name: str) -> Any:
    # Lazy, so that `gapeval --help` need not import numpy and OpenCV.
    if name == "detect":
        from gapeval.detection import detect

        return detect
    if name == "assess":
        from gapeval.traversability import assess

        return assess
    raise AttributeError(f"module 'gapeval' has no attribute {name!r}")
