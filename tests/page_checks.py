"""Sweeps to report on, and what can be said of a page without a browser."""

import re
from collections import Counter
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

from command import gapeval
from small_logs import drive, labels

GRID = ("-p", "k=5,6", "-p", "delta_r=1.03,1.05,1.2", "-p", "n_o=0,1", "--jobs", 1)
VOID = {"meta", "link", "img", "br", "circle", "path", "use"}


def swept(
    folder: Path, *options: object, frames: int = 4, labelled: bool = True, log: str = "drive.mcap"
) -> Path:
    """A small sweep of 12 configurations, unless options say otherwise; its results are in folder/results."""
    recorded = drive(folder / log, frames)
    drawn = ("--labels", labels(folder / "labels.geojson")) if labelled else ()
    done = gapeval("sweep", recorded, *drawn, *(options or GRID), "-o", folder / "results")
    assert done.status == 0, done.err
    return folder / "results"


def reported(*folders: object, output: Path) -> str:
    done = gapeval("report", *folders, "-o", output)
    assert done.status == 0, done.err
    return output.read_text()


@dataclass
class Element:
    tag: str
    attributes: dict[str, str]
    path: tuple[str, ...]
    text: str = ""


@dataclass
class Page(HTMLParser):
    """Every element of a page, with its own text and that of what it holds."""

    elements: list[Element] = field(default_factory=list)
    open: list[Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, {k: v or "" for k, v in attrs}, tuple(one.tag for one in self.open))
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(
            Element(tag, {k: v or "" for k, v in attrs}, tuple(one.tag for one in self.open))
        )

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1].tag == tag, f"</{tag}> closes <{self.open[-1].tag}>"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        for element in self.open:
            element.text += data

    def all(self, tag: str, **attributes: str) -> list[Element]:
        wanted = {name.rstrip("_"): value for name, value in attributes.items()}
        return [
            one
            for one in self.elements
            if one.tag == tag and all(one.attributes.get(name) == value for name, value in wanted.items())
        ]

    def texts(self, tag: str, **attributes: str) -> list[str]:
        return [" ".join(one.text.split()) for one in self.all(tag, **attributes)]


def parsed(page: str) -> Page:
    """The page; its tags must be closed in order."""
    found = Page()
    found.feed(page)
    found.close()
    assert found.open == []
    return found


def check_sound(page: str) -> Page:
    """What must hold of every page."""
    found = parsed(page)
    ids = Counter(one.attributes["id"] for one in found.elements if "id" in one.attributes)
    assert [name for name, count in ids.items() if count > 1] == []
    for one in found.elements:
        for name in ("href", "src", "xlink:href"):
            target = one.attributes.get(name, "")
            assert not target or target.startswith(("#", "data:")), (one.tag, target)
            if target.startswith("#"):
                assert target[1:] in ids, target
        assert one.tag not in ("script", "iframe", "object")
        assert not [name for name in one.attributes if name.startswith("on")]
        if one.tag == "img":
            assert one.attributes["alt"]
        if one.tag == "th":
            assert one.attributes["scope"] in ("row", "col")
    assert re.findall(r"url\((?!#)|@import", page) == []
    for target in re.findall(r"url\(#([^)]+)\)", page):
        assert target in ids
    headings = [int(one.tag[1]) for one in found.elements if re.fullmatch("h[1-6]", one.tag)]
    assert headings[0] == 1
    assert headings.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(headings))
    assert found.all("html")[0].attributes["lang"] == "en-GB"
    assert found.texts("title")
    drawings = re.findall(r'<svg [^>]*?class="(?!heat)\w+".*?</svg>', page, re.DOTALL)
    assert re.findall(r"#[0-9a-f]{6}", "".join(drawings)) == []  # their colours are the style sheet's
    return found
