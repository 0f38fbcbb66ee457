"""Report on folders of results for a command: progress while it is measured and drawn."""

from collections.abc import Sequence
from pathlib import Path

from gapeval.cli.reading import progress_bar, say
from gapeval.errors import GapevalError
from gapeval.files import make_folder, write_whole
from gapeval.report.page import html, pictures, section
from gapeval.report.text import counted

OPENING = b"<!doctype html>"
PAGE = Path("report.html")


def write_report(folders: Sequence[Path], output: Path | None, png_folder: Path | None) -> None:
    """The page, and the pictures where they are asked for; they alone without an output."""
    page = output or (None if png_folder else PAGE)
    if page is not None:
        check_page(page)
        make_folder(page.parent)
    if png_folder is not None:
        make_folder(png_folder)
    sections = []
    for folder in folders:
        with progress_bar(f"report {folder}", 0, "steps") as bar:
            sections.append(section(folder, bar.update))
    for one in sections:
        for warning in one.warnings:
            say(f"{one.title}: {warning}")
        if one.unkept:
            say(f"{one.unkept}; times were measured and not kept")
    if page is not None:
        write_whole(page, html(sections))
        say(f"wrote {page}")
    if png_folder is not None:
        made = pictures(sections)
        for name, content in made.items():
            write_whole(png_folder / name, content)
        say(f"wrote {counted(len(made), 'picture')} into {png_folder}")


def check_page(path: Path) -> None:
    """Raises GapevalError rather than replace anything that is no HTML page."""
    if path.is_dir():
        raise GapevalError(f"{path}: is a folder; name a file for the page")
    if path.exists():
        with path.open("rb") as file:
            if file.read(64).lstrip()[: len(OPENING)].lower() != OPENING:
                raise GapevalError(f"{path}: exists and is no HTML page; name another file with -o")
