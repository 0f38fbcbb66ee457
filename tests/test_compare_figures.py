"""What a moved figure means: every one of them, either way, by any amount, against any limit."""

from pathlib import Path

import pytest
from command import gapeval
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from result_folders import (
    ALL,
    ASKED,
    BEST,
    HIGHER,
    LOWER,
    NEITHER,
    cells,
    compared,
    copied,
    edited,
    is_one_line,
    shown,
    table,
    the_change,
    the_row,
)

from gapeval.compare.limits import read_limits
from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSION
from gapeval.errors import ConfigError
from gapeval.results.tables import PARAMETERS, SUMMARY_COLUMNS

RANDOM = settings(
    deadline=None,
    derandomize=True,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
FIGURES = (*HIGHER, *LOWER, *NEITHER)
TOLERANCE = 1e-9
LOG = "a.mcap"  # a row in which every figure is defined
HERE = {"log": LOG, "configuration": BEST}


def value(folder: Path, metric: str) -> float:
    (row,) = [row for row in table(folder / "summary.csv") if row.items() >= HERE.items()]
    return float(row[metric])


def moved(results: Path, tmp_path: Path, metric: str, to: float | str | None) -> Path:
    """A copy in which this figure of one row is another."""
    new = tmp_path / "new"
    if not new.exists():
        copied(results, new)
    (new / "summary.csv").write_bytes((results / "summary.csv").read_bytes())
    return edited(new, cells(HERE, **{metric: to}))


def test_every_figure_has_a_direction_here() -> None:
    others = {"log", "configuration", "best", *PARAMETERS, *ASKED}
    figures = [
        name for name in SUMMARY_COLUMNS if name not in others and not name.endswith(("_low", "_high"))
    ]
    assert sorted(figures) == sorted(FIGURES)


@RANDOM
@given(
    metric=st.sampled_from(FIGURES),
    amount=st.floats(1e-8, 1e6) | st.sampled_from([1e-8, 1.0, 0.5]),
    is_rise=st.booleans(),
)
def test_worse_fails_and_better_does_not(
    results: Path, tmp_path: Path, metric: str, amount: float, is_rise: bool
) -> None:
    before = value(results, metric)
    after = before + amount if is_rise else before - amount
    assume(abs(after - before) > 1.1 * TOLERANCE * max(1.0, abs(before), abs(after)))
    found = compared(results, moved(results, tmp_path, metric, after))
    row = the_row(found, LOG, BEST)
    (change,) = row.changes
    is_worse = metric in (LOWER if is_rise else HIGHER)
    mark = "~" if metric in NEITHER else "+" if is_worse else "-"
    assert (change.metric, change.base, change.new) == (metric, before, after)
    assert (change.mark, row.mark) == (mark, mark)
    assert found.status == (REGRESSION if is_worse else FINE)
    assert [one for one in found.rows if one is not row and one.changes] == []
    assert found.rows[0] is row


@pytest.mark.parametrize("metric", [*HIGHER, *LOWER])
def test_every_metric_fails_one_way_alone(results: Path, tmp_path: Path, metric: str) -> None:
    before = value(results, metric)
    statuses = [
        compared(results, moved(results, tmp_path, metric, before + amount)).status for amount in (-0.1, 0.1)
    ]
    assert statuses == ([REGRESSION, FINE] if metric in HIGHER else [FINE, REGRESSION])


@pytest.mark.parametrize("metric", ["pq", "fp_per_frame", "over_area", "near_edge_error", "gaps", "fp"])
@pytest.mark.parametrize("before", [0.0, 0.35, 1.0, 730.0, -0.2])
def test_the_tolerance_is_a_billionth_and_of_large_figures_a_billionth_part(
    results: Path, tmp_path: Path, metric: str, before: float
) -> None:
    base = edited(copied(results, tmp_path / "base"), cells(HERE, **{metric: before}))
    worse = -1 if metric in HIGHER else 1
    step = TOLERANCE * max(1.0, abs(before))
    for amount, is_noticed in ((0.99 * step, False), (1.01 * step, True)):
        after = before + worse * amount
        found = compared(base, moved(results, tmp_path, metric, after))
        assert bool(the_row(found, LOG, BEST).changes) is is_noticed
        fails = is_noticed and metric not in NEITHER
        assert found.status == (REGRESSION if fails else FINE)


# Limits


@RANDOM
@given(
    metric=st.sampled_from(FIGURES),
    is_drop=st.booleans(),
    number=st.floats(1e-4, 100).map(lambda number: float(f"{number:.4g}")),
    is_share=st.booleans(),
)
def test_a_limit_lets_pass_just_as_much_as_it_says(
    results: Path, tmp_path: Path, metric: str, is_drop: bool, number: float, is_share: bool
) -> None:
    assume(metric in NEITHER or (metric in HIGHER) == is_drop)
    before = value(results, metric)
    given_as = [f"{metric}={number!r}{'%' if is_share else ''}"]
    drops, rises = (given_as, []) if is_drop else ([], given_as)
    limit = abs(before) * number / 100 if is_share else number
    for beyond, status in ((0.0, FINE), (3e-9 * max(1.0, limit, before), REGRESSION)):
        after = before - (limit + beyond) if is_drop else before + (limit + beyond)
        found = compared(results, moved(results, tmp_path, metric, after), drops, rises)
        assert found.status == status
        if changes := the_row(found, LOG, BEST).changes:
            assert changes[0].mark == ("+" if status == REGRESSION else "~")
            assert changes[0].limit == pytest.approx(limit)


@pytest.mark.parametrize("metric", NEITHER)
def test_a_limit_on_a_count_holds_in_its_way_alone(results: Path, tmp_path: Path, metric: str) -> None:
    before = value(results, metric)
    fewer = moved(results, tmp_path, metric, before - 5)
    assert compared(results, fewer).status == FINE
    assert compared(results, fewer, rises=[f"{metric}=0"]).status == FINE
    assert compared(results, fewer, drops=[f"{metric}=5"]).status == FINE
    assert compared(results, fewer, drops=[f"{metric}=4.9"]).status == REGRESSION


def test_a_limit_is_of_its_metric_alone(results: Path, tmp_path: Path) -> None:
    new = edited(moved(results, tmp_path, "pq", 0.3), cells(HERE, recall=0.9))
    found = compared(results, new, ["pq=0.1"])
    row = the_row(found, LOG, BEST)
    assert {change.metric: change.mark for change in row.changes} == {"recall": "+", "pq": "~"}
    assert found.status == REGRESSION


def test_a_share_of_nothing_is_nothing(results: Path, tmp_path: Path) -> None:
    assert value(results, "shadow_gaps") == 0
    new = moved(results, tmp_path, "shadow_gaps", 0.1)
    assert compared(results, new, rises=["shadow_gaps=1000%"]).status == REGRESSION


@pytest.mark.parametrize("metric", [*HIGHER, *LOWER, "time", "time.contours"])
def test_a_limit_on_what_is_better_is_refused(results: Path, metric: str) -> None:
    option = "--max-rise" if metric in HIGHER else "--max-drop"
    done = gapeval("compare", results, results, option, f"{metric}=1%")
    assert done.status == 2
    assert is_one_line(done.err)
    assert (
        f"{metric}: a {option[6:]} is better; limit its {'drop' if metric in HIGHER else 'rise'}" in done.err
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pqq=1", "did you mean pq?"),
        ("near_edge_eror=1", "did you mean near_edge_error?"),
        ("no_such_thing_at_all=1", "docs/scoring.md"),
        ("asked=1", "no such metric"),
        ("=1", "no such metric"),
        ("pq", "how much"),
        ("pq=", "no amount"),
        ("pq=-0.1", "no amount"),
        ("pq=1 2", "no amount"),
        ("pq=nan", "no amount"),
        ("pq=inf", "no amount"),
        ("pq=1e999", "no limit"),
        ("pq=%", "no amount"),
        ("pq=0,1", "no amount"),
        ("pq=1%%", "no amount"),
        ("pq=1_0", "no amount"),
        ("pq=0x1", "no amount"),
    ],
)
def test_what_is_no_limit_is_refused(results: Path, text: str, said: str) -> None:
    done = gapeval("compare", results, results, "--max-drop", text)
    assert done.status == 2
    assert is_one_line(done.err)
    assert said in done.err


