"""Which rows are held against each other, and why others are not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command import gapeval
from result_folders import (
    ALL,
    BEST,
    IDS,
    by_mark,
    cells,
    compared,
    copied,
    edited,
    is_one_line,
    manifest,
    table,
    the_row,
    without,
    write_table,
)
from small_logs import drive, feature, labels, trench_ring

from gapeval.compare import marks
from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSION
from gapeval.results.tables import PARAMETERS


@pytest.fixture
def new(results: Path, tmp_path: Path) -> Path:
    return copied(results, tmp_path / "new")


def test_nothing_has_changed(results: Path, new: Path) -> None:
    found = compared(results, new)
    assert (found.status, marks(found)) == (FINE, {" ": 12})
    assert found.notices == ()
    assert [row.was for row in found.rows] == [row.configuration for row in found.rows]


# Missing rows


def test_a_row_that_is_missing_is_a_regression_and_a_new_one_is_not(results: Path, tmp_path: Path) -> None:
    fewer = without(results, tmp_path / "fewer", configuration=BEST)
    rows = [("a.mcap", BEST), ("b.mcap", BEST), (ALL, BEST)]
    found = compared(results, fewer)
    assert (found.status, by_mark(found, "!")) == (REGRESSION, rows)
    assert {row.reasons for row in found.rows if row.mark == "!"} == {("not in NEW",)}
    found = compared(fewer, results)
    assert (found.status, by_mark(found, "*")) == (FINE, rows)
    assert {row.reasons for row in found.rows if row.mark == "*"} == {("not in BASE",)}


def test_each_row_counts_by_itself(results: Path, tmp_path: Path) -> None:
    for number, row in enumerate(table(results / "summary.csv")):
        where = {name: row[name] for name in ("log", "configuration")}
        found = compared(results, without(results, tmp_path / str(number), **where))
        assert (found.status, by_mark(found, "!")) == (REGRESSION, [tuple(where.values())])


def test_rows_in_any_order(results: Path, new: Path) -> None:
    write_table(new / "summary.csv", table(new / "summary.csv")[::-1])
    assert marks(compared(results, new)) == {" ": 12}
    edited(new, cells({"log": "b.mcap", "configuration": BEST}, pq=0.1))
    assert by_mark(compared(results, new), "+") == [("b.mcap", BEST)]


def test_a_row_that_is_there_twice_is_an_error(results: Path, new: Path) -> None:
    """Else the second would hide what the first says."""
    rows = table(new / "summary.csv")
    write_table(new / "summary.csv", [rows[1] | {"pq": "0.1"}, *rows])
    for pair in ((results, new), (new, results)):
        done = gapeval("compare", *pair)
        assert (done.status, done.out) == (1, "")
        assert is_one_line(done.err)
        assert f"a.mcap, {BEST}" in done.err


# Failed units


def failing(*names: str) -> Callable[[dict[str, Any]], object]:
    entries = [{"log": name, "frames": 3, "reason": "it rained"} for name in names]
    return lambda document: document.update(failed=entries)


def test_a_log_that_failed_now_is_a_regression(results: Path, new: Path) -> None:
    found = compared(results, manifest(new, failing("b.mcap")))
    assert found.status == REGRESSION
    assert by_mark(found, "!") == [(log, name) for log in ("b.mcap", ALL) for name in IDS]
    assert the_row(found, "b.mcap", BEST).reasons == ("NEW: 3 frames failed: it rained",)
    assert the_row(found, ALL, BEST).reasons == ("b.mcap: NEW: 3 frames failed: it rained",)


def test_a_log_that_failed_before_is_mended(results: Path, new: Path) -> None:
    edited(new, cells({"log": "b.mcap"}, pq=0.0))
    found = compared(manifest(copied(results, new.parent / "base"), failing("b.mcap")), new)
    assert (found.status, marks(found)) == (FINE, {"*": 8, " ": 4})


def test_a_log_that_failed_in_both_is_a_regression_as_is_a_worse_figure_of_another(
    results: Path, new: Path
) -> None:
    base = manifest(copied(results, new.parent / "base"), failing("b.mcap"))
    manifest(new, failing("b.mcap"))
    assert marks(compared(base, new)) == {"!": 8, " ": 4}
    edited(new, cells({"log": "a.mcap", "configuration": BEST}, pq=0.1))
    assert by_mark(compared(base, new), "+") == [("a.mcap", BEST)]


# Not comparable


def set_all(document: dict[str, Any], name: str, value: object) -> None:
    for entry in document["logs"]:
        entry[name] = value


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda document: document.update(scorer=1), "other scorer: version 2 -> 1"),
        (lambda document: document["scoring"].update(iou=0.4), "scoring.iou: 0.5 -> 0.4"),
        (lambda document: document["scoring"].pop("iou"), "scoring.iou: 0.5 -> -"),
        (lambda document: document["scoring"].update(mine=1), "scoring.mine: - -> 1"),
        (
            lambda document: document["scoring"]["domain"].update(r_max=10.0),
            "scoring.domain: {x_min: 0.6, r_max: 3.0} -> {x_min: 0.6, r_max: 10.0}",
        ),
        (lambda document: document.pop("scoring"), "what NEW was made from is not known"),
        (lambda document: set_all(document, "labels", "1c" * 32), "other labels: "),
        (lambda document: set_all(document, "labels", None), "-> none"),
        (lambda document: set_all(document, "sha256", "0d" * 32), "other contents of the log: "),
    ],
)
def test_what_was_made_otherwise_is_not_comparable_row_by_row(
    results: Path, new: Path, edit: Callable[[dict[str, Any]], object], said: str
) -> None:
    manifest(new, edit)
    edited(new, cells({"log": "a.mcap", "configuration": BEST}, pq=0.1))
    for pair in ((results, new), (new, results)):
        found = compared(*pair)
        assert (found.status, marks(found)) == (NOT_COMPARABLE, {"x": 12})
        assert all(row.reasons and not row.changes for row in found.rows)
    assert all(any(said in reason for reason in row.reasons) for row in compared(results, new).rows)


def test_how_wide_blocks_are_changes_no_figure(results: Path, new: Path) -> None:
    manifest(new, lambda document: document["scoring"].update(block=1.0))
    assert compared(results, new).status == FINE


@pytest.mark.parametrize(("name", "said"), [("labels", "other labels"), ("sha256", "other contents")])
def test_regressions_of_the_other_log_are_listed_all_the_same(
    results: Path, new: Path, name: str, said: str
) -> None:
    manifest(new, lambda document: document["logs"][1].update({name: "1c" * 32}))
    edited(new, cells({"configuration": BEST}, pq=0.1))
    found = compared(results, new)
    assert found.status == NOT_COMPARABLE
    assert by_mark(found, "x") == [(log, name) for log in ("b.mcap", ALL) for name in IDS]
    assert by_mark(found, "+") == [("a.mcap", BEST)]
    assert all(said in row.reasons[0] for row in found.rows if row.mark == "x")
    assert the_row(found, ALL, BEST).reasons[0].startswith("b.mcap: ")


def test_an_incomparable_log_that_failed_is_both_named(results: Path, new: Path) -> None:
    """4, and the regression of the other log in the same report."""
    manifest(new, lambda document: document["logs"][1].update(labels="1c" * 32))
    manifest(new, failing("a.mcap"))
    found = compared(results, new)
    assert (found.status, marks(found)) == (NOT_COMPARABLE, {"x": 8, "!": 4})
    assert len(the_row(found, ALL, BEST).reasons) == 2


# Other sweeps


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Sweeps over one small log, each once."""
    folder = tmp_path_factory.mktemp("small")
    log, drawn = drive(folder / "a.mcap", 3), labels(folder / "labels.geojson")
    made: dict[tuple[object, ...], Path] = {}

    def sweep(*options: object, labelled: Path = drawn) -> Path:
        out = folder / str(len(made))
        if (found := made.get((options, labelled))) is not None:
            return found
        done = gapeval("sweep", log, "--labels", labelled, *options, "-o", out, "--jobs", 1)
        assert done.status == 0, done.err
        return made.setdefault((options, labelled), out)

    return sweep


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("-p", "scoring.iou=0.4"), "scoring.iou: 0.5 -> 0.4"),
        (("-p", "r_max=3,4"), "scoring.domain: {x_min: 0.6, r_max: 3.0} -> {x_min: 0.6, r_max: 4.0}"),
    ],
)
def test_other_scoring_of_a_real_sweep(
    small: Callable[..., Path], options: tuple[str, ...], said: str
) -> None:
    found = compared(small(), small(*options))
    assert found.status == NOT_COMPARABLE
    assert {row.reasons for row in found.rows} == {(said,)}


