"""Logs of any number and name: which of them are held against each other, and their rows together."""

import csv
import io
import json
from pathlib import Path

import pytest
from command import gapeval
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from result_folders import (
    ALL,
    BEST,
    IDS,
    by_mark,
    cells,
    compared,
    copied,
    edited,
    manifest,
    shown,
    table,
    the_row,
    without,
    write_table,
)

from gapeval.compare import marks
from gapeval.compare.outcome import NOT_COMPARABLE, REGRESSION


@pytest.fixture
def new(results: Path, tmp_path: Path) -> Path:
    return copied(results, tmp_path / "new")


def test_logs_that_are_missing_or_extra(results: Path, tmp_path: Path) -> None:
    alone = without(results, tmp_path / "alone", log="b.mcap")
    found = compared(results, alone)
    assert by_mark(found, "!") == [(log, name) for log in ("b.mcap", ALL) for name in IDS]
    assert the_row(found, ALL, BEST).reasons == ("b.mcap is not in NEW",)
    assert found.status == REGRESSION
    timed = compared(results, alone, rises=["time=1000"])
    assert (timed.status, {time.log for time in timed.times}) == (REGRESSION, {"a.mcap"})
    found = compared(alone, results)
    assert by_mark(found, "x") == [(ALL, name) for name in IDS]
    assert by_mark(found, "*") == [("b.mcap", name) for name in IDS]
    assert the_row(found, ALL, BEST).reasons == ("b.mcap is not in BASE",)
    assert found.status == NOT_COMPARABLE


def test_a_renamed_log_is_missing_and_extra(results: Path, new: Path) -> None:
    edited(new, cells({"log": "b.mcap"}, log="c.mcap"))
    found = compared(results, new)
    assert (found.status, marks(found)) == (NOT_COMPARABLE, {"x": 4, "!": 4, "*": 4, " ": 4})


def test_several_logs_are_named_in_order(results: Path, new: Path) -> None:
    """In any process: sets have none."""
    base = copied(results, new.parent / "base")
    names = [f"{name}.mcap" for name in ("k", "c", "x", "e", "m")]
    rows = table(results / "summary.csv")
    more = [row | {"log": name} for name in names for row in rows[:4]]
    write_table(base / "summary.csv", [*more, *rows])
    for pair, reason in (((base, new), "is not in NEW"), ((new, base), "is not in BASE")):
        assert the_row(compared(*pair), ALL, BEST).reasons == tuple(
            f"{name} {reason}" for name in sorted(names)
        )


def test_one_log_is_not_said_twice(results: Path, tmp_path: Path) -> None:
    """Rows of all logs are those of the only one; but one that says something else is shown."""
    base = without(results, tmp_path / "base", log="b.mcap")
    figures = {row["configuration"]: row | {"log": ALL} for row in table(base / "summary.csv")[:4]}
    edited(base, lambda row: figures[row["configuration"]] if row["log"] == ALL else row)
    new = copied(base, tmp_path / "new")
    assert marks(compared(base, new)) == {" ": 4}
    edited(new, cells({"configuration": BEST}, pq=0.1))
    assert by_mark(compared(base, new), "+") == [("a.mcap", BEST)]
    edited(new, cells({"log": "a.mcap", "configuration": BEST}, pq=figures[BEST]["pq"]))
    found = compared(base, new)
    assert (found.status, by_mark(found, "+")) == (REGRESSION, [(ALL, BEST)])
    edited(new, lambda row: None if row["log"] == ALL else row)
    found = compared(base, new)
    assert (found.status, by_mark(found, "!")) == (REGRESSION, [(ALL, name) for name in IDS])


@settings(
    deadline=None,
    derandomize=True,
    max_examples=20,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(name=st.text(st.characters(codec="utf-8", exclude_characters="\r\n\x00"), min_size=1, max_size=20))
@pytest.mark.parametrize("table_alone", [False, True])
def test_logs_of_any_name(results: Path, new: Path, name: str, table_alone: bool) -> None:
    """Commas, quotes, spaces and other scripts."""
    if name in (ALL, "a.mcap"):
        name += "'"
    base = new.parent / "base"
    for folder in (base, new):
        if not folder.exists():
            copied(results, folder)
        for file in ("summary.csv", "frames.csv", "labels.csv", "manifest.json"):
            (folder / file).write_bytes((results / file).read_bytes())
        for file in ("summary.csv", "frames.csv", "labels.csv"):
            edited(folder, cells({"log": "b.mcap"}, log=name), file)
        manifest(folder, lambda document: document["logs"][1].update(log=name))
    edited(new, cells({"log": name, "configuration": BEST}, hit_rate=0.5))
    status, document = shown(base / "summary.csv" if table_alone else base, new)
    assert status == REGRESSION
    assert [row["log"] for row in document["rows"] if row["mark"] == "+"] == [name]
    as_csv = gapeval("compare", base, new, "--format", "csv").out
    assert name in {row["log"] for row in csv.DictReader(io.StringIO(as_csv, newline=""))}
    assert json.loads((base / "manifest.json").read_text())["logs"][1]["log"] == name