@pytest.mark.parametrize(
    ("text", "allowed"),
    [("0", 0), ("+1.5", 1.5), (".5", 0.5), ("5.", 5), ("1e-3", 0.001), ("2%", 0.08), ("2 %", 0.08)],
)
def test_amounts(text: str, allowed: float) -> None:
    limits = read_limits([f" pq = {text} "], [], {}, {})
    assert limits.allowed("pq", "drop", 4.0) == pytest.approx(allowed)
    assert limits.allowed("pq", "drop", -4.0) == pytest.approx(allowed)


def test_an_option_wins_over_the_file(results: Path, tmp_path: Path) -> None:
    new = moved(results, tmp_path, "pq", value(results, "pq") - 0.05)
    config = tmp_path / "gate.yaml"
    config.write_text("compare: {max_drop: {pq: 0.1, recall: 1%}, max_rise: {fp_per_frame: 0.5}}\n")
    assert shown(results, new)[0] == REGRESSION
    assert shown(results, new, "--config", config)[0] == FINE
    assert shown(results, new, "--config", config, "--max-drop", "pq=0.01")[0] == REGRESSION
    assert shown(results, new, "--config", config, "--max-drop", "recall=0")[0] == FINE
    more = edited(new, cells(HERE, fp_per_frame=value(results, "fp_per_frame") + 0.5))
    assert shown(results, more, "--config", config)[0] == FINE
    assert shown(results, more, "--config", config, "--max-rise", "fp_per_frame=0.1")[0] == REGRESSION