def test_other_labels_of_a_real_sweep(small: Callable[..., Path], tmp_path: Path) -> None:
    ring = [[x + 0.1, y, z] for x, y, z in trench_ring()]
    other = small(labelled=labels(tmp_path / "other.geojson", [feature(ring)]))
    found = compared(small(), other)
    assert found.status == NOT_COMPARABLE
    assert all(row.reasons[0].startswith("other labels: ") for row in found.rows)


def test_what_is_no_column_may_be_swept(small: Callable[..., Path], tmp_path: Path) -> None:
    """Rows that their columns do not tell apart are joined by the configuration's id."""
    plane = ("-p", "plane=patch", "-p")
    base, shallow = small(*plane, "detector.patch.depth=0.5,1.0"), small(*plane, "detector.patch.depth=0.5")
    assert len({tuple(row[name] for name in PARAMETERS) for row in table(base / "summary.csv")}) == 1
    assert marks(compared(base, base)) == {" ": 2}
    found = compared(base, shallow)
    assert (found.status, marks(found)) == (REGRESSION, {"!": 1, " ": 1})
    found = compared(shallow, base)
    assert (found.status, marks(found)) == (FINE, {"*": 1, " ": 1})
    for number, row in enumerate(table(base / "summary.csv")[:2]):
        new = copied(base, tmp_path / str(number))
        edited(new, cells({"log": row["log"], "configuration": row["configuration"]}, under_coverage=2.0))
        assert by_mark(compared(base, new), "+") == [(row["log"], row["configuration"])]


