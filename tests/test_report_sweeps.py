"""What a report makes of a sweep's rows: the recommendation, curves, the front, the choice of frames."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gapeval.report.curves.heat import Heat
from gapeval.report.curves.panel import Panel
from gapeval.report.curves.scatter import Scatter
from gapeval.report.sweeps.frames import choose
from gapeval.report.sweeps.front import candidates, dominated, front, front_exhibit
from gapeval.report.sweeps.parameters import curves, heat_maps, label
from gapeval.report.sweeps.recommendation import difference, reason, recommend
from gapeval.report.sweeps.results import Results, values_of
from gapeval.report.sweeps.times import Times
from gapeval.results.tables import PARAMETERS
from gapeval.results.written import Row

SAME = dict.fromkeys(PARAMETERS, "") | {"k": "6", "i_height": "65", "i_width": "65", "pl_th": "0.1"}


def row(name: str, **cells: object) -> dict[str, str]:
    """A row of summary.csv, of all logs together."""
    found = SAME | {"log": "all", "configuration": name, "frames": "4", "asked": "4"}
    return found | {key: str(value) for key, value in cells.items()}


def results(rows: Sequence[Row]) -> Results:
    return Results(Path("somewhere"), {"logs": [{"log": "a"}], "labels": []}, tuple(rows))


def test_the_interval_of_the_best_says_what_is_as_good() -> None:
    rows = [
        row("far", pq=0.49, pq_low=0.4, pq_high=0.6, hit_rate=1.0, fp_per_frame=0.0),
        row("best", pq=0.6, pq_low=0.5, pq_high=0.7, hit_rate=0.8, fp_per_frame=0.1),
        row("near", pq=0.5, pq_low=0.4, pq_high=0.6, hit_rate=0.9, fp_per_frame=2.0),
        row("nearer", pq=0.55, pq_low=0.5, pq_high=0.6, hit_rate=0.9, fp_per_frame=1.0),
    ]
    found = recommend(rows)
    assert found is not None
    assert (found.row["configuration"], found.best["configuration"]) == ("nearer", "best")
    assert (found.least, found.by_interval, found.candidates) == (0.5, True, 3)
    words = reason(found, 4)
    assert "0.500 to 0.700" in words
    assert "3 of 4 reach that" in words
    assert "0.550" in words


def test_without_an_interval_what_is_near_the_best_is_as_good() -> None:
    rows = [
        row("far", pq=0.579, hit_rate=1.0, fp_per_frame=0.0, pq_low=""),
        row("near", pq=0.581, hit_rate=0.9, fp_per_frame=5.0, pq_low=""),
        row("best", pq=0.6, hit_rate=0.8, fp_per_frame=0.1, pq_low=""),
    ]
    found = recommend(rows)
    assert found is not None
    assert (found.row["configuration"], found.by_interval) == ("near", False)
    assert "no interval" in reason(found, 3)


def test_equal_ones_are_told_apart_by_size_then_by_what_the_best_is_chosen_by_then_by_order() -> None:
    equal = {"pq": 0.6, "hit_rate": 1.0, "fp_per_frame": 0.0, "coverage": 0.7}
    large = row("large", **equal, i_height=129, over_area=0.0)
    wide, first, second = (
        row(name, **equal, over_area=area) for name, area in (("wide", 9), ("a", 1), ("b", 1))
    )
    for order in itertools.permutations([large, wide, first, second]):
        found = recommend(order)
        assert found is not None
        assert found.row is min(first, second, key=order.index)


def test_without_labels_nothing_is_recommended() -> None:
    assert recommend([row("a", pq="", hit_rate="")]) is None
    alone = recommend([row("a", pq=0.0, hit_rate=0.0, fp_per_frame=1.0)])
    assert alone is not None
    assert "nothing was chosen" in reason(alone, 1)


def grid(**varied: Sequence[object]) -> list[dict[str, str]]:
    """All combinations; every metric tells which row it is of."""
    rows = []
    for number, values in enumerate(itertools.product(*varied.values())):
        cells = dict(zip(varied, values, strict=True))
        metrics = {
            "f1": number / 100,
            "hit_rate": number / 50,
            "fp_per_frame": 10 - number,
            "over_area": number + 0.5,
        }
        rows.append(row(str(number), **cells, **metrics))
    return rows


def test_a_curve_varies_one_parameter_and_has_the_best_of_each_value_behind_it() -> None:
    rows = grid(delta_r=(2.0, 1.05, 1.1), n_o=(1, 0))
    base = rows[2]  # delta_r 1.05, n_o 1
    by_name = {exhibit.name: exhibit for exhibit in curves(results(rows), base, "summary.csv")}
    assert set(by_name) == {"against-delta_r", "against-n_o"}
    f1, _, false, area = by_name["against-delta_r"].drawings
    assert isinstance(f1, Panel)
    assert f1.categories == ("1.05", "1.1", "2.0")
    best, alone = f1.lines
    assert [point.y for point in alone.points] == [0.02, 0.04, 0.0]
    assert [point.y for point in best.points] == [0.03, 0.05, 0.01]
    assert f1.mark == 0
    assert isinstance(false, Panel)
    assert [point.y for point in false.lines[1].points] == [8, 6, 10]
    assert [point.y for point in false.lines[0].points] == [7, 5, 9]
    assert isinstance(area, Panel)
    assert [point.y for point in area.lines[0].points] == [2.5, 4.5, 0.5]  # less is better
    assert "rows with log = all, n_o = 1;" in by_name["against-delta_r"].source
    assert by_name["against-n_o"].table.rows[0][:3] == ("0", "0.03", "0.05")


def test_an_interval_goes_with_its_point() -> None:
    rows = [
        row("a", n_o=0, f1=0.5, f1_low=0.4, f1_high=0.7),
        row("b", n_o=1, f1=0.6, f1_low="", f1_high=""),
        row("c", n_o=2, f1="", f1_low="", f1_high=""),
    ]
    (exhibit,) = curves(results(rows), rows[0], "summary.csv")
    panel = exhibit.drawings[0]
    assert isinstance(panel, Panel)
    alone = panel.lines[-1]
    assert [(p.x, p.y, p.low, p.high) for p in alone.points] == [(0, 0.5, 0.4, 0.7), (1, 0.6, None, None)]
    assert exhibit.table.rows[0][1] == "0.5 (0.4 to 0.7)"
    assert exhibit.table.rows[2][1] == "-"


def test_maps_have_the_right_value_in_every_cell() -> None:
    rows = grid(delta_r=(1.05, 1.1, 2.0), n_o=(0, 1), pl_th=(0.05, 0.1))
    base = rows[7]
    exhibit = heat_maps(results(rows), base, "summary.csv")
    assert exhibit is not None
    assert len(exhibit.drawings) == 3
    for heat in exhibit.drawings:
        assert isinstance(heat, Heat)
        held = {"delta_r", "n_o", "pl_th"} - {name.split()[0] for name in (heat.x_label, heat.y_label)}
        for (j, y), (i, x) in itertools.product(enumerate(heat.y), enumerate(heat.x)):
            (here,) = [
                r
                for r in rows
                if r[heat.x_label.split()[0]] == x
                and r[heat.y_label.split()[0]] == y
                and all(r[name] == base[name] for name in held)
            ]
            assert heat.values[j][i] == float(here["f1"])
        i, j = heat.mark
        assert heat.values[j][i] == float(base["f1"])
        assert heat.scale == (
            min(float(r[1]) for r in exhibit.table.rows),
            max(float(r[1]) for r in exhibit.table.rows),
        )


def test_resolution_varies_once() -> None:
    by_k = [row("a", k=5, i_height=33, i_width=33), row("b", k=6)]
    assert results(by_k).varied == ("k",)
    by_width = [row("a", k="", i_width=33), row("b", k="", i_width=65)]
    assert results(by_width).varied == ("i_width",)
    half = [row("a", k=5, i_height=33, i_width=65), row("b", k=6)]
    assert results(half).varied == ("i_height",)


def test_values_are_in_the_order_of_numbers_or_of_the_grid() -> None:
    rows = [row("a", eta="", edge="zero"), row("b", eta=10.0, edge="data"), row("c", eta=9.0, edge="zero")]
    assert values_of(rows, "eta") == ("", "9.0", "10.0")
    assert values_of(rows, "edge") == ("zero", "data")
    assert (label("pl_th"), label("n_o")) == ("pl_th [m]", "n_o")


@given(
    st.lists(
        st.tuples(*(st.integers(0, 3) for _ in range(3))),
        min_size=1,
        max_size=12,
    )
)
def test_the_front_is_what_no_other_beats(aims: list[tuple[int, int, int]]) -> None:
    naive = [
        any(all(o <= a for o, a in zip(other, one, strict=True)) and other != one for other in aims)
        for one in aims
    ]
    assert dominated(np.array(aims, dtype=np.float64)).tolist() == naive


def test_times_that_are_nearly_equal_do_not_keep_a_worse_one_on_the_front() -> None:
    rows = [
        row("good", hit_rate=1.0, fp_per_frame=0.0, pq=0.5, n_o=1),
        row("worse", hit_rate=0.9, fp_per_frame=0.0, pq=0.5, n_o=2),
        row("quick", hit_rate=0.9, fp_per_frame=0.5, pq=0.5, n_o=3),
        row("empty", hit_rate="", fp_per_frame=0.0, pq="", n_o=4),
    ]
    seconds = {"good": 2.00e-3, "worse": 1.99e-3, "quick": 1.0e-3, "empty": 1e-6}
    best = front(candidates(rows, seconds))
    assert [one.row["configuration"] for one in best] == ["good", "quick"]
    without = front(candidates(rows, {}))
    assert [one.row["configuration"] for one in without] == ["good"]
    advised = recommend(rows)
    assert advised is not None
    shown = front_exhibit(results(rows), advised, Times({}, "a", 0, missing="no log"), "s.csv", "t.csv")
    assert shown is not None
    assert "No times: no log." in shown.caption
    assert "t.csv" not in shown.source


def frame(stamp: int, asked: int, hits: int, false: int, scored: int = 1) -> dict[str, str]:
    cells = {"log": "a", "stamp": stamp, "asked": asked, "hits": hits, "false_gaps": false}
    return {name: str(value) for name, value in (cells | {"scored_frames": scored, "gaps": hits}).items()}


def test_the_worst_have_most_faults_and_the_best_most_hits() -> None:
    rows = [
        frame(1, 2, 2, 0),
        frame(2, 2, 1, 4),  # 5 faults
        frame(3, 3, 3, 0),
        frame(4, 3, 0, 0),  # 3
        frame(5, 0, 0, 0),
        frame(6, 9, 9, 9, scored=0),  # not labelled: not scored
        frame(7, 2, 2, 1),
        frame(8, 2, 2, 2),
    ]
    chosen = choose(rows)
    assert [(one.stamp, one.kind) for one in chosen] == [
        (2, "worst"),
        (4, "worst"),
        (8, "worst"),
        (3, "best"),
    ]
    assert chosen[0].why == "1 of 2 labels hit, 4 false gaps"
    assert chosen[-1].why == "3 of 3 labels hit, no false gap"


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([], []),
        ([frame(1, 1, 1, 0)], [(1, "best")]),
        ([frame(1, 1, 0, 0)], [(1, "worst")]),
        ([frame(1, 1, 0, 0), frame(2, 1, 1, 1)], [(1, "worst"), (2, "best")]),
        ([frame(1, 3, 3, 1), frame(2, 3, 3, 1), frame(3, 0, 0, 0, 0)], [(1, "alike")]),
        ([frame(1, 3, 3, 0), frame(2, 3, 3, 0)], [(1, "alike")]),
        (
            [frame(1, 3, 3, 1), frame(2, 3, 3, 1), frame(3, 2, 2, 1)],
            [(3, "worst"), (1, "worst"), (2, "best")],
        ),
        ([frame(1, 0, 3, 0, 0), frame(2, 0, 5, 0, 0)], [(2, "most")]),
    ],
)
def test_every_number_of_frames_has_its_choice(
    rows: list[dict[str, str]], expected: list[tuple[int, str]]
) -> None:
    assert [(one.stamp, one.kind) for one in choose(rows)] == expected


def test_every_row_of_the_table_has_its_number_at_its_place() -> None:
    rows = [
        row("sure", hit_rate=1.0, fp_per_frame=3.0, pq=0.59, n_o=0),
        row("also", hit_rate=1.0, fp_per_frame=3.0, pq=0.4, n_o=1),
        row("third", hit_rate=1.0, fp_per_frame=3.0, pq=0.3, n_o=2),
        row("fourth", hit_rate=1.0, fp_per_frame=3.0, pq=0.3, n_o=3),
        row("best", hit_rate=0.8, fp_per_frame=0.5, pq=0.6, n_o=4),
        row("beaten", hit_rate=0.7, fp_per_frame=0.5, pq=0.1, n_o=5),
    ]
    advised = recommend(rows)
    assert advised is not None
    shown = front_exhibit(results(rows), advised, Times({}, "a", 0, missing="no log"), "s.csv", "t.csv")
    assert shown is not None
    assert shown.table.head == (
        "no.", "", "time [ms]", "hit_rate", "fp_per_frame", "pq", "n_o", "configuration"
    )  # fmt: skip
    listed = [(line[0], line[1], line[-1]) for line in shown.table.rows]
    assert listed == [
        ("1", "recommended", "sure"),
        ("2", "", "also"),
        ("3", "", "third"),
        ("4", "", "fourth"),
        ("5", "highest pq", "best"),
    ]
    (scatter,) = shown.drawings
    assert isinstance(scatter, Scatter)
    assert [(dot.x, dot.y, dot.name) for dot in scatter.dots if dot.name] == [
        (3.0, 1.0, "1 recommended, 2 to 4"),
        (0.5, 0.8, "5 highest pq"),
    ]
    assert [(dot.x, dot.y) for dot in scatter.dots if dot.kind is None] == [(0.5, 0.7)]
    assert scatter.mark == (3.0, 1.0)
    assert "Ringed: no. 1, the recommended configuration; no. 5 has the highest pq." in shown.caption


def test_what_is_marked_is_numbered_even_where_others_beat_it() -> None:
    rows = [
        row("a", hit_rate=0.9, fp_per_frame=1.0, pq=0.6),
        row("b", hit_rate=0.9, fp_per_frame=0.5, pq=0.1),
    ]
    advised = recommend(rows)
    assert advised is not None
    shown = front_exhibit(results(rows), advised, Times({}, "a", 0, missing="no log"), "s.csv", "t.csv")
    assert shown is not None
    assert [line[:2] for line in shown.table.rows] == [("1", ""), ("2", "recommended, highest pq")]
    assert "No. 2 is beaten by others here" in shown.caption


def test_of_a_long_front_the_caption_says_what_has_no_number() -> None:
    rows = [row(str(i), hit_rate=i / 40, fp_per_frame=i, pq=i / 100, n_o=i) for i in range(30)]
    advised = recommend(rows)
    assert advised is not None
    shown = front_exhibit(results(rows), advised, Times({}, "a", 0, missing="no log"), "s.csv", "t.csv")
    assert shown is not None
    assert "end with the first 24; large markers without a number are the rest" in shown.caption
    (scatter,) = shown.drawings
    assert isinstance(scatter, Scatter)
    named = [dot for dot in scatter.dots if dot.name]
    assert len(named) == len(shown.table.rows) == 24
    assert sum(dot.kind is not None for dot in scatter.dots) == 30


def test_the_configuration_of_the_highest_pq_is_held_against_the_recommended_one() -> None:
    sure = row("sure", pq=0.59, hit_rate=1.0, fp_per_frame=2.625)
    best = row("best", pq=0.6, hit_rate=0.875, fp_per_frame=0.125)
    assert difference(sure, best) == (
        "The configuration of the highest pq is best: 0.125 false gaps per frame against 2.625 here, and a "
        "hit rate of 0.875 against 1; take it where a false gap costs more than a missed label."
    )
    assert difference(sure, {**best, "fp_per_frame": "3.0"}).endswith("a hit rate of 0.875 against 1.")
