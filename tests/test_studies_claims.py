"""Verdicts follow from figures and rules; figures from rows."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gapeval.errors import ConfigError
from gapeval.studies.claims import DOES_NOT, HOLDS, NOT_MEASURED, PARTLY, check_rules, judge
from gapeval.studies.columns import check_columns
from gapeval.studies.definition import Claim, Figure, Run, Study
from gapeval.studies.estimates import Estimate
from gapeval.studies.figures import evaluated
from gapeval.studies.rows import Row, with_best

GOOD = ("pq", "hit_rate", "fp_per_frame", "coverage", "over_area", "npca_accuracy")
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


def two_scenes(tunnel: Estimate, street: Estimate) -> list[Row]:
    return [row({"f1": tunnel}, scene="tunnel", k=6), row({"f1": street}, scene="street", k=6)]


@pytest.mark.parametrize("wanting", ["tunnel", "street"])
def test_one_interval_that_is_wanting_is_said(wanting) -> None:
    """In whichever condition, and in whichever of both rules."""
    sure, unsure = Estimate(0.7, 0.6, 0.8), Estimate(0.7)
    rows = two_scenes(*((unsure, sure) if wanting == "tunnel" else (sure, unsure)))
    assert verdict(claim("f1.low > 0.5", by="scene", f1=F1), *rows).basis == "values alone"
    partly = claim("f1.value > 0.9", "f1.low > 0.5", by="scene", f1=F1)
    assert verdict(partly, *rows).basis == "values alone"


def test_what_is_undefined_wants_no_interval() -> None:
    rows = two_scenes(Estimate(0.7, 0.6, 0.8), Estimate(None))
    assert verdict(claim("f1.low > 0.5", by="scene", f1=F1), *rows).basis == "intervals"


def test_an_interval_that_no_rule_asks_for_is_not_wanting() -> None:
    asked = claim("late.low > 0.5 and e.value > 0.5", late=F1, e={"of": "pq"})
    assert verdict(asked, row({"f1": Estimate(0.7, 0.6, 0.8), "pq": 0.7})).basis == "intervals"


def test_one_undefined_figure_is_enough_for_not_measured() -> None:
    asked = claim("f1.value > 0", f1=F1, pq={"of": "pq"})
    assert verdict(asked, row({"f1": 0.7, "pq": None})).verdict == NOT_MEASURED
    assert verdict(asked, row({"f1": None, "pq": 0.7})).verdict == NOT_MEASURED


def test_conditions_are_those_of_where_and_among() -> None:
    """Of rows that fit `where`; of values in `among` each is asked, there or not."""
    rows = [
        row({"f1": 0.9}, k=6, d=1.0), row({"f1": 0.1}, k=6, d=2.0),
        row({"f1": 0.1}, k=7, d=1.0), row({"f1": 0.1}, k=7, d=3.0),
    ]  # fmt: skip
    asked = claim("f1.value > 0.5", by="d", where={"k": 6}, f1=F1)
    assert verdict(asked, *rows).conditions == "k 6; holds: d 1; does not hold: d 2"
    assert verdict(asked, *rows).measured == "d 1: f1 0.9; d 2: f1 0.1"
    among = asked.model_copy(update={"among": (1.0, 3.0)})
    assert verdict(among, *rows).conditions == "k 6; holds: d 1; not measured: d 3"
    assert verdict(among, *rows).verdict == HOLDS


def test_only_what_has_a_counterpart_can_be_weighed() -> None:
    with pytest.raises(ConfigError, match=r"claims\.it\.w: weigh takes of: fp_per_frame or over_area"):
        check_rules("s", study(claim("w.value > 0.5", w={"of": "f1", "weigh": "k"})))


def test_a_figure_s_own_where_wins_and_the_rest_is_kept() -> None:
    """Also on the other side of a difference or a ratio."""
    rows = [row({"f1": 0.1 * k + n}, k=k, n_o=n) for k in (6, 7) for n in (0, 1)]
    where, own = {"k": 6, "n_o": 0}, {"of": "f1", "where": {"n_o": 1}}
    for figure, expected in (
        (own, 1.6),
        (own | {"minus": {"n_o": 0}}, 1.0),
        (own | {"minus": {"k": 7}}, -0.1),
        (own | {"over": {"n_o": 0}}, 1.6 / 0.6),
        (own | {"over": {"k": 7}}, 1.6 / 1.7),
    ):
        found = evaluated(Figure(**figure), where, rows)
        assert found.value == pytest.approx(expected)


def test_a_difference_has_the_interval_of_its_pairs() -> None:
    noise = np.random.default_rng(0)
    one, other = noise.normal(size=(2, 500))
    rows = [row({"f1": Estimate(0.3, draws=one)}, k=6), row({"f1": Estimate(0.1, draws=other)}, k=7)]
    for word, draws in (("minus", one - other), ("over", one / other)):
        found = evaluated(Figure(**{"of": "f1", "where": {"k": 6}, word: {"k": 7}}), {}, rows)
        assert [found.low, found.high] == pytest.approx(np.quantile(draws, [0.025, 0.975]))


def test_nothing_is_divided_by_nothing() -> None:
    rows = [row({"f1": 1.0}, k=6), row({"f1": 0.0}, k=7)]
    assert evaluated(Figure(of="f1", where={"k": 6}, over={"k": 7}), {}, rows).value is None


@pytest.mark.parametrize(("of", "sign"), [("f1", 1), ("over_area", -1), ("bin_mismatch", -1), ("median", -1)])
def test_the_best_of_draws_goes_by_the_direction_and_leaves_out_the_undefined(of, sign) -> None:
    draws = np.array([[0.5, 0.5, np.nan, np.nan] * 50, [0.6, np.nan, 0.1, np.nan] * 50])
    rows = [row({of: Estimate(0.0, draws=sign * draws[0])}, k=6),
            row({of: Estimate(sign * 0.6, draws=sign * draws[1])}, k=7), row({of: None}, k=8)]  # fmt: skip
    found = evaluated(Figure(of=of, best="k"), {}, rows)
    assert found.value == 7
    np.testing.assert_array_equal(found.draws, [7, 6, 7] * 50)  # where none is defined, none is best


@pytest.mark.parametrize(("of", "expected"), [("f1", 0.8), ("over_area", 0.3)])
def test_the_top_row_is_the_best_of_those_that_fit(of, expected) -> None:
    rows = [row({of: value}, k=6, n_o=n) for n, value in enumerate((0.5, 0.8, 0.3))]
    rows += [row({of: value}, k=7, n_o=0) for value in (0.0,)] + [row({of: 1.0}, k=7, n_o=1)]
    assert evaluated(Figure(of=of, top=True), {"k": 6}, rows).value == expected


def test_a_line_that_falls_is_as_straight_and_two_points_are_none() -> None:
    rows = [row({"median": -3.0 * n}, points=float(n)) for n in (1, 2, 5)]
    figure = Figure(of="median", fit="points")
    assert evaluated(figure, {}, rows).value == pytest.approx(1)
    assert evaluated(figure, {}, rows[:2]).value is None


def test_rows_that_differ_in_more_than_the_column_are_an_error() -> None:
    rows = [row({"f1": 0.1}, k=6, n_o=0), row({"f1": 0.2}, k=6, n_o=1)]
    with pytest.raises(ConfigError, match=r"several rows with all and equal k"):
        evaluated(Figure(of="f1", best="k"), {}, rows)


def test_true_is_not_one() -> None:
    rows = [row({"f1": 0.1}, obstacles=True), row({"f1": 0.2}, obstacles=1)]
    assert evaluated(Figure(of="f1", where={"obstacles": True}), {}, rows).value == 0.1
    assert evaluated(Figure(of="f1", where={"obstacles": 1}), {}, rows).value == 0.2


@pytest.mark.parametrize(("of", "right"), [("fp_per_frame", "hit_rate"), ("over_area", "coverage")])
def test_weighing_goes_by_size_whatever_its_sign_and_draw_by_draw(of, right) -> None:
    noise = np.random.default_rng(1)
    sizes = [0.3, -0.25, 0.2]
    good, bad = noise.uniform(0.1, 1, (2, 3, 500))
    rows = [row({right: Estimate(0.2 + size, draws=good[i]), of: Estimate(0.5, draws=bad[i])}, error=size)
            for i, size in enumerate(sizes)]  # fmt: skip

    def naive(good, bad) -> float:
        pairs = [(good[i] * bad[j], abs(sizes[i]), abs(sizes[j])) for i in range(3) for j in range(3)]
        more = sum(many * (1.0 if one < other else 0.5 * (one == other)) for many, one, other in pairs)
        return more / sum(many for many, _, _ in pairs)

    found = evaluated(Figure(of=of, weigh="error"), {}, rows)
    assert found.value == pytest.approx(naive([0.2 + size for size in sizes], [0.5] * 3))
    each = [naive(good[:, draw], bad[:, draw]) for draw in range(500)]
    assert [found.low, found.high] == pytest.approx(np.quantile(each, [0.025, 0.975]))


def test_nothing_at_all_can_be_the_best() -> None:
    rows = [row({"over_area": value}, k=k) for k, value in ((6, 0.2), (7, 0.0), (8, None))]
    assert evaluated(Figure(of="over_area", best="k"), {}, rows).value == 7


@pytest.mark.parametrize("key", ["best", "fit", "weigh", "where", "minus", "over"])
def test_every_column_that_a_figure_names_must_be_one(key) -> None:
    asked = {"of": "fp_per_frame", key: {"rol": 0.1} if key in ("where", "minus", "over") else "rol"}
    with pytest.raises(ConfigError, match=r"study s: claims\.it\.one: no column rol; there are"):
        check_columns("s", study(claim("true", one=asked)))


def test_the_best_is_marked_where_there_is_a_choice() -> None:
    """Of each scene and condition, by pq first; a group, and what was not asked, has none."""
    made = [
        Row({"scene": scene, "by": by, "roll": roll, "k": k}, dict.fromkeys(GOOD, Estimate(value)),
            {"asked": asked})
        for scene, by, roll, k, value, asked in (
            ("all", None, 0.0, 5, 0.4, 9), ("all", None, 0.0, 6, 0.5, 9), ("all", None, 0.0, 7, 0.5, 9),
            ("all", None, 0.1, 5, 0.9, 9),
            ("street", None, 0.0, 5, 0.8, 9), ("street", None, 0.0, 6, 0.7, 9),
            ("all", "label", 0.0, 5, 1.0, 9), ("all", "label", 0.0, 6, 1.0, 9),
            ("plain", None, 0.0, 5, 0.0, 0), ("plain", None, 0.0, 6, 0.0, 0),
        )
    ]  # fmt: skip
    marked = [index for index, one in enumerate(with_best(made)) if one.keys.get("best")]
    assert marked == [1, 4]
