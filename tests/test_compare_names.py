"""Logs that are called differently in BASE and NEW, and folders that are not what they seem."""

import subprocess
import sys
from pathlib import Path

import pytest
from command import gapeval
from result_folders import GRID, compared, copied, edited, is_one_line, kept, manifest, missed, shown, the_row
from small_logs import drive, labels

from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSION


@pytest.fixture
def new(results: Path, tmp_path: Path) -> Path:
    return copied(results, tmp_path / "new")


def called(folder: Path, **names: str) -> Path:
    """As if its logs had been called otherwise when they were swept: `a_mcap="x.mcap"`."""
    new = {log.replace("_", "."): name for log, name in names.items()}
    for file in ("summary.csv", "frames.csv", "labels.csv", "timing.csv"):
        edited(folder, lambda row: row | {"log": new.get(row["log"], row["log"])}, file)

    def rename(document: dict) -> None:
        for entry in document["logs"]:
            entry["log"] = new.get(entry["log"], entry["log"])

    return manifest(folder, rename)


def test_a_log_of_another_name_is_found_by_its_contents(results: Path, new: Path) -> None:
    missed(new)
    before = compared(results, new)
    found = compared(results, called(new, a_mcap="logs/x.mcap"))
    assert found.rows == before.rows
    assert before.rows[0].labels  # so that they were looked up under the other name
    assert [time.log for time in found.times] == [time.log for time in before.times]
    assert [notice for notice in found.notices if notice not in before.notices] == [
        "a.mcap: NEW calls it logs/x.mcap; it is found by its contents, which are the same"
    ]


def test_all_of_them(results: Path, new: Path) -> None:
    found = compared(results, called(new, a_mcap="u/a.mcap", b_mcap="v/b.mcap"))
    assert found.status == FINE
    assert len(found.notices) == 2


def test_names_go_before_contents(results: Path, new: Path) -> None:
    """Where each has the other's name, each is another log."""
    found = compared(results, called(new, a_mcap="b.mcap", b_mcap="a.mcap"))
    assert found.status == NOT_COMPARABLE
    assert "other contents" in the_row(found, "a.mcap", found.rows[0].configuration).reasons[0]


def test_what_is_there_twice_is_not_guessed(results: Path, new: Path) -> None:
    called(new, a_mcap="x.mcap", b_mcap="y.mcap")
    manifest(new, lambda document: document["logs"][1].update(sha256=document["logs"][0]["sha256"]))
    found = compared(results, new)
    assert found.status == NOT_COMPARABLE  # of `all`; the others are gone
    assert {row.mark for row in found.rows if row.log in ("a.mcap", "b.mcap")} == {"!"}


def test_a_real_sweep_beside_another_log(tmp_path: Path) -> None:
    """The same log is called by its folder as soon as another one lies elsewhere."""
    for place in ("one", "two"):
        (tmp_path / place).mkdir()
    log, other = drive(tmp_path / "one/a.mcap", 4), drive(tmp_path / "two/b.mcap", 4, seed=1)
    drawn = labels(tmp_path / "labels.geojson")
    for out, logs in (("alone", [log]), ("both", [log, other])):
        done = gapeval("sweep", *logs, "--labels", drawn, *GRID, "-o", tmp_path / out, "--jobs", 1)
        assert done.status == 0, done.err
    found = compared(tmp_path / "alone", tmp_path / "both")
    marks = {
        log: {row.mark for row in found.rows if row.log == log} for log in ("a.mcap", "two/b.mcap", "all")
    }
    assert marks == {"a.mcap": {" "}, "two/b.mcap": {"*"}, "all": {"x"}}


def test_a_parameter_that_changed_is_named(results: Path, new: Path) -> None:
    edited(new, lambda row: row | {"pl_th": "0.03"} if row["pl_th"] == "0.02" else row)
    status, found = shown(results, new)
    assert status == REGRESSION
    assert "pl_th 0.02 -> 0.03" in " ".join(found["notices"])
    assert "delta_r" not in " ".join(found["notices"])


@pytest.mark.parametrize("has_results", [True, False])
def test_a_sweep_that_was_not_finished_is_no_result(results: Path, new: Path, has_results: bool) -> None:
    (new / "parts").mkdir()
    (new / "parts/unfinished").touch()
    if not has_results:
        (new / "manifest.json").unlink()
    for command in (("compare", results, new), ("baseline", new, "-o", new.parent / "b.csv")):
        done = gapeval(*command)
        assert (done.status, done.out) == (1, "")
        assert is_one_line(done.err)
        assert f"gapeval sweep --resume {new}" in done.err


def test_a_sweep_that_is_killed_leaves_its_folder_unfinished(tmp_path: Path) -> None:
    log, drawn = drive(tmp_path / "a.mcap", 4), labels(tmp_path / "labels.geojson")
    out = tmp_path / "out"
    whole = ("sweep", log, "--labels", drawn, *GRID, "-o", out, "--jobs", 1)
    assert gapeval(*whole).status == 0
    assert kept(out, tmp_path / "baseline.csv").status == 0
    assert gapeval("compare", tmp_path / "baseline.csv", out).status == 0
    (out / "summary.csv").unlink()
    (out / "summary.csv").mkdir()  # in the way of the results, as a full disk would be
    assert gapeval(*whole, "-p", "x_min=0.7").status == 1
    assert "--resume" in gapeval("compare", tmp_path / "baseline.csv", out).err
    (out / "summary.csv").rmdir()
    assert gapeval("sweep", "--resume", out, "--jobs", 1).status == 0
    assert gapeval("compare", tmp_path / "baseline.csv", out).status in (REGRESSION, NOT_COMPARABLE)


@pytest.mark.parametrize("name", ["frames.csv", "labels.csv", "timing.csv", "config.yaml"])
def test_other_files_of_results_are_none(results: Path, new: Path, name: str) -> None:
    for pair in ((results, new / name), (results / name, new)):
        done = gapeval("compare", *pair)
        assert (done.status, done.out) == (1, "")
        assert is_one_line(done.err)


def test_no_baseline_yet(new: Path, tmp_path: Path) -> None:
    done = gapeval("compare", tmp_path / "baseline.csv", new)
    assert done.status == 1
    assert f"gapeval baseline DIR -o {tmp_path / 'baseline.csv'}" in done.err


def test_a_full_disk_is_no_bug_of_ours(results: Path) -> None:
    command = [sys.executable, "-m", "gapeval", "compare", results, results]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert is_one_line(done.stderr)
    assert "No space left" in done.stderr


def test_a_dash_is_the_terminal(results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = gapeval("compare", results, results, "--format", "csv", "-o", "-")
    assert done.out == gapeval("compare", results, results, "--format", "csv").out
    assert list(tmp_path.iterdir()) == []


def test_the_summary_of_a_step_decides_nothing(
    results: Path, new: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where it cannot be written, or is full, annotations and status are what they are."""
    missed(new)
    expected = gapeval("compare", results, new, "--format", "github")
    full = tmp_path / "full.md"
    full.write_bytes(b"x" * (1 << 20))
    for path in (tmp_path, full):
        monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(path))
        done = gapeval("compare", results, new, "--format", "github")
        assert (done.status, done.out) == (expected.status, expected.out) == (REGRESSION, expected.out)
        assert done.err.count("\n") == 1
        assert str(path) in done.err
    assert full.stat().st_size == 1 << 20
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "fresh.md"))
    assert gapeval("compare", results, new, "--format", "github").err == ""
    assert "hit_rate" in (tmp_path / "fresh.md").read_text()
