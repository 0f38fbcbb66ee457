"""A baseline says what the folder said that it was made from; renewing it keeps its history."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from command import gapeval
from result_folders import (
    ASKED,
    above,
    cells,
    copied,
    edited,
    is_one_line,
    kept,
    manifest,
    missed,
    shown,
    swept,
    table,
    with_above,
)
from small_logs import drive

from gapeval.compare.baseline import COLUMNS
from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSION
from gapeval.results.tables import SUMMARY_COLUMNS
from gapeval.scoring.metrics import SUMS


@pytest.fixture
def new(results: Path, tmp_path: Path) -> Path:
    return copied(results, tmp_path / "new")


@pytest.fixture
def made(results: Path, tmp_path: Path) -> Path:
    path = tmp_path / "baseline.csv"
    done = kept(results, path)
    assert done.status == 0, done.err
    assert done.err.startswith(f"wrote {path}: 4 configurations on 2 logs, 144 rows of frames, ")
    return path


# The same as its folder


CHANGES: dict[str, tuple[Callable[[Path], object], int]] = {
    "nothing": (lambda folder: None, FINE),
    "missed": (missed, REGRESSION),
    "better": (lambda folder: edited(folder, cells({}, coverage=0.99)), FINE),
    "undefined": (lambda folder: edited(folder, cells({}, coverage=None)), REGRESSION),
    "row": (lambda folder: edited(folder, lambda row: None if row["log"] == "all" else row), REGRESSION),
    "other frames": (
        lambda folder: edited(
            edited(folder, cells({}, coverage=0.1)),
            lambda row: row | {"stamp": row["stamp"][:-1] + "7"},
            "frames.csv",
        ),
        REGRESSION,
    ),
    "labels": (lambda folder: manifest(folder, lambda d: d["logs"][0].update(labels="0")), NOT_COMPARABLE),
    "scoring": (lambda folder: manifest(folder, lambda d: d["scoring"].update(iou=0.1)), NOT_COMPARABLE),
    "scorer": (lambda folder: manifest(folder, lambda d: d.update(scorer=7)), NOT_COMPARABLE),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_it_says_what_its_folder_says(results: Path, new: Path, made: Path, name: str) -> None:
    change, status = CHANGES[name]
    change(new)
    of_folder, of_baseline = shown(results, new), shown(made, new)
    assert of_folder[0] == of_baseline[0] == status
    for key in ("status", "verdict", "rows", "varied", "new", "notices"):
        assert of_folder[1][key] == of_baseline[1][key], key
    known = ("gapeval", "revision", "source", "scorer", "logs", "labels")
    assert [of_folder[1]["base"][key] for key in known] == [of_baseline[1]["base"][key] for key in known]
    if name == "missed":
        row = of_baseline[1]["rows"][0]
        assert row["frames"] == row["labels"][0]["frames"] == [3, 4, 5, 6, 7, 8]
        assert row["changes"][0]["noise"]["beyond"] is True


def test_it_goes_first(results: Path, made: Path) -> None:
    """The other way round, a row that the results lack would be new, and fine."""
    done = gapeval("compare", results, made)
    assert (done.status, done.out) == (2, "")
    assert is_one_line(done.err)
    assert "goes first" in done.err


def test_two_of_them_are_compared_as_their_folders(results: Path, new: Path, made: Path) -> None:
    missed(new)
    other = made.with_name("other.csv")
    assert kept(new, other).status == 0
    assert shown(made, other)[1]["rows"] == shown(results, new)[1]["rows"]


def test_a_byte_order_mark_of_a_spreadsheet_is_no_matter(results: Path, made: Path) -> None:
    rows = shown(made, results)[1]["rows"]
    made.write_bytes(b"\xef\xbb\xbf" + made.read_bytes())
    assert shown(made, results)[1]["rows"] == rows


@pytest.mark.parametrize("line", [3, 60])
def test_a_merge_conflict_is_called_one(results: Path, made: Path, line: int) -> None:
    lines = made.read_text().splitlines(keepends=True)
    lines[line:line] = ["<<<<<<< HEAD\n", lines[line], "=======\n", lines[line], ">>>>>>> theirs\n"]
    made.write_text("".join(lines))
    done = gapeval("compare", made, results)
    assert done.status == 1
    assert is_one_line(done.err)
    assert "merge conflict" in done.err


def test_its_history_says_which_metrics_moved(results: Path, new: Path, made: Path) -> None:
    edited(new, cells({"log": "a.mcap"}, coverage=0.01))
    assert kept(new, made, "--reason", "  ").status == 2
    assert kept(new, made, "--reason", "less of it").status == 0
    last = above(made)["history"][-1]
    assert last["worse"] == {"coverage": 4}
    assert "better" not in last


def test_without_frames_the_verdict_is_the_same(results: Path, new: Path, tmp_path: Path) -> None:
    path = tmp_path / "small.csv"
    assert kept(results, path, "--without-frames").status == 0
    missed(new)
    (status, with_frames), (same, without) = shown(results, new), shown(path, new)
    assert status == same == REGRESSION
    row = without["rows"][0]
    assert row["unknown"] == row["changes"][0]["noise"]["unknown"] == f"{path} was made without frames"
    for one, other in zip(with_frames["rows"], without["rows"], strict=True):
        for row in (one, other):
            for key in ("frames", "labels", "unknown"):
                del row[key]
            for change in row["changes"]:
                del change["noise"]
        assert one == other


def test_times_are_not_kept(new: Path, made: Path) -> None:
    assert {time["base"] for time in shown(made, new)[1]["times"]} == {None}
    done = gapeval("compare", made, new, "--max-rise", "time=1%")
    assert done.status == 2
    assert is_one_line(done.err)


def test_it_holds_all_that_is_compared(made: Path, results: Path) -> None:
    of_summary = {name for name in SUMMARY_COLUMNS if not name.endswith(("_low", "_high"))} - {"best"}
    assert set(COLUMNS) == of_summary | set(SUMS) | {"stamp", "hit", "missed"}
    text = made.read_text()
    rows = list(table_of(text))
    assert len(rows) == 12 + 144
    for row, source in zip(rows, table(results / "summary.csv"), strict=False):
        assert all(row[name] == source[name] for name in of_summary | set(ASKED))
    assert above(made)["history"] == [
        {"reason": "first"} | {name: above(made)[name] for name in ("gapeval", "revision", "source")}
    ]


def table_of(text: str) -> list[dict[str, str]]:
    lines = [line.split(",") for line in text.splitlines() if not line.startswith("# ")]
    return [dict(zip(lines[0], line, strict=False)) for line in lines[1:]]


def test_the_same_bytes_twice_and_of_its_summary(results: Path, made: Path, tmp_path: Path) -> None:
    for number, source in enumerate((results, results / "summary.csv")):
        again = tmp_path / f"{number}.csv"
        assert kept(source, again).status == 0
        assert again.read_bytes() == made.read_bytes()


@pytest.mark.parametrize("ending", [b"\r\n", b"\n"])
def test_committed_with_other_line_endings(new: Path, made: Path, ending: bytes) -> None:
    missed(new)
    expected = shown(made, new)
    made.write_bytes(made.read_bytes().replace(b"\n", ending))
    assert shown(made, new) == expected


# Renewing


def test_renewing_needs_a_reason_and_keeps_history(results: Path, new: Path, made: Path) -> None:
    before = made.read_bytes()
    for options in ((), ("--reason", ""), ("--reason", "  ")):
        done = kept(results, made, *options)
        assert done.status == 2
        assert is_one_line(done.err)
        assert made.read_bytes() == before
    first = above(made)["history"]
    missed(new)
    reasons = ["worse\non purpose", "“quoted” \\ \u2028\x85 # {", "back"]
    said = []
    for folder, reason in zip((new, new, results), reasons, strict=True):
        done = kept(folder, made, "--reason", reason)
        assert done.status == 0
        said.append(done.err.partition("\n")[0])
        assert shown(made, folder)[0] == FINE
    verdicts = ["regression: 1 of 12 rows worse", *["fine: 12 rows, none worse"] * 2]
    verdicts[2] += ", 1 better"
    assert said == [f"{made}: renewed; {verdict}" for verdict in verdicts]
    history = above(made)["history"]
    assert history[:1] == first
    assert "“quoted” " in made.read_text(encoding="utf-8")  # for whoever reads the difference of two commits
    assert [entry["reason"] for entry in history] == ["first", *reasons]
    assert [entry.get("rows") for entry in history] == [None, {"+": 1}, {}, {"-": 1}]
    assert shown(made, new)[1]["base"]["history"] == history


def test_a_reason_may_be_given_at_once(results: Path, tmp_path: Path) -> None:
    path = tmp_path / "to/be/made.csv"
    assert kept(results, path, "--reason", "because").status == 0
    assert above(path)["history"][0]["reason"] == "because"


@pytest.mark.parametrize("text", ["log,configuration\na,b\n", "# Notes\n", "# {}\n", "# []\nlog\n", ""])
def test_nothing_else_is_overwritten(results: Path, tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(text)
    done = kept(results, path, "--reason", "mine")
    assert done.status == 1
    assert is_one_line(done.err)
    assert path.read_text() == text
    done = kept(results, tmp_path, "--reason", "a folder")
    assert done.status == 1
    assert is_one_line(done.err)


def test_what_failed_or_is_no_result_is_refused(new: Path, made: Path, tmp_path: Path) -> None:
    failed = [{"log": "b.mcap", "frames": 2, "reason": "it rained"}]
    before = made.read_bytes()
    manifest(new, lambda document: document.update(failed=failed))
    (tmp_path / "empty").mkdir()
    for folder in (new, tmp_path / "empty", tmp_path / "none"):
        for path in (made, tmp_path / "other.csv"):
            done = kept(folder, path, "--reason", "no")
            assert done.status == 1
            assert is_one_line(done.err)
    assert made.read_bytes() == before
    assert not (tmp_path / "other.csv").exists()
    assert "it rained" in kept(new, made, "--reason", "no").err


def test_one_of_an_earlier_version_is_compared_as_far_as_it_goes(new: Path, made: Path) -> None:
    """It lacks a metric that was thought of since, and what that is made from."""
    rows = [line for line in made.read_text().split("\n") if line.startswith("# ")]
    lines = table_of(made.read_text())
    gone = {"over_coverage", "paired_over_area_sum", "min_observed"}
    names = [name for name in COLUMNS if name not in gone and name not in ("hit", "missed")]
    body = [",".join([*names, "hit", "missed"])]
    body += [",".join([*(line[name] for name in names), "", ""]) for line in lines]
    made.write_text("\n".join([*rows, *body]) + "\n")
    status, document = shown(made, new)
    assert status == FINE
    assert document["notices"] == ["BASE has no column over_coverage: not compared"]
    assert shown(made, missed(new))[0] == REGRESSION
    done = kept(new, made, "--reason", "with the new metric")
    assert done.status == 0
    assert shown(made, new)[1]["notices"] == []
    assert [entry["reason"] for entry in above(made)["history"]] == ["first", "with the new metric"]


def test_one_that_cannot_be_read_any_more_is_renewed_with_its_history(results: Path, made: Path) -> None:
    with_above(made, above(made) | {"version": 0})
    done = gapeval("compare", made, results)
    assert done.status == 1
    assert is_one_line(done.err)
    assert "renew it" in done.err
    done = kept(results, made, "--reason", "of another version")
    assert (done.status, done.err.count("\n")) == (0, 2)
    assert [entry["reason"] for entry in above(made)["history"]] == ["first", "of another version"]
    assert shown(made, results)[0] == FINE


def test_a_log_that_was_scored_in_part_is_kept_whole(tmp_path: Path) -> None:
    """Frames that were not labelled have no sums of labels, in a baseline neither."""
    folder = swept(tmp_path, (4,), ("-p", "pl_th=0.05"))
    labels = json.loads((tmp_path / "labels.geojson").read_text())
    labels["stamps"] = [row["stamp"] for row in table(folder / "frames.csv")][1:3]
    (tmp_path / "labels.geojson").write_text(json.dumps(labels))
    log = drive(tmp_path / "a.mcap", 4)
    options = (
        "--labels",
        tmp_path / "labels.geojson",
        "-p",
        "pl_th=0.05",
        "-o",
        tmp_path / "part",
        "--jobs",
        1,
    )
    assert gapeval("sweep", log, *options).status == 0
    part = tmp_path / "part"
    assert table(part / "summary.csv")[0]["scored_frames"] == "2"
    assert kept(part, tmp_path / "part.csv").status == 0
    worse = edited(copied(part, tmp_path / "worse"), cells({}, hit_rate=0.1))
    assert shown(tmp_path / "part.csv", part)[0] == FINE
    assert shown(tmp_path / "part.csv", worse)[1]["rows"] == shown(part, worse)[1]["rows"]