@pytest.mark.parametrize(
    "section",
    [
        *("max_rise: {pq: 0.1}", "max_drop: {pg: 0.1}", "max_drop: {pq: -1}", "max_drop: {pq: .nan}"),
        *("max_drop: {pq: .inf}", "max_drop: {pq: much}", "max_drop: [pq]", "max_drops: {pq: 1}"),
        *("max_drop: {pq: null}", "max_drop: {time: 1}"),
    ],
)
def test_limits_of_a_file_are_refused_alike(results: Path, tmp_path: Path, section: str) -> None:
    config = tmp_path / "gate.yaml"
    config.write_text(f"compare: {{{section}}}\n")
    done = gapeval("compare", results, results, "--config", config)
    assert done.status == 2
    assert is_one_line(done.err)


def test_of_two_limits_of_one_metric_the_last_holds() -> None:
    assert read_limits(["pq=1", "pq=2"], [], {"pq": 3.0}, {}).allowed("pq", "drop", 1.0) == 2.0
    with pytest.raises(ConfigError):
        read_limits(["pq=nothing", "pq=2"], [], {}, {})


# Defined and undefined


@pytest.mark.parametrize("metric", [*HIGHER, *LOWER])
def test_a_metric_that_is_no_longer_defined_is_a_regression(
    results: Path, tmp_path: Path, metric: str
) -> None:
    base = edited(copied(results, tmp_path / "base"), cells(HERE, **{metric: 0.25}))
    gone = moved(results, tmp_path, metric, None)
    for limits in ([], [f"{metric}=1000"]):
        found = compared(base, gone, *((limits, []) if metric in HIGHER else ([], limits)))
        assert the_change(the_row(found, LOG, BEST), metric).mark == "!"
        assert found.status == REGRESSION
    back = compared(gone, base)
    assert the_change(the_row(back, LOG, BEST), metric).mark == "*"
    assert back.status == FINE
    assert the_row(compared(gone, gone), LOG, BEST).changes == ()


