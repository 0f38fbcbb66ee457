"""NEW's figures as github-action-benchmark reads them, with its tool `customSmallerIsBetter`."""

import json
import math
from collections import Counter
from collections.abc import Iterator

from gapeval.compare.outcome import Change, Comparison, Row, Spread, Time
from gapeval.report.comparisons.words import figure, parameters, plain
from gapeval.results.figures import FIGURES

Entry = dict[str, str | float]


def bench(comparison: Comparison) -> str:
    """A JSON list with a line for each figure of each row, and for the `time` of each log.

    The file is read in one way only: of all, less is better. So a share of which more is better stands as
    `1 - NAME`; other figures of which more is better are left out, and so are those that have no better
    direction and those that are undefined. range: half of how far noise goes. extra: BASE's value, where the
    row can be compared.
    """
    entries = [entry for name, row in _names(comparison) for entry in _figures(name, row)]
    entries += [_time(time, time.new) for time in comparison.times if time.stage == "time" and time.new]
    lines = ",\n".join(json.dumps(entry, allow_nan=False) for entry in entries)
    return f"[\n{lines}\n]\n" if entries else "[]\n"


def _names(comparison: Comparison) -> Iterator[tuple[str, Row]]:
    """Of each row: its log and what varies, which a new parameter does not change; else its configuration."""
    names = [f"{plain(row.log)} {parameters(row, comparison.varied)}".strip() for row in comparison.rows]
    seen = Counter(names)
    for name, row in zip(names, comparison.rows, strict=True):
        yield (name if seen[name] == 1 else f"{name} {plain(row.configuration)}"), row


def _figures(name: str, row: Row) -> Iterator[Entry]:
    changes = {change.metric: change for change in row.changes}
    for metric, value in row.new.items():
        known = FIGURES.get(metric)
        is_share = known is not None and known.better == "higher" and known.unit == "1"
        if known is None or value is None or not math.isfinite(value):
            continue
        if known.better != "lower" and not is_share:
            continue
        entry: Entry = {
            "name": f"{name}: {'1 - ' if is_share else ''}{metric}",
            "unit": known.unit,
            "value": 1 - value if is_share else value,
        }
        if spread := _range(changes.get(metric)):
            entry["range"] = spread
        base = row.base.get(metric)
        if row.mark != "x" and base is not None and math.isfinite(base):
            entry["extra"] = f"BASE: {figure(1 - base if is_share else base)}"
        yield entry


def _range(change: Change | None) -> str:
    noise = change and change.noise
    return f"± {figure((noise.high - noise.low) / 2)}" if noise and not noise.unknown else ""


def _time(time: Time, new: Spread) -> Entry:
    entry: Entry = {"name": f"{plain(time.log)}: time", "unit": "s", "value": new.median}
    if time.base is not None and time.mark != "x":
        entry["extra"] = f"BASE: {figure(time.base.median)}"
    return entry
