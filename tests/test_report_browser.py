"""The report in a real Chromium: no errors, no network, readable in light, dark, narrow and print.

Left out by scripts/test, run by scripts/test-all; without a Chromium it fails.
"""

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from command import gapeval
from page_checks import reported, swept
from study_folder import write_studies

pytestmark = pytest.mark.slow

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
QUIET = (
    "--no-sandbox",  # Chromium has none for root
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
DESKTOP, PHONE = 1280, 360
PAGES = ("sweep", "studies", "both", "bare")

# Colours of an element's words and of what lies behind them, as [red, green, blue].
CONTRAST = """(element) => {
  const numbers = (text) => text.match(/[\\d.]+/g).map(Number);
  let behind = element;
  while (behind && numbers(getComputedStyle(behind).backgroundColor)[3] === 0) behind = behind.parentElement;
  const style = getComputedStyle(behind || document.body);
  return [numbers(getComputedStyle(element).color), numbers(style.backgroundColor)];
}"""
# The colours that drawings use, and the page's.
VARIABLES = """() => {
  const probe = document.createElement("span"), found = {};
  document.body.append(probe);
  const style = document.querySelector("style").textContent;
  for (const name of [...style.matchAll(/--[a-z0-9-]+(?=:)/g)].map(String)) {
    probe.style.color = `var(${name})`;
    found[name] = getComputedStyle(probe).color.match(/[\\d.]+/g).map(Number);
  }
  probe.remove();
  return found;
}"""
OVERFLOWING = """() => [...document.querySelectorAll("body *")].filter((one) => {
  const box = one.getBoundingClientRect();
  return box.right > innerWidth + 1 && !one.closest(".scroll, .drawing");
}).map((one) => one.outerHTML.slice(0, 120))"""


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Of a simulated sweep, of studies, of both, and of a sweep that has neither labels nor its log."""
    folder = tmp_path_factory.mktemp("pages")
    assert gapeval("demo", "-o", folder / "demo").status == 0
    studies = write_studies(folder / "studies", quick=True)
    bare = swept(
        folder / "bare", labelled=False, log="<b>a log with a very long name" + "_and_longer" * 12 + ".mcap"
    )
    shutil.rmtree(bare / "parts")
    made = {
        "sweep": (folder / "demo" / "results",),
        "studies": (studies,),
        "both": (studies, folder / "demo" / "results"),
        "bare": (bare,),
    }
    for name, folders in made.items():
        reported(*folders, output=folder / f"{name}.html")
    return {name: folder / f"{name}.html" for name in made}


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    assert found, "no Chromium here; ./scripts/test-all installs it"
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=found, args=list(QUIET))
        yield opened
        opened.close()


@dataclass
class Visit:
    """A page that was opened, and what it said and asked for meanwhile."""

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)


@pytest.fixture
def visit(browser: Any, pages: dict[str, Path]) -> Iterator[Any]:
    opened = []

    def go(name: str, width: int = DESKTOP, scheme: str = "light") -> Visit:
        page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
        opened.append(page)
        visited = Visit(page)
        page.on("console", lambda message: visited.said.append(message.text))
        page.on("pageerror", lambda error: visited.said.append(str(error)))
        page.on("request", lambda request: visited.asked.append(request.url))
        page.on("requestfailed", lambda request: visited.said.append(f"failed: {request.url}"))
        page.goto(pages[name].as_uri(), wait_until="load")
        return visited

    yield go
    for page in opened:
        page.close()


@pytest.mark.parametrize("name", PAGES)
@pytest.mark.parametrize("width", [DESKTOP, PHONE])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_opens_without_a_word_and_loads_nothing(
    visit: Any, pages: dict[str, Path], name: str, width: int, scheme: str
) -> None:
    visited = visit(name, width, scheme)
    assert visited.said == []
    assert [url for url in visited.asked if not url.startswith("data:")] == [pages[name].as_uri()]
    page = visited.page
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.evaluate("document.querySelectorAll('details').forEach((one) => one.open = true)")
    assert page.evaluate("document.documentElement.scrollWidth") <= width, "with all tables open"
    assert page.evaluate(OVERFLOWING) == []


@pytest.mark.parametrize("name", PAGES)
@pytest.mark.parametrize("width", [DESKTOP, PHONE])
def test_every_picture_is_there_and_has_a_size(visit: Any, name: str, width: int) -> None:
    page = visit(name, width).page
    assert (
        page.evaluate("[...document.images].filter((one) => !(one.complete && one.naturalWidth > 0)).length")
        == 0
    )
    sizes = page.evaluate(
        "[...document.querySelectorAll('main svg')].map((one) => one.getBoundingClientRect())"
        ".map((box) => [box.width, box.height])"
    )
    assert all(wide > 8 and high > 8 for wide, high in sizes)
    drawings = page.evaluate(
        "[...document.querySelectorAll('.drawing svg')].map((one) => one.getBoundingClientRect().width)"
    )
    assert all(wide > 230 for wide in drawings)
    assert bool(drawings)
    assert page.evaluate("document.images.length") == {"sweep": 5, "studies": 0, "both": 5, "bare": 0}[name]


@pytest.mark.parametrize("width", [DESKTOP, PHONE])
def test_words_in_drawings_are_large_enough_and_lie_in_them(visit: Any, width: int) -> None:
    page = visit("both", width).page
    words = page.evaluate("""() => [...document.querySelectorAll(".drawing svg")].flatMap((svg) => {
      const frame = svg.getBoundingClientRect(), scale = frame.width / svg.viewBox.baseVal.width;
      return [...svg.querySelectorAll("text")].map((text) => {
        const box = text.getBoundingClientRect();
        const aside = Math.max(frame.left - box.left, box.right - frame.right);
        const out = Math.max(aside, frame.top - box.top, box.bottom - frame.bottom);
        return [text.textContent, parseFloat(getComputedStyle(text).fontSize) * scale, out];
      });
    })""")
    assert len(words) > 100
    assert [(word, size) for word, size, _ in words if size < 7] == []
    assert [(word, out) for word, _, out in words if out > 2] == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_has_contrast(visit: Any, scheme: str) -> None:
    page = visit("both", DESKTOP, scheme).page
    quiet = "h2 .kind, .lead, .source, .where, figcaption p"
    shown = f"{quiet}, body, .warning li, a, summary, th, td, dt, dd, .verdict, code"
    for element in page.query_selector_all(shown):
        words, behind = element.evaluate(CONTRAST)
        assert contrast(words, behind) >= 4.5, element.evaluate("(one) => one.outerHTML.slice(0, 100)")
    colours = page.evaluate(VARIABLES)
    lines = [name for name in colours if re.fullmatch(r"--(line-\d|ink|soft)", name)]
    assert len(lines) == 9
    for name in lines:
        assert contrast(colours[name], colours["--paper"]) >= (3 if "line" in name else 4.5), name
    bright = luminance(colours["--paper"]) > 0.5
    assert bright == (scheme == "light")


def test_printed_it_is_light_whatever_the_screen_is(visit: Any, tmp_path: Path) -> None:
    page = visit("both", DESKTOP, "dark").page
    page.emulate_media(media="print", color_scheme="dark")
    colours = page.evaluate(VARIABLES)
    assert luminance(colours["--paper"]) == pytest.approx(1)
    assert contrast(colours["--ink"], colours["--paper"]) > 10
    # A4 less margins, at 96 dots to the inch.
    page.set_viewport_size({"width": 695, "height": 1000})
    assert page.evaluate("document.documentElement.scrollWidth") <= 695
    printed = page.pdf(path=tmp_path / "report.pdf", format="A4")
    assert printed.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) > 3


def test_a_link_leads_to_its_section(visit: Any) -> None:
    page = visit("both", PHONE).page
    page.click("nav a >> nth=1")
    assert abs(page.evaluate("document.querySelector('#s2').getBoundingClientRect().top")) < 50


def luminance(colour: list[float]) -> float:
    """Relative, as WCAG has it."""
    parts = [part / 255 for part in colour[:3]]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: list[float], other: list[float]) -> float:
    """From 1 to 21, as WCAG has it."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)
