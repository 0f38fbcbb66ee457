"""A comparison as JUnit XML: valid, and every row in it."""

import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
from comparisons import INF, comparison, comparisons, large, realistic, row
from hypothesis import given
from xmlschema import XMLSchema

from gapeval.compare.outcome import Change, Comparison, Spread, Time
from gapeval.report.comparisons.junit import junit
from gapeval.report.comparisons.verdict import marks, verdict
from gapeval.report.comparisons.words import plain

SCHEMA = XMLSchema(str(Path(__file__).parent / "junit.xsd"))


def suite(found: Comparison) -> ElementTree.Element:
    """Read from bytes, as others read it."""
    root = ElementTree.fromstring(junit(found).encode())
    SCHEMA.validate(root)
    (only,) = root
    return only


def outcome(case: ElementTree.Element) -> str:
    return case[0].tag if len(case) else "passed"


@given(comparisons())
def test_it_is_valid_and_has_a_case_for_each_row_and_each_limit(found) -> None:
    read = suite(found)
    cases = read.findall("testcase")
    rows, times = cases[: len(found.rows)], cases[len(found.rows) :]
    for one, case in zip(found.rows, rows, strict=True):
        of_all = marks(one)
        expected = "error" if "x" in of_all else "failure" if of_all & {"!", "+"} else "passed"
        assert outcome(case) == expected
        assert case.attrib["classname"] == plain(one.log)
        parameters = [f"{name}={one.parameters[name]}" for name in found.varied]
        assert case.attrib["name"] == plain(" ".join([one.configuration, *parameters])).strip()
    limited = [time for time in found.times if math.isfinite(time.limit) or time.mark in "x!+"]
    assert [case.attrib["name"] for case in times] == [plain(time.metric).strip() for time in limited]
    outcomes = [outcome(case) for case in cases]
    assert read.attrib["tests"] == str(len(cases))
    assert read.attrib["errors"] == str(outcomes.count("error"))
    assert read.attrib["failures"] == str(outcomes.count("failure"))
    status = 4 if "error" in outcomes else 3 if "failure" in outcomes else 0
    assert status == found.status
    assert read.findtext("system-out").endswith(verdict(found))


def test_a_real_one() -> None:
    cases = suite(realistic()).findall("testcase")
    assert [(case.attrib["classname"], case.attrib["name"], outcome(case)) for case in cases] == [
        ("tunnel.mcap", "e38b37806118 n_o=0 pl_th=0.05", "error"),
        ("street.mcap", "f3a8ce15674c n_o=2 pl_th=0.4", "failure"),
        ("street.mcap", "5ed457beaf20 n_o=1 pl_th=0.4", "failure"),
        ("street.mcap", "a013f6f3d667 n_o=1 pl_th=0.1", "failure"),
        ("all", "5ed457beaf20 n_o=1 pl_th=0.4", "passed"),
        ("yard.mcap", "5ed457beaf20 n_o=1 pl_th=0.4", "passed"),
        ("yard.mcap", "b71a05984bbd n_o=1 pl_th=0.4", "passed"),
        ("street.mcap", "time", "failure"),
    ]
    fault = cases[2][0]
    assert fault.attrib["message"] == "worse: hit_rate 0.95 -> 0.8, -0.15, beyond noise (and 3 more lines)"
    assert fault.text.split("\n") == [
        "worse: hit_rate 0.95 -> 0.8, -0.15, beyond noise",
        "worse: pq 0.6667 -> 0.66668, -2e-05, within noise",
        "gap `trench` was hit in frames 4-9, now missed",
        "gap `kerb | `low`` was not asked for in frame 12, now hit",
        "changed in frames 4-9, 12 (7 frames)",
    ]


def test_every_figure_that_is_worse_is_named() -> None:
    (case,) = suite(large(1, 25)).findall("testcase")
    assert case[0].text.count("worse: ") == 25


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        (Time("a", "time", " ", Spread(1, 1, 1), Spread(2, 2, 1), INF), []),
        (Time("a", "time", " ", Spread(1, 1, 1), Spread(2, 2, 1), 1.5), ["passed"]),
        (Time("a", "time", "+", Spread(1, 1, 1), Spread(2, 2, 1), 0.0), ["failure"]),
        (Time("a", "scene", "x", None, None, 0.0), ["error"]),
    ],
)
def test_times_are_held_against_limits_alone(time, expected) -> None:
    assert [outcome(case) for case in suite(comparison(times=(time,))).findall("testcase")] == expected


def test_what_is_worse_in_a_row_that_is_not_comparable_is_told_all_the_same() -> None:
    found = comparison(row("x", (Change("pq", "+", 0.5, 0.4, 0.0),), reasons=("other labels",)))
    (case,) = suite(found).findall("testcase")
    assert outcome(case) == "error"
    assert case[0].text == "not comparable: other labels\nworse: pq 0.5 -> 0.4, -0.1"


def test_where_both_come_from_stands_among_the_properties() -> None:
    suite = ElementTree.fromstring(junit(realistic()))[0]
    told = {one.get("name"): one.get("value") for one in suite.iter("property")}
    assert told["BASE.revision"] == "97c42f3e97c4"
    assert told["street.mcap.sha256"] == "5f3c5f3c5f3c"
    assert told["tunnel.mcap.labels"] == "0b0c0b0c0b0c -> 1c1d1c1d1c1d"
