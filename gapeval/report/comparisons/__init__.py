"""How a comparison is shown: a module for each format, each a function from a Comparison to text."""

from collections.abc import Callable

from gapeval.compare.outcome import Comparison
from gapeval.report.comparisons.as_json import as_json
from gapeval.report.comparisons.text import text

# Each ends with a line break, and is written as it is.
FORMATS: dict[str, Callable[[Comparison], str]] = {"text": text, "json": as_json}
