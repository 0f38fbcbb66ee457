"""A comparison as CSV, read back and held against the data."""

import csv
import io
import math

from comparisons import comparison, comparisons, large, realistic, row
from hypothesis import given

from gapeval.compare.outcome import Comparison
from gapeval.report.comparisons.as_csv import FIGURES, as_csv


def read(found: Comparison) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(as_csv(found), newline=""), strict=True))


def number(text: str) -> float | None:
    return float(text) if text else None


def finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


@given(comparisons())
def test_all_of_it_can_be_read_back(found) -> None:
    lines = iter(read(found))
    for one in found.rows:
        names = {"log": one.log, "configuration": one.configuration}
        names |= {name: one.parameters[name] for name in found.varied}
        if one.reasons or not one.changes:
            line = next(lines)
            assert line | names == line
            assert (line["mark"], line["metric"], line["reason"]) == (one.mark, "", "; ".join(one.reasons))
        for change in one.changes:
            line = next(lines)
            assert line | names == line
            assert (line["mark"], line["metric"]) == (change.mark, change.metric)
            assert number(line["base"]) == change.base
            assert number(line["new"]) == change.new
            assert number(line["difference"]) == change.difference
            assert number(line["limit"]) == finite(change.limit)
            noise = change.noise
            assert number(line["noise_low"]) == (noise and finite(noise.low))
            assert number(line["noise_high"]) == (noise and finite(noise.high))
            assert line["reason"] == (noise.unknown if noise else "")
            beyond = {"beyond": True, "within": False, "": None}[line["noise"]]
            assert beyond == (noise and noise.beyond)
    for time in found.times:
        if time.mark == " " and not (time.base and time.new):
            continue  # on one side alone, and nothing holds it against anything
        line = next(lines)
        assert (line["log"], line["configuration"], line["metric"]) == (time.log, "", time.metric)
        assert line["mark"] == time.mark
        assert number(line["base"]) == (time.base and time.base.median)
        assert number(line["new"]) == (time.new and time.new.median)
        assert number(line["limit"]) == finite(time.limit)
    assert next(lines, None) is None


def test_the_head() -> None:
    assert as_csv(realistic()).split("\n")[0].split(",") == ["log", "configuration", "n_o", "pl_th", *FIGURES]


def test_no_limit_to_what_is_told() -> None:
    assert len(read(large(300, 25))) == 300 * 25


def test_names_that_are_no_text_can_be_written() -> None:
    found = comparison(row(" ", log="a\udc80"))
    assert as_csv(found).encode()
    assert read(found)[0]["log"] == "a\\udc80"
