"""How a comparison is shown: a module for each format, each a function from a Comparison to text."""

from collections.abc import Callable

from gapeval.compare.outcome import Comparison
from gapeval.report.comparisons.as_csv import as_csv
from gapeval.report.comparisons.as_json import as_json
from gapeval.report.comparisons.bench import bench
from gapeval.report.comparisons.github import annotations
from gapeval.report.comparisons.junit import junit
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.text import text

# Each ends with a line break, and is written as it is.
FORMATS: dict[str, Callable[[Comparison], str]] = {
    "text": text,
    "md": markdown,
    "json": as_json,
    "csv": as_csv,
    "junit": junit,
    "github": annotations,
    "bench": bench,
}
