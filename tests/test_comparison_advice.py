"""What to do next, and that doing it helps."""

import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from command import gapeval
from comparisons import comparison, comparisons, origin, row
from hypothesis import given
from result_folders import copied, edited

from gapeval.compare.outcome import Comparison
from gapeval.report.comparisons.advice import advice, renewal
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.text import text

BASELINE = origin("ci/my base.csv", history=({"reason": "first"},))
FOLDER = origin("it's new")


def marked(mark: str, **fields: object) -> Comparison:
    one = row(mark, new={} if mark == "!" else {"pq": 0.5})
    return comparison(one, **({"base": BASELINE, "new": FOLDER} | fields))


@given(comparisons())
def test_something_where_it_fails_and_nothing_where_it_is_fine(found) -> None:
    shown, last = text(found), text(found).split("\n\n")[-2].split("\n")
    if found.status == 0:
        assert not advice(found)
        assert "next: " not in last[0][:6]
        assert "\nNext: " not in markdown(found)
        return
    assert last[0] == f"next: {advice(found)}"
    assert last[1:] == ([f"    {renewal(found)}"] if renewal(found) else [])
    assert markdown(found).split("\n\n")[2] == f"Next: {advice(found)}"
    assert shown.count("\n    gapeval baseline ") <= 1


@pytest.mark.parametrize("mark", ["+", "!", "x"])
def test_a_baseline_can_be_renewed(mark: str) -> None:
    said = shlex.split(renewal(marked(mark)))
    assert said == ["gapeval", "baseline", "it's new", "-o", "ci/my base.csv", "--reason", "..."]
    assert advice(marked(mark)).endswith(":")


@pytest.mark.parametrize(
    "found",
    [
        marked("+", base=FOLDER),
        marked("x", base=FOLDER),
        marked("+", new=BASELINE),  # a baseline is made from a folder
        marked("x", new=origin("summary.csv", scorer="")),  # of which nothing is known
        marked("-"),
    ],
)
def test_nothing_is_advised_that_fails(found: Comparison) -> None:
    assert renewal(found) == ""
    assert not advice(found).endswith(":")


def test_what_failed_is_swept_again_first() -> None:
    found = marked("+")
    failed = replace(found, rows=(row("!", reasons=("NEW: 2 frames failed: damaged",)), *found.rows))
    assert renewal(failed) == ""
    assert "gapeval sweep --resume" in advice(failed)


def test_the_advice_can_be_followed(results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert gapeval("baseline", results, "-o", "my base.csv").status == 0
    worse = copied(results, tmp_path / "worse $(now)")
    edited(worse, lambda line: line | {"pq": "0.01"} if line["pq"] else line)
    found = gapeval("compare", "my base.csv", worse.name)
    assert found.status == 3
    (command,) = (line for line in found.out.split("\n") if line.startswith("    gapeval baseline "))
    assert gapeval(*shlex.split(command)[1:]).status == 0
    assert gapeval("compare", "my base.csv", worse.name).status == 0
