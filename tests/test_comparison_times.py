"""Times that only one side has say nothing."""

import pytest
from comparisons import INF, comparison, row

from gapeval.compare.outcome import Spread, Time
from gapeval.report.comparisons.as_csv import as_csv
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.text import text

SOME = Spread(0.001, 0.002, 9)


def shown(*times: Time) -> tuple[str, ...]:
    found = comparison(row(" "), times=times)
    return text(found), markdown(found), as_csv(found)


@pytest.mark.parametrize(("base", "new"), [(None, SOME), (SOME, None)])
def test_of_one_side_alone_nothing_is_shown(base: Spread | None, new: Spread | None) -> None:
    alone = [Time("a.mcap", stage, " ", base, new, INF) for stage in ("time", "scene")]
    for one in shown(*alone):
        assert "scene" not in one
        assert "a.mcap" not in one
        assert "other stage" not in one
    for one in shown(*alone, Time("a.mcap", "match", "x", base, new, 0.1)):
        assert "match" in one
        assert "scene" not in one
        assert "other stage" not in one


def test_where_both_have_times_a_stage_of_one_is_counted() -> None:
    times = (Time("a.mcap", "time", " ", SOME, SOME, INF), Time("a.mcap", "scene", " ", None, SOME, INF))
    for_terminal, page, table = shown(*times)
    assert "1 other stage in BASE or NEW alone" in for_terminal
    assert "1 other stage in BASE or NEW alone" in page
    assert "scene" not in table
    assert "\na.mcap,,,, ,time,0.001,0.001,0.0," in table
