"""A folder of results, of whichever kind, as a section of a page."""

from collections.abc import Callable
from pathlib import Path

from gapeval.errors import GapevalError
from gapeval.report.studies.results import CLAIMS, read_studies
from gapeval.report.studies.section import StudySection, study_section
from gapeval.report.sweeps.results import SUMMARY, read_results
from gapeval.report.sweeps.section import SweepSection, sweep_section

Section = SweepSection | StudySection


def section(folder: Path, advance: Callable[[int], object]) -> Section:
    """Raises GapevalError for a folder without results."""
    title = folder.as_posix()
    if (folder / CLAIMS).is_file():
        return study_section(read_studies(folder), title)
    if (folder / SUMMARY).is_file():
        return sweep_section(read_results(folder), title, advance)
    raise GapevalError(
        f"{folder}: neither {SUMMARY} of a sweep nor {CLAIMS} of studies is here; name a folder of results"
    )
