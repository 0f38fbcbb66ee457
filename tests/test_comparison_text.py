"""A comparison for the terminal: what must be said, in which order, and what must not."""

import math
import re
from dataclasses import replace
from itertools import pairwise

import pytest
from comparisons import INF, SHORT, comparison, comparisons, for_people, large, origin, realistic, row
from hypothesis import given
from hypothesis import strategies as st

from gapeval.compare.outcome import Change, LabelChange, Noise, Spread, Time
from gapeval.report.comparisons.text import text
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import LABELS, ROWS, RUNS, figure, frames_run, pair, plain

REAL = text(realistic())
LINES = [" ".join(line.split()) for line in REAL.split("\n")]
FLOATS = st.floats(-1e300, 1e300)


@pytest.mark.parametrize(
    "line",
    [
        "BASE baseline.csv 0.1.0 97c42f3e97c4 1d1d1d1d1d1d 2",
        "NEW results 0.1.0 0badc0de0bad+changes 2e2e2e2e2e2e 2",
        "street.mcap 5f3c5f3c5f3c 77aa77aa77aa",
        "tunnel.mcap a901a901a901 0b0c0b0c0b0c -> 1c1d1c1d1c1d",
        "yard.mcap - -> eeeeeeeeeeee -",
        "latest reason in the history of BASE: holes are kept now",
        "notice: numpy 2.4.6 in BASE, 2.5.0 in NEW",
        "+ street.mcap 5ed457beaf20 1 0.4 hit_rate 0.95 0.8 -0.15 beyond noise",
        "+ pq 0.6667 0.66668 -2e-05 within noise",
        "- over_area [m2] 7.748 6.5 -1.248 beyond noise",
        "counts: gaps 31 -> 28",
        "changed in frames 4-9, 12 (7 frames)",
        "gap `trench` was hit in frames 4-9, now missed",
        "gap `kerb | `low`` was not asked for in frame 12, now hit",
        "+ street.mcap a013f6f3d667 1 0.1 pq 0.5 0.48 -0.02 (0.01 allowed) -",
        f"noise is not known: {SHORT}",
        "changed frames are not known: BASE has no frames",
        "+ street.mcap time 2.1 -> 4 2.4 -> 4.5 1.9 (0.5 ms more allowed)",
        "~ street.mcap contours 0.5 -> 1.5 0.6 -> 2 3",
        "~ tunnel.mcap time 2 -> 1.9 2.4 -> 2.2 0.95",
        "1 other stage within the spread of their own samples, 1 other stage in BASE or NEW alone",
        "not comparable: 1 of 7 rows; 4 regressions besides",
    ],
)
def test_a_real_one_says(line: str) -> None:
    assert LINES.count(line) == 1


def test_a_real_one_names_rows_below_their_reasons() -> None:
    at = LINES.index("x 1 row: labels differ: 0b0c0b0c0b0c in BASE, 1c1d1c1d1c1d in NEW")
    assert LINES[at + 1] == "tunnel.mcap: e38b37806118 n_o=0 pl_th=0.05"
    assert LINES[at + 2] == "! 1 row: missing in NEW"
    assert LINES[at + 3] == "street.mcap: f3a8ce15674c n_o=2 pl_th=0.4"


def test_what_is_worse_comes_before_what_is_new() -> None:
    blocks = REAL.split("\n\n")
    starts = [
        "   metric",
        "x  1 row",
        "   log ",
        "*  1 row",
        "   log ",
        "x  not comparable",
        "next: ",
        "not comp",
    ]
    assert [one[: len(start)] for one, start in zip(blocks[4:7] + blocks[8:], starts, strict=True)] == starts


def test_marks_that_occur_are_explained_and_no_others() -> None:
    legend = REAL.rstrip("\n").split("\n\n")[-3].split("\n")
    assert [line[:3] for line in legend] == ["x  ", "!  ", "+  ", "-  ", "*  ", "~  "]
    only_better = comparison(row("-", (Change("pq", "-", 0.5, 0.6, 0.0),)))
    assert text(only_better).rstrip("\n").split("\n\n")[-2] == "-  better"


