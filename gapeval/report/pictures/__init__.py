"""One frame as the detector sees it: from above, and the stages of its polar image (the paper's Fig. 4)."""

from gapeval.report.pictures.figure import png
from gapeval.report.pictures.file import check_picture
from gapeval.report.pictures.found import Findings, findings
from gapeval.report.pictures.from_above import draw_frame
from gapeval.report.pictures.stages import draw_stages

__all__ = [
    "Findings",
    "check_picture",
    "draw_frame",
    "draw_stages",
    "findings",
    "png",
]
