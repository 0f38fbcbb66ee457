"""A comparison as Markdown: tables that hold, whatever the names are."""

import html
import re

import pytest
from comparisons import TEXTS, comparison, comparisons, for_people, large, realistic, row
from hypothesis import example, given

from gapeval.compare.outcome import Comparison, LabelChange
from gapeval.report.comparisons.markdown import code, markdown
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import LABELS, ROWS, pair, plain

Table = list[list[str]]


def tables(text: str) -> list[Table]:
    """Cells of each, without the line below the head. No cell of ours has a `|` in it, escaped or not."""
    found: list[Table] = []
    for block in text.rstrip("\n").split("\n\n"):
        lines = block.split("\n")
        if lines[0].startswith("| "):
            assert all(line.startswith("| ") and line.endswith(" |") for line in lines)
            found.append([line[2:-2].split(" | ") for line in lines[:1] + lines[2:]])
            assert re.fullmatch(r"(\| --- )+\|", lines[1])
            assert lines[1].count("---") == len(found[-1][0])
    return found


def words(cell: str) -> str:
    """What a cell says."""
    if cell.startswith("<code>"):
        inside = cell.removeprefix("<code>").removesuffix("</code>")
        assert not set(inside) & set("<>`|\\*_[]")
        return html.unescape(inside)
    assert cell.count("`") in (0, 2)
    return cell.strip("`")


def with_columns(found: Comparison, *names: str) -> list[Table]:
    return [table for table in tables(markdown(found)) if {*names} <= {*table[0]}]


@example("a`b")
@example("a|b")
@example("a\\")
@example(" a")
@given(TEXTS)
def test_any_text_can_be_read_back(text: str) -> None:
    assert words(code(text)) == plain(text)
    assert "|" not in code(text)


@given(comparisons())
def test_every_line_of_a_table_has_all_its_cells(found) -> None:
    for table in tables(markdown(found)):
        assert {len(line) for line in table} == {len(table[0])}


@given(comparisons())
def test_a_line_for_each_changed_figure_in_the_order_of_the_data(found) -> None:
    """But for counts that nothing is held against, and for what says the same as another line."""
    changes = [(one, change) for one in found.rows for change in for_people(one)]
    after = 3 + len(found.varied)
    lines = [line for table in with_columns(found, "metric", "noise") for line in table[1:]]
    for line, (one, change) in zip(lines, changes, strict=True):
        names = [one.log, one.configuration, *(one.parameters[name] for name in found.varied)]
        assert [words(cell) for cell in line[:after]] == [change.mark.strip(), *map(plain, names)]
        assert tuple(line[after + 1 : after + 3]) == pair(change.base, change.new)
        assert words(line[after]).startswith(plain(change.metric))


def has_times(found: Comparison) -> bool:
    """Of both sides, or any that is marked."""
    sides = {side for time in found.times for side in ("base", "new") if getattr(time, side)}
    return len(sides) == 2 or any(time.mark not in " ~" for time in found.times)


@given(comparisons())
def test_the_verdict_comes_first_and_folds_are_closed(found) -> None:
    lines = markdown(found).split("\n")
    assert lines[:3] == ["## gapeval compare", "", f"**{verdict(found)}**"]
    folds = [line for line in lines if line.startswith(("<details>", "</details>"))]
    assert [line[:9] for line in folds] == (["<details>", "</details"] if has_times(found) else [])


@pytest.mark.parametrize(
    "line",
    [
        "* `numpy 2.4.6 in BASE, 2.5.0 in NEW`",
        "| `!` | `missing in NEW` | 1 | `street.mcap` | `f3a8ce15674c n_o=2 pl_th=0.4` |",
        "| `+` | `pq` | 2 of 7 rows | - | 0 of 1 | 0.5 -> 0.48 "
        "| `street.mcap` | `a013f6f3d667` | `1` | `0.1` |",
        "Only better: `over_area` in 1 row, `fp_per_frame` in 1 row",
        "| `+` | `street.mcap` | `5ed457beaf20` | `1` | `0.4` | 4-9, 12 (7 frames) | gaps 31 -> 28 |",
        "Next: the reasons say what differs; put back what is a mistake, or renew the baseline "
        "(docs/ci.md says more):",
        '    gapeval baseline results -o baseline.csv --reason "..."',
        "| `street.mcap` | `5ed457beaf20` | `1` | `0.4` | `trench` | hit | 4-9 | missed |",
        "| `+` | `street.mcap` | `time` | 2.1 -> 4 | 2.4 -> 4.5 | 1.9 (0.5 ms more allowed) |",
        "| BASE | `baseline.csv` | `0.1.0` | `97c42f3e97c4` | `1d1d1d1d1d1d` | `2` |",
        "| `tunnel.mcap` | `a901a901a901` | `0b0c0b0c0b0c -> 1c1d1c1d1c1d` |",
        "Latest reason in the history of BASE: `holes are kept now`",
    ],
)
def test_a_real_one_says(line: str) -> None:
    assert markdown(realistic()).split("\n").count(line) == 1


def test_some_rows_and_labels_and_how_many_more() -> None:
    assert "\n\n... and 31 more rows; `--format csv` has all\n" in markdown(large(ROWS + 31, 2))
    labels = tuple(LabelChange(f"g{index}", "hit", "missed", (1,), (1,)) for index in range(LABELS + 3))
    assert "| ... and 3 more |" in markdown(comparison(row("+", labels=labels)))