@pytest.mark.parametrize("metric", [*HIGHER, *LOWER])
def test_where_nothing_was_right_nothing_is_lost(results: Path, tmp_path: Path, metric: str) -> None:
    """No gaps at all have no precision; but what less is better of was at its best."""
    base = edited(copied(results, tmp_path / "base"), cells(HERE, **{metric: 0.0}))
    found = compared(base, moved(results, tmp_path, metric, None))
    assert found.status == (FINE if metric in HIGHER else REGRESSION)


@pytest.mark.parametrize("metric", NEITHER)
def test_what_has_no_better_direction_may_become_undefined(
    results: Path, tmp_path: Path, metric: str
) -> None:
    assert compared(results, moved(results, tmp_path, metric, None)).status == FINE


# Not figures


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e999", "many", "0.5.1", "--", "\u0000"])
@pytest.mark.parametrize("side", ["base", "new"])
def test_what_is_no_finite_number_is_an_error(results: Path, tmp_path: Path, text: str, side: str) -> None:
    damaged = moved(results, tmp_path, "pq", text)
    pair = (damaged, results) if side == "base" else (results, damaged)
    done = gapeval("compare", *pair)
    assert (done.status, done.out) == (1, "")
    assert is_one_line(done.err)
    assert str(damaged) in done.err
    assert "pq" in done.err or text == "\u0000"


@pytest.mark.parametrize("name", ASKED)
def test_other_counts_of_what_is_asked_are_not_comparable(results: Path, tmp_path: Path, name: str) -> None:
    found = compared(results, moved(results, tmp_path, name, "7"))
    row = the_row(found, LOG, BEST)
    assert (row.mark, found.status) == ("x", NOT_COMPARABLE)
    before = f"{value(results, name):.0f}"
    assert row.reasons == (f"{name}: {before} -> 7, though labels and scoring are the same",)
    assert sum(one.mark == "x" for one in found.rows) == 1
    same = moved(results, tmp_path, name, f"{value(results, name):.3f}")  # 24.000: only written otherwise
    assert compared(results, same).status == FINE


def test_regressions_of_all_logs_are_seen_in_their_row(results: Path, tmp_path: Path) -> None:
    new = edited(copied(results, tmp_path / "new"), cells(HERE | {"log": ALL}, pq=0.1))
    found = compared(results, new)
    assert found.status == REGRESSION
    assert [row.log for row in found.rows if row.mark == "+"] == [ALL]


def test_rows_and_figures_stand_worst_first(results: Path, tmp_path: Path) -> None:
    """What is lost before what is worse, and by the largest share of any of its figures that are worse."""
    figures = dict.fromkeys((*HIGHER, *LOWER), "0.5") | {"splits": "5.0"}
    base = edited(copied(results, tmp_path / "base"), lambda row: row | figures)
    new = copied(base, tmp_path / "new")
    ids = [row["configuration"] for row in table(base / "summary.csv")[:4]]
    for name, moves in zip(
        ids,
        (
            {"pq": 0.4, "recall": 0.45, "fp_per_frame": 0.0, "gaps": 9000},
            {"pq": 0.49, "recall": 0.2, "coverage": 0.51},
            {"sq": None, "pq": 0.499},
            {"pq": 0.9, "gaps": 9000, "splits": 6.0, "over_area": 9.0, "f1": 0.3},
        ),
        strict=True,
    ):
        edited(new, cells({"log": LOG, "configuration": name}, **moves))
    rows = [row for row in compared(base, new).rows if row.changes]
    assert [row.configuration for row in rows] == [ids[2], ids[3], ids[1], ids[0]]
    assert [[change.metric for change in row.changes] for row in rows] == [
        ["sq", "pq"],
        ["over_area", "f1", "splits", "pq", "gaps"],
        ["recall", "pq", "coverage"],
        ["pq", "recall", "fp_per_frame", "gaps"],
    ]
