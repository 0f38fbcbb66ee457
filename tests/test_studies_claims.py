"""Verdicts follow from figures and rules; figures from rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gapeval.errors import ConfigError
from gapeval.studies.claims import DOES_NOT, HOLDS, NOT_MEASURED, PARTLY, check_rules, judge
from gapeval.studies.definition import Claim, Figure, Run, Study
from gapeval.studies.estimates import Estimate
from gapeval.studies.rows import Row

DRAWS = np.array([0.1, 0.2, 0.3, 0.4])


def row(figures: dict[str, Estimate | float | None], **keys: object) -> Row:
    made = {name: one if isinstance(one, Estimate) else Estimate(one) for name, one in figures.items()}
    return Row({"scene": "all", "by": None, **keys}, made, {})


def study(*claims: Claim) -> Study:
    return Study(title="", paper="", question="", says="", runs=(Run(scenes=("plain",)),), claims=claims)


def claim(holds: str, partly: str = "", by: str = "", where: dict | None = None, **figures: dict) -> Claim:
    made = {name: Figure(**figure) for name, figure in figures.items()}
    return Claim(
        claim="it", section="1", words="", figures=made, holds=holds, partly=partly, by=by, where=where or {}
    )


def verdict(asked: Claim, *rows: Row):
    return judge("s", study(asked), rows)[0]


F1 = {"of": "f1"}


@pytest.mark.parametrize(
    ("value", "expected"), [(0.9, HOLDS), (0.6, PARTLY), (0.3, DOES_NOT), (None, NOT_MEASURED)]
)
def test_a_verdict_follows_from_its_rule(value, expected) -> None:
    found = verdict(claim("f1.value > 0.8", "f1.value > 0.5", f1=F1), row({"f1": value}))
    assert found.verdict == expected


def test_the_ends_of_an_interval_can_be_asked_and_are_shown() -> None:
    rows = [row({"f1": Estimate(0.7, 0.6, 0.8)})]
    assert verdict(claim("f1.low >= 0.6 and f1.high <= 0.8", f1=F1), *rows).verdict == HOLDS
    assert verdict(claim("f1.low > 0.6", f1=F1), *rows).verdict == DOES_NOT
    assert verdict(claim("true", f1=F1), *rows).measured == "f1 0.7 [0.6, 0.8]"


@pytest.mark.parametrize(
    ("rule", "low", "basis"),
    [
        ("f1.low > 0", 0.6, "intervals"),
        ("f1.low > 0", None, "values alone"),
        ("f1.value > 0", None, "intervals"),
    ],
)
def test_a_verdict_says_if_an_interval_was_wanting(rule, low, basis) -> None:
    assert verdict(claim(rule, f1=F1), row({"f1": Estimate(0.7, low, low)})).basis == basis


def test_a_figure_without_interval_is_both_its_ends() -> None:
    assert verdict(claim("f1.low == f1.value == f1.high", f1=F1), row({"f1": 0.7})).verdict == HOLDS


@pytest.mark.parametrize(
    ("tunnel", "street", "expected", "conditions"),
    [
        (0.9, 0.9, HOLDS, "holds: scene tunnel, street"),
        (0.9, 0.1, PARTLY, "holds: scene tunnel; does not hold: scene street"),
        (0.1, 0.1, DOES_NOT, "does not hold: scene tunnel, street"),
        (0.9, None, HOLDS, "holds: scene tunnel; not measured: scene street"),
        (None, None, NOT_MEASURED, "not measured: scene tunnel, street"),
    ],
)
def test_a_claim_holds_partly_where_it_holds_under_some_conditions(
    tunnel, street, expected, conditions
) -> None:
    rows = [row({"f1": 0.5}), row({"f1": tunnel}, scene="tunnel"), row({"f1": street}, scene="street")]
    found = verdict(claim("f1.value > 0.5", by="scene", f1=F1), *rows)
    assert (found.verdict, found.conditions) == (expected, conditions)


def test_rows_are_of_all_scenes_and_of_no_group_unless_asked_for() -> None:
    rows = [
        row({"f1": 1.0}, k=6),
        row({"f1": 0.0}, k=7),
        row({"f1": 0.0}, k=6, scene="street"),
        row({"f1": 0.0}, k=6, by="range", group=1.0),
    ]
    assert verdict(claim("f1.value == 1", f1={"of": "f1", "where": {"k": 6}}), *rows).verdict == HOLDS
    group = {"of": "f1", "where": {"by": "range", "group": 1.0, "k": 6}}
    assert verdict(claim("f1.value == 0", f1=group), *rows).verdict == HOLDS


def test_what_was_not_run_is_not_measured() -> None:
    asked = claim("true", f1={"of": "f1", "where": {"k": 9}})
    found = verdict(asked, row({"f1": 1.0}, k=6))
    assert (found.verdict, found.measured, found.basis) == (NOT_MEASURED, "no row with k=9", "")


def test_a_figure_of_several_rows_is_an_error() -> None:
    rows = [row({"f1": 1.0}, k=6), row({"f1": 0.0}, k=7)]
    with pytest.raises(ConfigError, match=r"2 rows with all; a figure needs one"):
        verdict(claim("true", f1=F1), *rows)


def test_differences_are_taken_draw_by_draw() -> None:
    """Two figures that vary together differ by a constant: an interval without width."""
    rows = [
        row({"f1": Estimate(0.25, 0.1, 0.4, DRAWS)}, k=6),
        row({"f1": Estimate(0.35, 0.2, 0.5, DRAWS + 0.1)}, k=7),
    ]
    gain = {"of": "f1", "where": {"k": 7}, "minus": {"k": 6}}
    asked = claim("gain.low > 0.099 and gain.high < 0.101", gain=gain)
    assert verdict(asked, *rows).verdict == HOLDS
    ratio = {"of": "f1", "where": {"k": 7}, "over": {"k": 6}}
    assert verdict(claim("r.value == 0.35 / 0.25 and r.low < r.high", r=ratio), *rows).verdict == HOLDS


@pytest.mark.parametrize(("of", "expected"), [("f1", 1.1), ("over_area", 1.05)])
def test_the_best_value_of_a_column_goes_by_the_direction_of_the_metric(of, expected) -> None:
    rows = [row({of: value}, delta_r=at) for at, value in ((1.05, 0.3), (1.1, 0.8), (1.2, 0.5))]
    asked = claim(f"b.value == {expected}", b={"best": "delta_r", "of": of})
    assert verdict(asked, *rows).verdict == HOLDS


def test_the_best_value_of_a_column_is_as_sure_as_the_draws_agree() -> None:
    rows = [
        row({"f1": Estimate(0.5, draws=np.full(100, 0.5))}, k=6),
        row({"f1": Estimate(0.6, draws=np.r_[np.full(90, 0.6), np.full(10, 0.4)])}, k=7),
    ]
    asked = claim("b.value == 7 and b.low == 6 and b.high == 7", b={"best": "k", "of": "f1"})
    assert verdict(asked, *rows).verdict == HOLDS


counts = st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=2, max_size=5)


@given(counts)
def test_weighing_is_the_probability_that_a_hit_outweighs_a_false_gap(levels) -> None:
    """Against every pair of a hit and a false gap, one by one."""
    rows = [
        row({"hit_rate": hits / 20, "fp_per_frame": false / 10}, error=float(size))
        for size, (hits, false) in enumerate(levels)
    ]
    hits = [size for size, (number, _) in enumerate(levels) for _ in range(number)]
    false = [size for size, (_, number) in enumerate(levels) for _ in range(number)]
    found = verdict(claim("true", w={"weigh": "error", "of": "fp_per_frame"}), *rows)
    if not hits or not false:
        assert found.verdict == NOT_MEASURED
        return
    expected = np.mean([1.0 if one < other else 0.5 * (one == other) for one in hits for other in false])
    assert float(found.measured.split()[1]) == pytest.approx(expected, rel=5e-3)


def test_a_straight_line_fits_itself() -> None:
    rows = [row({"median": 3.0 * n + 1}, points=float(n)) for n in (1, 2, 5)]
    asked = claim("r2.value > 0.9999", r2={"of": "median", "fit": "points"})
    assert verdict(asked, *rows).verdict == HOLDS
    bent = [row({"median": float(n**4)}, points=float(n)) for n in (1, 2, 5)]
    assert verdict(asked, *bent).verdict == DOES_NOT


def test_rules_are_read_before_anything_is_run() -> None:
    with pytest.raises(ConfigError, match=r"study s: claims\.it: f1\.value >: "):
        check_rules("s", study(claim("f1.value >", f1=F1)))


@pytest.mark.parametrize("rule", ["f1.valu > 1", "g1.value > 1", "f1.__class__.__mro__", "f1.value > 'a'"])
def test_a_rule_that_cannot_be_followed_is_an_error(rule) -> None:
    with pytest.raises(ConfigError, match=r"study s: claims\.it: "):
        verdict(claim(rule, f1=F1), row({"f1": 1.0}))
