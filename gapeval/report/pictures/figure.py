"""A figure: matplotlib's own style, the title of a frame, the bytes of its picture."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from gapeval.report.pictures.colours import BOX
from gapeval.report.pictures.found import Findings

DPI = 150


@contextmanager
def own_style() -> Iterator[None]:
    """matplotlib's own defaults and font, whatever the user's matplotlibrc says."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams["font.family"] = ["DejaVu Sans"]
        yield


def titled_figure(found: Findings, width: float, height: float) -> Figure:
    """A white figure [inches]: at the top the log and its frame, the stamp, and what it was detected with."""
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)  # so that words can be measured
    params = found.configuration.detector
    if (params.height, params.width) == (2**params.k + 1,) * 2:
        resolution = f"k {params.k}"
    else:
        resolution = f"I_height {params.height}   I_width {params.width}"
    values = f"{resolution}   n_o {params.n_o}   delta_r {params.delta_r:g}   pl_th {params.pl_th:g} m"
    if found.detection.fallback:
        values += f"   plane: robot ({found.detection.fallback})"
    log = found.log.encode(errors="replace").decode()  # a name may be no text
    middle: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    headline = f"{log}, frame {found.number}"
    figure.text(0.5, 1 - 0.3 / height, headline, fontsize=12, fontweight="bold", **middle)
    below = f"stamp {found.frame.stamp}   {values}"
    figure.text(0.5, 1 - 0.58 / height, below, fontsize=9, color=BOX, **middle)
    return figure


@own_style()
def png(figure: Figure) -> bytes:
    """The figure as a PNG; the same figure gives the same bytes."""
    content = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a log's name may have letters that the font lacks
        figure.savefig(content, format="png", dpi=DPI, metadata={"Software": None})
    return content.getvalue()
