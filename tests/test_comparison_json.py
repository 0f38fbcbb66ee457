"""A comparison as JSON, read back and held against the data."""

import json
import math
from dataclasses import fields
from types import MappingProxyType
from typing import Any

from comparisons import comparison, comparisons, large, origin, realistic, row
from hypothesis import given

from gapeval.compare.outcome import MARKS, Comparison
from gapeval.report.comparisons.as_json import as_json
from gapeval.report.comparisons.verdict import verdict


def read(found: Comparison) -> dict[str, Any]:
    """Strictly: Python's reader takes NaN and Infinity, which JSON does not know."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(as_json(found), parse_constant=refuse)


def known(value: Any) -> Any:
    """The fields of the data, as JSON has them."""
    if hasattr(value, "__dataclass_fields__"):
        return {field.name: known(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict | MappingProxyType):
        return {key: known(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return [known(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def held(read: Any, data: Any) -> None:
    """All data are there, and equal; there may be more."""
    if isinstance(data, dict):
        for name, value in data.items():
            texts = [str(stamp) for stamp in value] if name == "stamps" else value
            held(read[name], texts)
    elif isinstance(data, list):
        assert len(read) == len(data)
        for one, other in zip(read, data, strict=True):
            held(one, other)
    else:
        assert read == data
        assert type(read) is type(data)


@given(comparisons())
def test_all_of_it_can_be_read_back(found) -> None:
    document = read(found)
    held(document, known(found))
    assert document["status"] == found.status
    assert document["verdict"] == verdict(found)
    assert document["marks"] == MARKS
    for shown, one in zip(document["rows"], found.rows, strict=True):
        assert [change["difference"] for change in shown["changes"]] == [c.difference for c in one.changes]
        beyond = [change["noise"] and change["noise"]["beyond"] for change in shown["changes"]]
        assert beyond == [change.noise and change.noise.beyond for change in one.changes]
    assert [time["metric"] for time in document["times"]] == [time.metric for time in found.times]


def test_no_limit_to_what_is_told() -> None:
    assert len(read(large(300, 25))["rows"]) == 300


def test_a_line_for_each_row() -> None:
    lines = as_json(realistic()).split("\n")
    assert sum(line.startswith('{"log": ') and '"changes"' in line for line in lines) == 7


def test_names_that_are_no_text_are_kept() -> None:
    """As Python gives them for files whose names are no UTF-8."""
    found = comparison(row(" ", log="a\udc80"))
    assert as_json(found).encode()
    assert read(found)["rows"][0]["log"] == "a\udc80"


def test_any_mapping_will_do() -> None:
    found = comparison(
        base=origin("a", logs=MappingProxyType({"l": "0"}), history=(MappingProxyType({"n": math.nan}),))
    )
    assert read(found)["base"]["logs"] == {"l": "0"}
    assert read(found)["base"]["history"] == [{"n": None}]
