"""Baselines that somebody has damaged: errors in one line, and never a pass."""

from pathlib import Path

import pytest
from command import gapeval
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from result_folders import above, copied, is_one_line, kept, missed, with_above

from gapeval.compare.baseline import COLUMNS
from gapeval.compare.outcome import FINE

RANDOM = settings(
    deadline=None,
    derandomize=True,
    max_examples=40,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.fixture
def new(results: Path, tmp_path: Path) -> Path:
    return copied(results, tmp_path / "new")


@pytest.fixture
def made(results: Path, tmp_path: Path) -> Path:
    path = tmp_path / "baseline.csv"
    assert kept(results, path).status == 0
    return path


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.sampled_from(["log", "reason"]), inner),
    max_leaves=3,
)
ABOVE = ("kind", "version", "history", "gapeval", "revision", "source", "scorer", "scoring", "logs")


@RANDOM
@given(name=st.sampled_from(ABOVE), value=VALUES, is_removed=st.booleans())
def test_anything_above_the_table_is_no_bug_of_ours(
    new: Path, made: Path, name: str, value: object, is_removed: bool
) -> None:
    whole = made.read_bytes()
    try:
        document = {key: of for key, of in above(made).items() if key != name or not is_removed}
        with_above(made, document if is_removed else document | {name: value})
        if not (new / "worse").exists():
            missed(new)
            (new / "worse").touch()
        for pair in ((made, new), (made, made)):
            for form in ("text", "junit"):
                done = gapeval("compare", *pair, "--format", form)
                assert done.status in (0, 1, 3, 4)
                assert not done.err or is_one_line(done.err), done.err
                assert done.status != FINE or pair[1] is made
    finally:
        made.write_bytes(whole)


@RANDOM
@given(data=st.data())
def test_a_damaged_table_never_passes_and_is_no_bug_of_ours(
    new: Path, made: Path, data: st.DataObject
) -> None:
    whole = made.read_text()
    if not (new / "worse").exists():
        missed(new)
        (new / "worse").touch()
    start = whole.index("\nlog,") + 1
    place = data.draw(st.integers(start, len(whole) - 1))
    length = data.draw(st.integers(0, 3))
    put = data.draw(st.sampled_from(["", '"', ",", "\n", "x", "[", "<<<<<<< HEAD\n", "\0", "é"]))
    try:
        made.write_text(whole[:place] + put + whole[place + length :], encoding="utf-8")
        done = gapeval("compare", made, new)
        assert done.status in (1, 3, 4)
        assert done.status != 1 or is_one_line(done.err)
    finally:
        made.write_text(whole)


@pytest.mark.parametrize("column", ["hit", "missed"])
@pytest.mark.parametrize("text", ["5", '"a"', "{}", "[", "true"])
def test_lists_of_labels_that_are_none(new: Path, made: Path, column: str, text: str) -> None:
    head, _, rest = made.read_text().partition("\nlog,")
    name, *lines = ("log," + rest).rstrip("\n").split("\n")
    cells_of = lines[-1].split(",")[: len(COLUMNS) - 2]
    quoted = '"' + text.replace('"', '""') + '"'
    lines[-1] = ",".join([*cells_of, *((quoted, "") if column == "hit" else ("", quoted))])
    made.write_text("\n".join([head, name, *lines]) + "\n")
    done = gapeval("compare", made, new)
    assert done.status == 1
    assert is_one_line(done.err)
