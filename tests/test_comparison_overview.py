"""Which metrics are worse in how many rows, held against counting; and what is not told twice."""

import random
from dataclasses import replace

import pytest
from comparisons import INF, NAN, comparison, comparisons, for_people, row
from hypothesis import given

from gapeval.compare.outcome import MARKS, Change, Noise, Row
from gapeval.report.comparisons import FORMATS
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.overview import only_better, standings
from gapeval.report.comparisons.text import text
from gapeval.report.comparisons.words import MIRRORS
from gapeval.scoring.metrics import SUMS, figures

BEYOND, WITHIN, UNKNOWN = Noise(-0.3, -0.1), Noise(-0.2, 0.1), Noise(NAN, NAN, "too few")


def worse(metric: str, base: float, new: float, noise: Noise | None = None) -> Change:
    return Change(metric, "+", base, new, 0.0, noise)


def named(configuration: str, *changes: Change) -> Row:
    return row(changes[0].mark if changes else " ", changes, configuration=configuration)


FOUND = comparison(
    named("a", worse("pq", 0.5, 0.4, BEYOND), Change("over_area", "-", 3.0, 2.0, 0.0)),
    named("b", worse("pq", 0.5, 0.2, WITHIN), Change("hit_rate", "!", 0.5, None, INF)),
    named("c", worse("pq", 0.5, 0.45, UNKNOWN)),
    named("d", Change("pq", "-", 0.5, 0.6, 0.0, BEYOND), Change("over_area", "-", 3.0, 1.0, 0.0)),
    named("e", Change("axis_angle", "~", 0.1, 0.2, INF)),
    row("!", configuration="f", reasons=("not in NEW",), new={}),
    varied=("n_o",),
)


def test_a_table_of_what_is_worse_and_a_line_of_what_is_better() -> None:
    """What is lost comes first; the row is the one in which a metric is worst."""
    overview = next(block for block in text(FOUND).split("\n\n") if "worse in" in block)
    assert [" ".join(line.split()) for line in overview.split("\n")[1:]] == [
        "! hit_rate 1 of 6 rows - - 0.5 -> - street.mcap b 1",
        "+ pq 3 of 6 rows 1 1 of 2 0.5 -> 0.2 street.mcap b 1",
        "only better: over_area in 2 rows",
    ]


def test_the_same_in_markdown_after_the_verdict_and_the_notices() -> None:
    blocks = markdown(replace(FOUND, notices=("read this",))).split("\n\n")
    assert [block.split("\n")[0][:20] for block in blocks[:4]] == [
        "## gapeval compare",
        "**regression: 3 of 6",
        "Next: mend it; or, w",
        "* `read this`",
    ]
    assert blocks[4].split("\n")[3] == (
        "| `+` | `pq` | 3 of 6 rows | 1 | 1 of 2 | 0.5 -> 0.2 | `street.mcap` | `b` | `1` |"
    )
    assert blocks[5] == "Only better: `over_area` in 2 rows"


@given(comparisons())
def test_as_counted(found) -> None:
    changed = [one for one in found.rows if one.changes]
    told = [(one, change) for one in changed for change in for_people(one)] if len(changed) > 1 else []
    lost = {metric: [c.mark for _, c in told if c.metric == metric] for metric in {c.metric for _, c in told}}
    expected = {m: (sum(x in "!+" for x in of), of.count("-")) for m, of in lost.items() if {*of} & {*"!+"}}
    said = standings(found.rows)
    assert {one.metric: (one.worse, one.better) for one in said} == expected
    ranks = [tuple(MARKS).index(one.change.mark) for one in said]
    assert ranks == sorted(ranks)
    for one in said:
        of_metric = [change for _, change in told if change.metric == one.metric and change.mark in "!+"]
        beyond = [change.noise.beyond for change in of_metric if change.noise is not None]
        assert (one.known, one.beyond) == (len(beyond) - beyond.count(None), beyond.count(True))
        assert one.change in one.row.changes
        assert all(tuple(MARKS).index(one.change.mark) <= tuple(MARKS).index(c.mark) for c in of_metric)
    assert only_better(found.rows) == {
        m: of.count("-") for m, of in lost.items() if "-" in of and m not in expected
    }


def test_a_single_changed_row_needs_none() -> None:
    alone = replace(FOUND, rows=(FOUND.rows[0], *FOUND.rows[-1:]))
    assert "worse in" not in text(alone) + markdown(alone)
    assert "only better" not in text(alone).lower() + markdown(alone).lower()


@pytest.mark.parametrize(("mirror", "of"), MIRRORS.items())
def test_a_mirror_says_what_another_metric_says(mirror: str, of: str) -> None:
    chance = random.Random(0)
    for _ in range(100):
        found = figures({name: chance.randint(1, 9) for name in SUMS})
        assert found[mirror] == pytest.approx(1 - found[of] if mirror == "under_coverage" else found[of])


TWICE = (worse("coverage", 0.5, 0.4), worse("under_coverage", 0.5, 0.6))
OTHERWISE = (TWICE[0], Change("under_coverage", "~", 0.5, 0.6, 0.25))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("rows", [(named("a", *TWICE),), (named("a", *TWICE), named("b", *TWICE))])
def test_people_are_told_once_and_programs_everything(rows: tuple[Row, ...], form: str) -> None:
    shown = FORMATS[form](comparison(*rows))
    assert ("under_coverage" in shown) == (form not in ("text", "md"))
    assert "coverage" in shown.replace("under_coverage", "")


@pytest.mark.parametrize("form", ["text", "md"])
def test_a_mirror_with_another_mark_is_told(form: str) -> None:
    assert "under_coverage" in FORMATS[form](comparison(named("a", *OTHERWISE)))
