"""What can be compared, and files that cannot: every one of them an error in one line."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command import gapeval
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from result_folders import cells, compared, copied, edited, is_one_line, manifest, shown, table
from study_folder import write_studies

from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSION
from gapeval.compare.side import read_side

BEST = "2fb9257526a2"
RANDOM = settings(
    deadline=None,
    derandomize=True,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.fixture
def new(results: Path, tmp_path: Path) -> Path:
    return copied(results, tmp_path / "new")


def worse(folder: Path) -> Path:
    return edited(folder, cells({"log": "a.mcap", "configuration": BEST}, pq=0.1))


def refused(base: Path, new: Path) -> str:
    """What both orders say."""
    for pair in ((base, new), (new, base)):
        done = gapeval("compare", *pair)
        assert (done.status, done.out) == (1, ""), done
        assert is_one_line(done.err)
    return done.err


# Exit statuses


def test_every_exit_status_of_the_real_command(results: Path, tmp_path: Path) -> None:
    def status(*arguments: object) -> tuple[int, str, str]:
        command = [sys.executable, "-P", "-m", "gapeval", "compare", *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        return done.returncode, done.stdout.rstrip("\n").rpartition("\n")[2], done.stderr

    broken = copied(results, tmp_path / "broken")
    (broken / "summary.csv").write_text("")
    other = manifest(worse(copied(results, tmp_path / "other")), lambda document: document.update(scorer=9))
    assert status(results, results) == (0, "fine: 12 rows, none worse", "")
    assert status(results, broken)[:2] == (1, "")
    assert status(results, results, "--max-drop", "pqq=1")[:2] == (2, "")
    assert status(results, worse(copied(results, tmp_path / "worse"))) == (
        *(3, "regression: 1 of 12 rows worse", ""),
    )
    code, last, said = status(results, other)
    assert (code, said) == (4, "")
    assert last.startswith("not comparable: 12 of 12 rows")


@pytest.mark.parametrize("arguments", [(), ("one",), ("one", "two", "three"), ("one", ""), ("--formt", "md")])
def test_usage(arguments: tuple[str, ...]) -> None:
    done = gapeval("compare", *arguments)
    assert (done.status, done.out) == (2, "")


def test_the_status_is_the_same_in_every_format_and_with_a_file(results: Path, new: Path) -> None:
    worse(new)
    for form in ("text", "md", "json", "csv", "junit", "github", "bench"):
        out = new.parent / f"to/some/{form}.out"
        done = gapeval("compare", results, new, "--format", form, "-o", out)
        assert (done.status, done.out) == (REGRESSION, "")
        assert out.read_text() == gapeval("compare", results, new, "--format", form).out
        assert done.err == "regression: 1 of 12 rows worse\n"
    assert gapeval("compare", results, new, "-o", results / "summary.csv" / "x").status == 1


# What is taken


def test_a_summary_beside_its_manifest_is_the_folder(results: Path, new: Path) -> None:
    worse(new)
    status, by_folder = shown(results, new)
    for pair in ((results / "summary.csv", new / "summary.csv"), (results, new / "summary.csv")):
        one, by_table = shown(*pair)
        assert one == status == REGRESSION
        paths = [by_table[side].pop("path") for side in ("base", "new")]
        assert paths == list(map(str, pair))
        assert by_table == {
            key: value if key not in ("base", "new") else {k: v for k, v in value.items() if k != "path"}
            for key, value in by_folder.items()
        }


def test_a_table_by_itself_is_not_comparable_but_shows_its_figures(
    results: Path, new: Path, tmp_path: Path
) -> None:
    bare = tmp_path / "bare" / "summary.csv"
    bare.parent.mkdir()
    bare.write_bytes((worse(new) / "summary.csv").read_bytes())
    for pair in ((results, bare), (bare, results), (bare, bare)):
        status, document = shown(*pair)
        assert status == NOT_COMPARABLE
        assert {row["mark"] for row in document["rows"]} == {"x"}
        assert all("not known" in row["reasons"][0] for row in document["rows"])
        (row,) = [row for row in document["rows"] if (row["log"], row["configuration"]) == ("a.mcap", BEST)]
        assert 0.1 in (row["base"]["pq"], row["new"]["pq"])


def test_a_score_of_detections_can_be_compared(results: Path, tmp_path: Path) -> None:
    folder = results.parent
    found = tmp_path / "detections.geojson"
    wide = ("-p", "pl_th=0.05", "-p", "d_r=0.8")
    assert gapeval("detect", folder / "b.mcap", "-o", found, *wide).status == 0
    for out in ("one", "two"):
        done = gapeval("score", found, folder / "labels.geojson", "-o", tmp_path / out)
        assert done.status == 0, done.err
    one, two = tmp_path / "one", tmp_path / "two"
    assert shown(one, two)[0] == FINE
    edited(two, cells({}, coverage=0.01))
    assert shown(one, two)[0] == REGRESSION


def test_what_is_no_folder_of_results(results: Path, tmp_path: Path) -> None:
    assert "nowhere" in refused(results, tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    assert "name a folder of results" in refused(results, tmp_path / "empty")
    studies = write_studies(tmp_path / "studies")
    assert "name the folder of a sweep or a score" in refused(results, studies)
    for name, text in {"notes.md": "# Notes\n", "notes.txt": "no table", "binary": "\0\udcff"}.items():
        path = tmp_path / name
        path.write_bytes(text.encode("utf-8", "surrogateescape"))
        assert name in refused(results, path)
    without = copied(results, tmp_path / "without")
    (without / "manifest.json").unlink()
    assert "manifest.json" in refused(results, without)


@pytest.mark.parametrize("name", ["summary.csv", "manifest.json"])
def test_a_file_that_is_missing_or_empty(results: Path, new: Path, name: str) -> None:
    (new / name).write_bytes(b"")
    assert name in refused(results, new)
    (new / name).unlink()
    assert name in refused(results, new)


def test_a_summary_without_rows(results: Path, new: Path) -> None:
    path = new / "summary.csv"
    path.write_bytes(path.read_bytes().split(b"\n")[0] + b"\n")
    assert "no rows" in refused(results, new)


@pytest.mark.parametrize("name", ["frames.csv", "labels.csv", "timing.csv"])
def test_what_is_not_needed_may_be_missing(results: Path, new: Path, name: str) -> None:
    worse(new)
    (new / name).unlink()
    status, document = shown(results, new)
    assert status == REGRESSION
    if name != "timing.csv":
        assert name in document["rows"][0]["unknown"]
        assert name in document["rows"][0]["changes"][0]["noise"]["unknown"]


# Damage


def test_a_summary_that_is_cut_off_never_passes(results: Path, new: Path) -> None:
    """Anywhere: an error, or rows that are missing. What is cut off the last cell cannot be told."""
    whole = (results / "summary.csv").read_bytes()
    last_cell = whole.rindex(b",") + 1
    statuses = {}
    breaks = [place for place, byte in enumerate(whole[:-1]) if byte == ord("\n")]
    for size in (*range(0, last_cell, 499), *breaks, *range(last_cell - 12, len(whole))):
        (new / "summary.csv").write_bytes(whole[:size])
        done = gapeval("compare", results, new)
        statuses[size] = done.status
        assert (done.status in (1, 3)) is (size < last_cell), size
        assert done.status != 1 or is_one_line(done.err)
    assert set(statuses.values()) == {0, 1, 3}


@RANDOM
@given(st.data())
def test_frames_that_are_cut_off_change_no_verdict(results: Path, new: Path, data: st.DataObject) -> None:
    """Frames explain; figures decide."""
    worse(new)
    edited(new, cells({"log": "a.mcap", "configuration": BEST}, hit_rate=0.5))
    whole = (results / "frames.csv").read_bytes()
    size = data.draw(st.integers(0, len(whole)))
    (new / "frames.csv").write_bytes(whole[:size])
    status, document = shown(results, new)
    assert status == REGRESSION
    (row,) = [row for row in document["rows"] if row["mark"] == "+"]
    # Nothing is said of frames that are not all there, unless they are all there.
    if size < len(whole) - 3:
        assert row["unknown"] or (row["log"] == "a.mcap" and size > len(whole) // 2)
    assert all(change["noise"]["beyond"] is None for change in row["changes"])  # they do not add up


@pytest.mark.parametrize("side", ["base", "new"])
def test_labels_that_cannot_be_read_change_no_verdict(results: Path, new: Path, side: str) -> None:
    worse(new)
    edited(new, cells({"log": "a.mcap", "configuration": BEST}, hits="0"), "frames.csv")
    base = copied(results, new.parent / "base")
    path = (base if side == "base" else new) / "labels.csv"
    path.write_bytes(path.read_bytes()[:-300])
    status, document = shown(base, new)
    assert status == REGRESSION
    assert document["rows"][0]["frames"] == list(range(24))
    path.write_text("nothing\n")
    status, document = shown(base, new)
    assert status == REGRESSION
    assert "labels.csv" in document["rows"][0]["unknown"]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["log", "a", "block"]), inner)
    ),
    max_leaves=4,
)
PLACES: dict[str, Callable[[dict[str, Any], Any], object]] = {
    **{
        name: lambda document, value, name=name: document.__setitem__(name, value)
        for name in ("gapeval", "revision", "source", "scorer", "scoring", "logs", "failed")
    },
    "a log": lambda document, value: document["logs"].__setitem__(1, value),
    "sha256": lambda document, value: document["logs"][1].__setitem__("sha256", value),
    "labels": lambda document, value: document["logs"][1].__setitem__("labels", value),
    "frames": lambda document, value: document["logs"][1].__setitem__("frames", value),
    "block": lambda document, value: document["scoring"].__setitem__("block", value),
    "domain": lambda document, value: document["scoring"].__setitem__("domain", value),
}


@RANDOM
@given(place=st.sampled_from(sorted(PLACES)), value=JSON)
def test_a_manifest_with_anything_in_it_is_no_bug_of_ours(
    results: Path, new: Path, place: str, value: Any
) -> None:
    for name in ("summary.csv", "manifest.json"):
        (new / name).write_bytes((results / name).read_bytes())
    manifest(worse(new), lambda document: PLACES[place](document, value))
    for pair in ((results, new), (new, results)):
        done = gapeval("compare", *pair)
        assert done.status in (0, 1, 3, 4)
        assert not done.err or is_one_line(done.err), done.err
        if done.status == FINE:
            assert pair[0] is new  # what was worse in BASE is better now
    made = new.parent / "made.csv"
    made.unlink(missing_ok=True)
    done = gapeval("baseline", new, "-o", made)
    assert done.status == 0 or (done.status == 1 and is_one_line(done.err) and not made.exists())
    assert done.status == 1 or gapeval("compare", made, new).status in (0, 4)


@pytest.mark.parametrize("document", ["[]", "5", "null", '"text"', "{", "{}"])
def test_a_manifest_that_is_none(results: Path, new: Path, document: str) -> None:
    (new / "manifest.json").write_text(document, encoding="utf-8")
    if document == "{}":
        assert compared(results, new).status == NOT_COMPARABLE
    else:
        assert "manifest.json" in refused(results, new)


# Times


def timed(folder: Path, **values: str) -> Path:
    return edited(folder, lambda row: row | values, "timing.csv")


@pytest.mark.parametrize("name", ["median", "p95", "shared_by", "frames"])
@pytest.mark.parametrize("text", ["nan", "inf", "", "soon", "-1"])
def test_times_that_are_none_are_an_error(results: Path, new: Path, name: str, text: str) -> None:
    """They are held against limits, and nothing is more than what is no number."""
    assert "timing.csv" in refused(results, timed(new, **{name: text}))


def test_times_fail_by_their_limit_alone(results: Path, new: Path) -> None:
    slow = timed(new, median="10.0", p95="11.0")
    assert shown(results, slow)[0] == FINE
    assert shown(results, slow, "--max-rise", "time=1%")[0] == REGRESSION
    assert shown(results, slow, "--max-rise", "time.find_contours=9.0")[0] == REGRESSION
    assert shown(results, slow, "--max-rise", "time.find_contours=10.0")[0] == FINE
    assert shown(slow, results, "--max-rise", "time=0")[0] == FINE
    done = gapeval("compare", results, slow, "--max-rise", "time.find_contors=10.0")
    assert (done.status, is_one_line(done.err)) == (2, True)
    edited(slow, lambda row: None if row["stage"] == "read" and row["log"] == "b.mcap" else row, "timing.csv")
    for pair in ((results, slow), (slow, results)):
        assert shown(*pair, "--max-rise", "time.read=1000")[0] == NOT_COMPARABLE
        assert shown(*pair)[0] == FINE


def test_a_limit_on_times_that_are_not_there(results: Path, new: Path) -> None:
    (new / "timing.csv").unlink()
    for pair in ((results, new), (new, results)):
        done = gapeval("compare", *pair, "--max-rise", "time=1%")
        assert done.status == 2
        assert is_one_line(done.err)
    assert json.loads((results / "manifest.json").read_text())["configurations"] == 4
    assert len(table(results / "summary.csv")) == 12
    assert read_side(new).times == {}
