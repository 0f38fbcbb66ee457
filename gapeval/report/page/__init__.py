"""One self-contained HTML page from the folders of sweeps and studies."""

from gapeval.report.page.html import html
from gapeval.report.page.pictures import pictures
from gapeval.report.page.sections import Section, section

__all__ = ["Section", "html", "pictures", "section"]
