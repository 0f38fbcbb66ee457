"""From what is to be drawn to SVG and PNG."""

import html
import io
import re
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from gapeval.report.curves.heat import Heat, draw_heat
from gapeval.report.curves.panel import Panel, draw_panel
from gapeval.report.curves.scatter import Scatter, draw_scatter
from gapeval.report.curves.style import INK, RULE, SOFT, VARIABLES, Look

Drawable = Panel | Heat | Scatter
UNIT = 72  # of a drawing, to the inch
DPI = 150

REFERENCE = re.compile(r'(?<=href="#)[^"]+|(?<=url\(#)[^)]+')
FONT = re.compile(r"font-family: [^;\"]*")


@contextmanager
def curve_style() -> Iterator[None]:
    """matplotlib's own defaults, whatever the user's matplotlibrc says, and what is ours."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams |= {
            "font.family": ["DejaVu Sans"],
            "font.size": 9.0,
            "axes.labelsize": 9.0,
            "axes.titlesize": 10.0,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.edgecolor": SOFT,
            "axes.labelcolor": INK,
            "axes.titlecolor": INK,
            "text.color": INK,
            "xtick.color": SOFT,
            "ytick.color": SOFT,
            "xtick.labelcolor": INK,
            "ytick.labelcolor": INK,
            "xtick.labelsize": 8.6,
            "ytick.labelsize": 8.6,
            "xtick.major.size": 3.0,
            "ytick.major.size": 0.0,
            "axes.axisbelow": True,
            "axes.formatter.useoffset": False,
            "grid.color": RULE,
            "text.parse_math": False,  # a name may have any sign in it
            "svg.fonttype": "none",  # words stay words: to be searched, and in the page's font
            "svg.hashsalt": "gapeval",  # the same names for the same shapes
        }
        yield


def draw(axes: Axes, what: Drawable) -> None:
    match what:
        case Panel():
            draw_panel(axes, what)
        case Heat():
            draw_heat(axes, what)
        case Scatter():
            draw_scatter(axes, what)


def svg(what: Drawable, name: str) -> str:
    """An inline SVG. name: different for each of a page, since its parts are named after it."""
    with curve_style(), words_of_any_script():
        layout = ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03)
        figure = Figure(figsize=(what.width / UNIT, what.height / UNIT), layout=layout)
        draw(figure.add_subplot(), what)
        text = io.StringIO()
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(text, format="svg", transparent=True, metadata=nothing)
    return _inline(text.getvalue(), name, what)


def _inline(drawn: str, name: str, what: Drawable) -> str:
    """Without its head, sizes and fonts; its colours are the page's, its names are its own."""
    body = drawn[drawn.index("<g id=") : drawn.rindex("</svg>")]
    after = drawn[drawn.rindex("</g>") : drawn.rindex("</svg>")]
    assert body.endswith(after)
    body = re.sub(r"<style.*?</style>", "", body, flags=re.DOTALL)
    body = FONT.sub("font-family: inherit", body)
    for colour, variable in VARIABLES.items():
        body = body.replace(colour, f"var({variable})")
    used = set(REFERENCE.findall(body))
    body = re.sub(
        r' id="([^"]*)"', lambda found: f' id="{name}-{found[1]}"' if found[1] in used else "", body
    )
    body = REFERENCE.sub(lambda found: f"{name}-{found[0]}", body).replace("xlink:href", "href")
    title = html.escape(what.alt, quote=True)
    return (
        f'<svg viewBox="0 0 {what.width:g} {what.height:g}" class="{type(what).__name__.lower()}" role="img" '
        f'aria-label="{title}">{body}</svg>'
    )


LETTER = 9.0  # width of a letter of a title, in the units of drawings


def png(drawings: Sequence[Drawable], legend: Sequence[tuple[str, Look]], title: str) -> bytes:
    """All drawings of a figure in rows of two, in the colours of the light page, with a legend."""
    columns = min(2, len(drawings))
    rows = -(-len(drawings) // columns)
    width = columns * max(what.width for what in drawings) * 1.25
    height = rows * max(what.height for what in drawings) * 1.25 + 30 + (24 if legend else 0)
    with curve_style(), words_of_any_script():
        figure = Figure(
            figsize=(width / UNIT, height / UNIT), layout="constrained", facecolor="white", dpi=DPI
        )
        FigureCanvasAgg(figure)
        figure.suptitle(textwrap.fill(title, int(width / LETTER)), fontsize=11, fontweight="bold")
        for index, what in enumerate(drawings):
            draw(figure.add_subplot(rows, columns, index + 1), what)
        if legend:
            handles = [Line2D([], [], label=label, **look.artist()) for label, look in legend]
            figure.legend(
                handles=handles,
                loc="outside lower center",
                ncols=min(4, len(legend)),
                frameon=False,
                fontsize=8.5,
            )
        content = io.BytesIO()
        figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()


@contextmanager
def words_of_any_script() -> Iterator[None]:
    """A name may have letters that matplotlib's font lacks; a page's font has them."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")
        yield
