"""A comparison as JSON: all of it."""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from gapeval.compare.outcome import MARKS, Change, Comparison, LabelChange, Noise, Origin, Row, Spread, Time
from gapeval.report.comparisons.verdict import verdict

Figures = Mapping[str, float | None]


def as_json(comparison: Comparison) -> str:
    """One document, a line for each row and time, keys as the fields of `gapeval.compare.outcome`.

    What is no number is null: undefined figures, unknown noise, and a limit where nothing is held against a
    figure. Stamps are texts, since 2**53 is too small for them.
    """
    parts = {
        "status": _line(comparison.status),
        "verdict": _line(verdict(comparison)),
        "marks": _line(MARKS),
        "base": _line(_origin(comparison.base)),
        "new": _line(_origin(comparison.new)),
        "varied": _line(comparison.varied),
        "rows": _lines([_row(row) for row in comparison.rows]),
        "times": _lines([_time(time) for time in comparison.times]),
        "notices": _lines(comparison.notices),
    }
    return "{\n" + ",\n".join(f'"{name}": {part}' for name, part in parts.items()) + "\n}\n"


def _origin(origin: Origin) -> dict[str, Any]:
    return {
        "path": origin.path,
        "gapeval": origin.gapeval,
        "revision": origin.revision,
        "source": origin.source,
        "scorer": origin.scorer,
        "logs": dict(origin.logs),
        "labels": dict(origin.labels),
        "history": _finite(origin.history),
    }


def _row(row: Row) -> dict[str, Any]:
    labels = row.labels
    return {
        "log": row.log,
        "configuration": row.configuration,
        "was": row.was,
        "parameters": dict(row.parameters),
        "mark": row.mark,
        "reasons": row.reasons,
        "base": _figures(row.base),
        "new": _figures(row.new),
        "changes": [_change(change) for change in row.changes],
        "frames": row.frames,
        "labels": None if labels is None else [_label(change) for change in labels],
        "unknown": row.unknown,
    }


def _change(change: Change) -> dict[str, Any]:
    return {
        "metric": change.metric,
        "mark": change.mark,
        "base": _number(change.base),
        "new": _number(change.new),
        "difference": _number(change.difference),
        "limit": _number(change.limit),
        "noise": None if change.noise is None else _noise(change.noise),
    }


def _noise(noise: Noise) -> dict[str, Any]:
    return {
        "low": _number(noise.low),
        "high": _number(noise.high),
        "beyond": noise.beyond,
        "unknown": noise.unknown,
    }


def _label(change: LabelChange) -> dict[str, Any]:
    return {
        "label": change.label,
        "was": change.was,
        "now": change.now,
        "frames": change.frames,
        "stamps": list(map(str, change.stamps)),
    }


def _time(time: Time) -> dict[str, Any]:
    return {
        "log": time.log,
        "stage": time.stage,
        "metric": time.metric,
        "mark": time.mark,
        "base": time.base and _spread(time.base),
        "new": time.new and _spread(time.new),
        "limit": _number(time.limit),
    }


def _spread(spread: Spread) -> dict[str, Any]:
    return {"median": _number(spread.median), "p95": _number(spread.p95), "frames": spread.frames}


def _figures(figures: Figures) -> dict[str, float | None]:
    return {name: _number(value) for name, value in figures.items()}


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _lines(values: Sequence[Any]) -> str:
    return "[\n" + ",\n".join(map(_line, values)) + "\n]" if values else "[]"


def _line(value: Any) -> str:
    return json.dumps(value, allow_nan=False)


def _finite(value: Any) -> Any:
    """The same without NaN and infinity, however deep."""
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    return [_finite(one) for one in value] if isinstance(value, list | tuple) else value
