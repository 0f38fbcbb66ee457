"""Sections set as HTML: one file, which loads nothing."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gapeval.report.curves.picture import svg
from gapeval.report.exhibit import Exhibit, Photo
from gapeval.report.page.sections import Section
from gapeval.report.page.swatch import swatch


@dataclass(frozen=True, slots=True)
class Shown:
    """An exhibit as the page has it. drawings, legend: SVG that we made."""

    anchor: str
    exhibit: Exhibit
    drawings: tuple[Markup, ...]
    legend: tuple[tuple[Markup, str], ...]

    @property
    def kind(self) -> str:
        """How it is laid out."""
        return "above-table" if self.exhibit.open else "drawn"


def html(sections: Sequence[Section]) -> bytes:
    """The page; the same sections give the same bytes."""
    environment = Environment(
        loader=PackageLoader("gapeval.report.page", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    style = files("gapeval.report.page").joinpath("templates", "style.css").read_text(encoding="utf-8")
    environment.filters |= {"data_uri": _data_uri}
    page = environment.get_template("page.html").render(
        sections=[
            (f"s{index}", section, {one.name: _shown(one, f"s{index}") for one in section.exhibits})
            for index, section in enumerate(sections, 1)
        ],
        style=Markup(style),  # ours, and no text from a file
    )
    return page.encode(errors="replace")  # the name of a file may be no text


def _shown(exhibit: Exhibit, anchor: str) -> Shown:
    name = f"{anchor}-{exhibit.name}"
    drawings = tuple(Markup(svg(what, f"{name}-{place}")) for place, what in enumerate(exhibit.drawings))
    legend = tuple((Markup(swatch(look)), words) for words, look in exhibit.legend)
    return Shown(name, exhibit, drawings, legend)


def _data_uri(photo: Photo) -> str:
    return f"data:image/png;base64,{base64.b64encode(photo.png).decode()}"
