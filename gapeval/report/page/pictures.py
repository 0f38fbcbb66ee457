"""The pictures of a page as PNG files."""

from collections.abc import Sequence

from gapeval.report.curves.picture import png
from gapeval.report.page.sections import Section


def pictures(sections: Sequence[Section]) -> dict[str, bytes]:
    """By file name; numbered by section where there are several."""
    made = {}
    for number, section in enumerate(sections, 1):
        prefix = f"{number}-" if len(sections) > 1 else ""
        for exhibit in section.exhibits:
            made[f"{prefix}{exhibit.name}.png"] = png(exhibit.drawings, exhibit.legend, exhibit.title)
        for photo in section.photos:
            if photo.png:
                made[f"{prefix}{photo.name}.png"] = photo.png
    return made
