"""A folder of results, of whichever kind, as a section of a page."""

from collections.abc import Callable
from pathlib import Path

from gapeval.errors import GapevalError
from gapeval.report.studies.results import CLAIMS, read_studies
from gapeval.report.studies.section import StudySection, study_section
from gapeval.report.sweeps.results import read_results
from gapeval.report.sweeps.section import SweepSection, sweep_section
from gapeval.results.tables import SUMMARY

Section = SweepSection | StudySection


def section(folder: Path, advance: Callable[[int], object]) -> Section:
    """Raises GapevalError for what is no folder, and for a folder without results."""
    title = folder.as_posix()
    if (folder / CLAIMS).is_file():
        return study_section(read_studies(folder), title)
    if (folder / SUMMARY).is_file():
        return sweep_section(read_results(folder), title, advance)
    raise GapevalError(f"{folder}: {_complaint(folder)}")


def _complaint(folder: Path) -> str:
    """Why it is no folder of results, and which may be meant."""
    if not folder.exists():
        return "does not exist; name a folder of results"
    if not folder.is_dir():
        return f"is a file; name a folder of results, which has {SUMMARY} or {CLAIMS} in it"
    missing = f"neither {SUMMARY} of a sweep nor {CLAIMS} of studies is here"
    inner = sorted(found.parent for name in (SUMMARY, CLAIMS) for found in folder.glob(f"*/{name}"))
    return f"{missing}; {f'is {inner[0]} meant?' if inner else 'name a folder of results'}"