def test_nothing_changed() -> None:
    same = text(comparison(row(" "), row(" ", log="all")))
    assert "\n\nNo figure changed.\n\nfine: 2 rows, none worse\n" in same


@given(comparisons())
def test_every_line_can_be_shown_and_the_last_is_the_verdict(found) -> None:
    lines = text(found).split("\n")
    assert all(line.isprintable() for line in lines)
    assert lines[-1] == ""
    assert lines[-2] == verdict(found)


@given(comparisons())
def test_a_line_for_each_changed_figure_in_the_order_of_the_data(found) -> None:
    """Told by their marks, and by base and new. But for counts that nothing is held against, and mirrors."""
    expected = [
        (change.mark, *pair(change.base, change.new)) for one in found.rows for change in for_people(one)
    ]
    block = text(found).split("\n\n")
    lines = [line for part in block for line in part.split("\n")]
    at = 0
    for mark, base, new in expected:
        while not (
            lines[at].startswith(f"{mark}  ") and f"  {base}  " in lines[at] and f"  {new}  " in lines[at]
        ):
            at += 1
        at += 1


@given(comparisons())
def test_the_order_in_which_logs_are_known_does_not_matter(found) -> None:
    turned = replace(
        found,
        base=replace(found.base, logs=dict(reversed(found.base.logs.items()))),
        new=replace(found.new, labels=dict(reversed(found.new.labels.items()))),
    )
    assert text(turned) == text(found)


def test_some_rows_in_detail_and_how_many_more() -> None:
    assert "more row" not in text(large(ROWS, 2))
    assert "... and 1 more row; --format csv has all\n" in text(large(ROWS + 1, 2))
    many = text(large(ROWS + 31, 2))
    assert "\n... and 31 more rows; --format csv has all\n" in many
    assert len(re.findall(r"^\+  street", many, re.M)) == ROWS
    assert len(re.findall(r"^\+  ", many, re.M)) == 2 * ROWS + 3  # two in the overview, one in the legend
    assert f"{ROWS - 1:012x}" in many
    assert f"{ROWS:012x}" not in many
    assert many.endswith(f"\nregression: {ROWS + 31} of {ROWS + 31} rows worse\n")


def test_some_labels_of_a_row_and_how_many_more() -> None:
    labels = tuple(LabelChange(f"g{index}", "hit", "missed", (1,), (1,)) for index in range(LABELS + 3))
    shown = text(comparison(row("+", labels=labels)))
    assert f"gap `g{LABELS - 1}` was hit in frame 1, now missed\n" in shown
    assert f"`g{LABELS}`" not in shown
    assert "... and 3 more changes of labels; --format json has all\n" in shown


def test_a_reason_that_many_share_is_told_once() -> None:
    rows = [
        row("+", (Change("pq", "+", 0.5, 0.4, 0.0, Noise(math.nan, math.nan, SHORT)),), log=f"{i}")
        for i in range(5)
    ]
    assert text(comparison(*rows)).count(SHORT) == 1


@pytest.mark.parametrize(
    ("base", "new", "mark", "shown"),
    [
        (Spread(1, 1.5, 9), Spread(1.4, 2, 9), "~", False),
        (Spread(1, 1.5, 9), Spread(1.6, 2, 9), "~", True),
        (Spread(1.6, 2, 9), Spread(1, 1.5, 9), " ", True),
        (Spread(1, 1.5, 9), Spread(1.4, 2, 9), "+", True),
        (None, Spread(1, 1.5, 9), "~", False),
        (Spread(1, 1.5, 9), None, "!", True),
    ],
)
def test_stages_are_told_that_their_samples_or_their_marks_tell_apart(base, new, mark, shown) -> None:
    known = Spread(1, 2, 9)
    times = (Time("a", "time", " ", known, known, INF), Time("a", "scene", mark, base, new, INF))
    found = text(comparison(times=times))
    assert bool(re.search(r"^.? *a +scene", found, re.M)) == shown
    assert ("1 other stage" in found) != shown


