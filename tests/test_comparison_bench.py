"""NEW's figures for github-action-benchmark."""

import json
import math
from collections import Counter
from typing import Any

import pytest
from comparisons import comparison, comparisons, large, realistic, row
from hypothesis import given

from gapeval.compare.outcome import Comparison
from gapeval.report.comparisons.bench import bench
from gapeval.results.figures import FIGURES

SHARES = {
    *("hit_rate", "coverage", "precision", "recall", "f1", "sq", "rq", "pq"),
    *("npca_accuracy", "pca_accuracy"),
}
REAL = row(
    "+",
    new={
        "hit_rate": 0.75,
        "over_area": 7.5,
        "axis_angle": 0.1,
        "gaps": 31.0,
        "first_hit_range": 3.0,
        "pq": None,
    },
    base={"hit_rate": 1.0, "over_area": None},
)


def read(found: Comparison) -> list[dict[str, Any]]:
    return json.loads(bench(found), parse_constant=lambda constant: pytest.fail(constant))


def test_of_which_figures_more_is_better() -> None:
    """All of them are shares of 1, but for a range: `1 - NAME` means something."""
    assert {f.name for f in FIGURES.values() if f.better == "higher"} == SHARES | {"first_hit_range"}
    assert {FIGURES[name].unit for name in SHARES} == {"1"}


def test_what_stands_as_it_is_and_what_is_turned_or_left_out() -> None:
    assert read(comparison(REAL)) == [
        {"name": "street.mcap n_o=1 pl_th=0.4: 1 - hit_rate", "unit": "1", "value": 0.25, "extra": "BASE: 0"},
        {"name": "street.mcap n_o=1 pl_th=0.4: over_area", "unit": "m2", "value": 7.5},
    ]


def test_noise_and_times_of_a_real_one() -> None:
    found = {entry["name"]: entry for entry in read(realistic())}
    assert found["street.mcap n_o=1 pl_th=0.4: 1 - hit_rate"]["range"] == "± 0.09"
    assert found["street.mcap: time"] == {
        "name": "street.mcap: time",
        "unit": "s",
        "value": 0.004,
        "extra": "BASE: 0.0021",
    }
    assert sum(name.endswith("time") for name in found) == 2


@given(comparisons())
def test_each_figure_of_which_less_is_better_stands_once(found) -> None:
    entries = read(found)
    expected = Counter(
        round(1 - value if name in SHARES else value, 9)
        for one in found.rows
        for name, value in one.new.items()
        if value is not None and name in FIGURES and (FIGURES[name].better == "lower" or name in SHARES)
    )
    times = [time.new.median for time in found.times if time.stage == "time" and time.new]
    figures = entries[: len(entries) - len(times)]
    assert Counter(round(entry["value"], 9) for entry in figures) == expected
    assert [entry["value"] for entry in entries[len(figures) :]] == times
    for entry in entries:
        assert set(entry) <= {"name", "unit", "value", "range", "extra"}
        assert {type(entry[name]) for name in ("name", "unit")} == {str}
        assert math.isfinite(entry["value"])
        assert entry["name"].isprintable()


def test_names_tell_figures_apart() -> None:
    entries = read(large(50, 25))
    assert len({entry["name"] for entry in entries}) == len(entries) == 50 * 25 - 50 * _without_direction()
    same = [row(" ", configuration=name, new={"pq": 0.5}) for name in ("a", "b")]
    assert [entry["name"] for entry in read(comparison(*same))] == [
        f"street.mcap n_o=1 pl_th=0.4 {name}: 1 - pq" for name in ("a", "b")
    ]


def _without_direction() -> int:
    return sum(FIGURES[change.metric].better == "none" for change in large(1, 25).rows[0].changes)


def test_nothing_to_show() -> None:
    assert bench(comparison()) == "[]\n"
