"""What a page shows as one figure, with all that is needed to trace it."""

from dataclasses import dataclass

from gapeval.report.curves.picture import Drawable
from gapeval.report.curves.style import Look


@dataclass(frozen=True, slots=True)
class Table:
    """Texts in rows, each as long as the head. first: whether the first column names the row."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    first: bool = True


@dataclass(frozen=True, slots=True)
class Exhibit:
    """Drawings with one caption.

    name: for files. source: the CSV file and its rows. table: what is drawn; open: it is read as often as the
    drawing, and is shown with it.
    """

    name: str
    title: str
    drawings: tuple[Drawable, ...]
    legend: tuple[tuple[str, Look], ...]
    caption: str
    source: str
    table: Table
    open: bool = False


@dataclass(frozen=True, slots=True)
class Photo:
    """A picture of a frame. png: its bytes; empty where missing says why there is none."""

    name: str
    title: str
    png: bytes
    alt: str
    caption: str
    source: str
    missing: str = ""