def test_digests_that_begin_alike_are_shown_in_full() -> None:
    base, new = origin("a", logs={"l": "0" * 64}), origin("b", logs={"l": "0" * 63 + "1"})
    assert f"{'0' * 64} -> {'0' * 63}1" in text(comparison(base=base, new=new))


@given(FLOATS, FLOATS)
def test_figures_that_differ_look_different(base: float, new: float) -> None:
    shown = pair(base, new)
    assert (shown[0] == shown[1]) == (base == new)
    if figure(base) != figure(new):
        assert shown == (figure(base), figure(new))
    assert [float(word) for word in shown] == [pytest.approx(base, rel=5e-4), pytest.approx(new, rel=5e-4)]


@given(st.lists(st.integers(0, 60), min_size=1, unique=True).map(sorted))
def test_frames_as_runs(frames: list[int]) -> None:
    shown, _, more = frames_run(frames).partition(" and ")
    runs = [[int(end) for end in run.split("-")] for run in shown.split(", ")]
    told = [frame for run in runs for frame in range(run[0], run[-1] + 1)]
    assert told == frames[: len(told)]
    assert int(more.removesuffix(" more") or 0) == len(frames) - len(told)
    assert len(runs) <= RUNS
    assert all(later[0] > earlier[-1] + 1 for earlier, later in pairwise(runs))
    assert not more or len(runs) == RUNS


@given(st.text())
def test_plain_text_can_be_read_back(words: str) -> None:
    assert plain(words).isprintable()
    if "\\" not in words:
        spelt = re.sub(r"[^\x00-\x7f]", lambda c: c[0].encode("unicode_escape").decode(), plain(words))
        assert spelt.encode().decode("unicode_escape") == words


W, B = Change("pq", "+", 0.5, 0.4, 0.0), Change("f1", "-", 0.5, 0.6, 0.0)
LOST = Change("sq", "!", 0.5, None, 0.0)
SLOW = Time("a", "time", "+", Spread(1, 1, 1), Spread(2, 2, 1), 0.1)


@pytest.mark.parametrize(
    ("found", "line"),
    [
        (comparison(row(" ")), "fine: 1 row, none worse"),
        (comparison(row("-", (B,)), row("~")), "fine: 2 rows, none worse, 1 better"),
        (comparison(row("+", (W, B)), row("!", new={})), "regression: 1 of 2 rows worse, 1 missing"),
        (comparison(row("!", new={}), row(" ")), "regression: 1 of 2 rows missing"),
        (comparison(row("!", (LOST,))), "regression: 1 of 1 row with figures no longer defined"),
        (comparison(row("!", reasons=("NEW: 2 frames failed",))), "regression: 1 of 1 row incomplete"),
        (comparison(row(" "), times=(SLOW,)), "regression: 1 time over its limit"),
        (
            comparison(row("+", (W,)), times=(SLOW, SLOW)),
            "regression: 1 of 1 row worse, 2 times over their limit",
        ),
        (comparison(row("x"), row("+", (W,))), "not comparable: 1 of 2 rows; 1 regression besides"),
        (comparison(row("x"), row("-", (B,))), "not comparable: 1 of 2 rows; no regression besides"),
        (
            comparison(row(" "), times=(replace(SLOW, mark="x"),)),
            "not comparable: 1 time; no regression besides",
        ),
    ],
)
def test_verdicts(found, line: str) -> None:
    assert verdict(found) == line


@given(comparisons())
def test_a_verdict_begins_as_the_exit_status_says(found) -> None:
    assert verdict(found).split(":")[0] == {0: "fine", 3: "regression", 4: "not comparable"}[found.status]