def test_another_robot_is_said_and_compared(small: Callable[..., Path]) -> None:
    found = compared(small(), small("-p", "robot.body={x: [-0.3, 0.3], y: [-0.2, 0.2], z: [0, 1]}"))
    (row,) = found.rows
    assert row.was != row.configuration
    assert row.mark != "x"
    assert "another configuration id" in found.notices[0]


def test_a_column_of_parameters_that_is_missing_joins_by_the_others(results: Path, new: Path) -> None:
    edited(new, lambda row: {name: text for name, text in row.items() if name != "min_observed"})
    assert marks(compared(results, new)) == {" ": 12}
    assert marks(compared(new, results)) == {" ": 12}


def test_a_figure_that_base_does_not_know_is_said(results: Path, new: Path) -> None:
    edited(new, lambda row: {name: text for name, text in row.items() if name != "over_coverage"})
    found = compared(new, results)
    assert (found.status, marks(found)) == (FINE, {" ": 12})
    assert found.notices == ("BASE has no column over_coverage: not compared",)


def test_a_figure_that_new_does_not_have_is_a_regression(results: Path, new: Path) -> None:
    edited(new, lambda row: {name: text for name, text in row.items() if name != "over_coverage"})
    found = compared(results, new)
    assert (found.status, marks(found)) == (REGRESSION, {"!": 12})
    assert {change.metric for row in found.rows for change in row.changes} == {"over_coverage"}
    assert found.notices == ("NEW has no column over_coverage",)
