"""Rows that have but one thing to tell, together."""

import pytest
from comparisons import comparison, comparisons, row
from hypothesis import given

from gapeval.compare.outcome import Change
from gapeval.report.comparisons.groups import NAMED, detailed, groups, members
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.text import text
from gapeval.report.comparisons.words import ROWS, plain

SCORER = "other scorer: version 1 -> 2"


def refused(log: str, number: int, first: int = 0, reason: str = SCORER, mark: str = "x") -> list:
    parameters = {"n_o": "1", "pl_th": "0.1"}
    return [
        row(mark, log=log, configuration=f"{at:012x}", parameters=parameters, reasons=(reason,))
        for at in range(first, first + number)
    ]


@given(comparisons())
def test_every_row_is_told_once(found) -> None:
    together = [one for group in groups(found.rows) for one in group.rows]
    told = [
        one for one in found.rows if one.mark != " " or one.changes or one.labels or one.reasons or one.frames
    ]
    assert sorted(map(id, together + detailed(found.rows))) == sorted(map(id, told))
    assert not any(one.changes or one.labels or one.frames for one in together)
    for group in groups(found.rows):
        assert {(one.mark, one.reasons) for one in group.rows} == {(group.mark, group.reasons)}
        named = [
            (log, configuration)
            for of in members(group, found.varied)
            for log in of.logs
            for configuration in of.configurations
        ]
        assert sorted(named) == sorted(
            (
                plain(one.log),
                " ".join(
                    [plain(one.configuration), *(plain(f"{n}={one.parameters[n]}") for n in found.varied)]
                ),
            )
            for one in group.rows
        )


def test_a_reason_is_told_once_with_its_logs_and_rows() -> None:
    rows = [*refused("a", 20), *refused("b", 20), *refused("c", 2)]
    found = comparison(*rows, row("+", (Change("pq", "+", 0.5, 0.4, 0.0),)))
    named = [f"{at:012x} n_o=1 pl_th=0.1" for at in range(NAMED)]
    lines = text(found).split("\n")
    at = lines.index(f"x  42 rows: {SCORER}")
    assert lines[at + 1 : at + 4] == [
        f"     a, b: {', '.join(named)} and 12 more configurations",
        f"     c: {', '.join(named[:2])}",
        "",
    ]
    assert text(found).count(SCORER) == markdown(found).count(SCORER) == 1
    told = ", ".join(f"`{name}`" for name in named)
    assert f"| `x` | `{SCORER}` | 42 | `a`, `b` | {told} and 12 more configurations |\n" in markdown(found)


def test_rows_that_are_told_together_are_none_of_the_worst_in_detail() -> None:
    worse = [row("+", (Change("pq", "+", 0.5, 0.4, 0.0),), configuration=f"w{at}") for at in range(ROWS + 2)]
    shown = text(comparison(*refused("a", 100), *worse))
    assert f"w{ROWS - 1}" in shown
    assert "\n... and 2 more rows; --format csv has all\n" in shown


@pytest.mark.parametrize("form", [text, markdown])
def test_of_many_reasons_and_logs_the_first(form) -> None:
    many = form(
        comparison(*(one for at in range(ROWS + 3) for one in refused("a", 2, reason=f"reason {at}.")))
    )
    assert f"reason {ROWS - 1}." in many
    assert f"reason {ROWS}." not in many
    assert "... and 6 more rows for other reasons; " in many
    logs = form(comparison(*(one for at in range(NAMED + 3) for one in refused(f"l{at}.", 2, first=at))))
    assert f"l{NAMED - 1}." in logs
    assert f"l{NAMED}." not in logs
    assert "... and 6 more rows of other logs" in logs
    alike = form(comparison(*(one for at in range(NAMED + 3) for one in refused(f"l{at}.", 2))))
    assert f"l{NAMED}." not in alike
    assert "and 3 more logs" in alike
