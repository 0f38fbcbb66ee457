"""`gapeval study`, end to end on simulated scenes and on a log."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from command import gapeval
from small_logs import cloud, drive_with, labels, stamps

from gapeval.studies.cases import plan_runs
from gapeval.studies.claims import check_rules
from gapeval.studies.columns import check_columns
from gapeval.studies.definition import NAMES, quickly, read_study, studies_folder
from gapeval.sweep.grid import configurations

SMALL = {
    "title": "Small",
    "paper": "none",
    "question": "Does it work?",
    "says": "nothing",
    "grid": {"n_o": [0, 1]},
    "runs": [
        {"name": "scenes", "scenes": ["street", "plain"], "seeds": 2, "frames": 2},
        {
            "name": "errors",
            "scenes": ["street"],
            "seeds": 1,
            "frames": 2,
            "conditions": {"kind": "error"},
            "vary": {"roll": [0.0, 0.05]},
        },
    ],
    "labels_by": ["label", "position"],
    "claims": [
        {
            "claim": "fewer_false_gaps",
            "section": "0",
            "words": "an opening removes false gaps",
            "figures": {
                "change": {"of": "fp_per_frame", "where": {"n_o": 1, "kind": ""}, "minus": {"n_o": 0}}
            },
            "holds": "change.value < 0",
        }
    ],
}


CHANGE = {"of": "fp_per_frame", "where": {"n_o": 1}, "minus": {"n_o": 0}}
PLAIN = SMALL | {"claims": [SMALL["claims"][0] | {"figures": {"change": CHANGE}}]}


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> tuple[Path, Path]:
    """A study of one's own, and the folder that it was run into."""
    folder = tmp_path_factory.mktemp("small")
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(SMALL, sort_keys=False))
    result = gapeval("study", path, "-o", folder / "out", "--jobs", 2)
    assert result.status == 0, result.err
    return path, folder / "out"


def with_logs(small: tuple[Path, Path], folder: Path) -> Path:
    """A folder for studies that has the simulated logs already."""
    shutil.copytree(small[1] / "logs", folder / "logs")
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def csvs(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.glob("*.csv"))}


def test_rows_are_sums_over_the_frames_of_their_logs(small) -> None:
    """hit_rate and false gaps of each row, from frames.csv by hand."""
    found = [row for row in rows(small[1] / "mine.csv") if not row["by"]]
    of_scenes = pd.read_csv(small[1] / "mine" / "scenes" / "frames.csv")
    of_errors = pd.read_csv(small[1] / "mine" / "errors" / "frames.csv")
    assert len(found) == 2 * 3 + 2 * 2 * 2  # n_o x (all, street, plain) and n_o x roll x (all, street)
    for row in found:
        frames = of_errors if row["kind"] else of_scenes
        chosen = frames["configuration"] == row["configuration"]
        if row["scene"] != "all":
            chosen &= frames["log"].str.startswith(row["scene"])
        if row["kind"]:
            chosen &= frames["log"].str.endswith(f"roll {float(row['roll']):g}")
        frames = frames[chosen]
        assert int(row["frames"]) == len(frames) > 0
        assert int(row["hits"]) == frames["hits"].sum()
        assert float(row["fp_per_frame"]) == pytest.approx(frames["false_gaps"].sum() / len(frames))
        if row["hit_rate"]:
            assert float(row["hit_rate"]) == pytest.approx(frames["hits"].sum() / frames["asked"].sum())


def test_groups_of_labels_add_up_to_the_whole(small) -> None:
    table = pd.read_csv(small[1] / "mine.csv", keep_default_na=False)
    for (scene, kind, roll, n_o), whole in table[table["by"] == ""].groupby(
        ["scene", "kind", "roll", "n_o"], sort=False
    ):
        for by in ("label", "position"):
            groups = table[
                (table["by"] == by) & (table["scene"] == scene) & (table["kind"] == kind)
                & (table["roll"] == roll) & (table["n_o"] == n_o)
            ]  # fmt: skip
            for count in ("asked", "hits"):
                assert groups[count].sum() == whole[count].item()


def test_a_wrong_pose_changes_what_is_found(small) -> None:
    frames = pd.read_csv(small[1] / "mine" / "errors" / "frames.csv")
    by_roll = frames.groupby(frames["log"].str.rpartition(" ")[2])["gaps"].sum()
    assert by_roll["0.05"] != by_roll["0"]


def test_claims_are_judged_and_traced(small) -> None:
    (claim,) = rows(small[1] / "claims.csv")
    assert (claim["verdict"], claim["basis"]) == ("holds", "intervals")  # the rule asks for none
    assert claim["rule"] == "change.value < 0"
    assert claim["source"] == "mine.csv: change: fp_per_frame where n_o=1 kind= minus where n_o=0"
    table = {row["n_o"]: row for row in rows(small[1] / "mine.csv")[:2]}
    change = float(table["1"]["fp_per_frame"]) - float(table["0"]["fp_per_frame"])
    assert float(claim["measured"].split()[1]) == pytest.approx(change, rel=5e-3)


def test_same_bytes_for_any_number_of_workers_and_again(small, tmp_path) -> None:
    with_logs(small, tmp_path)
    for _ in range(2):  # the second time, all is there
        assert gapeval("study", small[0], "-o", tmp_path, "--jobs", 1).status == 0
        assert csvs(tmp_path) == csvs(small[1])
    manifests = [(folder / "manifest.json").read_bytes() for folder in (tmp_path, small[1])]
    assert manifests[0] == manifests[1]


def test_what_is_lost_is_done_again_and_nothing_else(small, tmp_path) -> None:
    shutil.copytree(small[1], tmp_path, dirs_exist_ok=True)
    before = csvs(tmp_path)
    parts = sorted((tmp_path / "mine" / "scenes" / "parts").glob("*.zst"))
    parts[0].unlink()
    (tmp_path / "logs" / "street-lms151-seed0-frames2" / "made_by.json").unlink()
    kept = {path: path.stat().st_mtime_ns for path in parts[1:]}
    assert gapeval("study", small[0], "-o", tmp_path, "--jobs", 1).status == 0
    assert csvs(tmp_path) == before
    assert kept == {path: path.stat().st_mtime_ns for path in parts[1:]}


def test_claims_of_other_studies_stay(small, tmp_path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(yaml.safe_dump(PLAIN | {"runs": [SMALL["runs"][0] | {"seeds": 1, "scenes": ["plain"]}]}))
    out = tmp_path / "out"
    shutil.copytree(small[1], out)
    assert gapeval("study", other, "-o", out, "--jobs", 1).status == 0
    assert [row["study"] for row in rows(out / "claims.csv")] == ["mine", "other"]
    assert json.loads((out / "manifest.json").read_text())["studies"] == ["mine", "other"]
    # ... but not beside those of another configuration.
    assert gapeval("study", other, "-o", out, "-p", "pl_th=0.2", "--jobs", 1).status == 0
    assert [row["study"] for row in rows(out / "claims.csv")] == ["other"]


def test_a_log_of_ones_own(small, tmp_path) -> None:
    """Instead of all scenes; its conditions are those of its poses alone."""
    log = small[1] / "logs" / "street-lms151-seed1-frames2"
    given = ("--log", log / "street.mcap", "--labels", log / "labels.geojson", "-p", "robot.ground_z=-0.0705")
    result = gapeval("study", small[0], *given, "-o", tmp_path, "--jobs", 1)
    assert result.status == 0, result.err
    assert not list((tmp_path / "logs").glob("*-*"))
    found = [row for row in rows(tmp_path / "mine.csv") if not row["by"] and not row["kind"]]
    assert {row["scene"] for row in found} == {"all", "street.mcap"}
    simulated = pd.read_csv(small[1] / "mine" / "scenes" / "frames.csv")
    simulated = simulated[simulated["log"] == "street-lms151-seed1-frames2"]
    assert {int(row["hits"]) for row in found} == set(simulated.groupby("configuration")["hits"].sum())


@pytest.mark.parametrize("name", NAMES)
def test_our_studies_can_be_run(name) -> None:
    """Every configuration, log, rule and figure that they name is one; quickly too."""
    called, study = read_study(name)
    assert called == name
    check_columns(name, study)
    check_rules(name, study)
    for one in (study, study.model_copy(update={"runs": tuple(map(quickly, study.runs))})):
        for planned in plan_runs(name, one, {}, None):
            assert configurations(planned.config)
            assert len({case.name for case in planned.cases}) == len(planned.cases)
            for case in planned.cases[:1]:
                assert case.source.simulation().frames > 0


def test_every_file_of_the_folder_is_on_the_list() -> None:
    assert {path.stem for path in studies_folder().glob("*.yaml")} == set(NAMES)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"runs": [{"scenes": ["moon"]}]}, "moon: no such scene; there are"),
        ({"runs": [{"scenes": ["plain"], "sensor": "x"}]}, "x: no such sensor; there are"),
        ({"runs": [{"scenes": ["plain"], "vary": {"rol": [1]}}]}, "rol: no such condition to vary"),
        ({"runs": [{"scenes": ["plain"]}, {"scenes": ["plain"]}]}, "more than one run of this name"),
        ({"grid": {"delta_q": [1]}}, "delta_q: no such parameter"),
        ({"titel": "x"}, "titel: no such parameter"),
        ({"curves": [{"x": "n_0", "y": ["f1"]}]}, "curves, number 1: no column n_0; did you mean n_o?"),
        (
            {"claims": [SMALL["claims"][0] | {"holds": "chance.value < 0"}]},
            "no figure chance; there are change",
        ),
        ({"claims": [SMALL["claims"][0] | {"by": "seen"}]}, "claims.fewer_false_gaps: no column seen"),
        ({"claims": [SMALL["claims"][0] | {"holds": "change.value + 1"}]}, "is 1.5, neither true nor false"),
        (
            {"claims": [SMALL["claims"][0] | {"holds": "change.median > 1"}]},
            "a figure has value, low and high",
        ),
        ({"claims": SMALL["claims"] * 2}, "claims.fewer_false_gaps: there is more than one claim"),
        (
            {"claims": [SMALL["claims"][0] | {"figures": {"change": {"where": {"n_o": 1}}}}]},
            "figures.change.of: Field required",
        ),
        (
            {"claims": [SMALL["claims"][0] | {"figures": {"change": {"of": "hitrate"}}}]},
            "no figure hitrate; did you mean hit_rate?",
        ),
        ({"curves": [{"x": "n_o", "y": ["scene"]}]}, "curves, number 1: no figure scene"),
        ({"grid": {"n_o": []}}, "grid.n_o: no values; give at least one"),
        ({"runs": [{"scenes": ["plain"], "vary": {"roughness": ["x"]}}]}, "'x': must be a number"),
        ({"runs": [{"scenes": ["plain"], "vary": {"obstacles": [1]}}]}, "1: must be true or false"),
        (
            {"runs": [{"scenes": ["plain"], "vary": {"roughness": [5.0]}}], "claims": []},
            "study bad: roughness 5: must be",
        ),
        ({"runs": []}, "runs: Tuple should have at least 1 item"),
        ({"config": {"detector": {"k": 99}}}, "detector.k: input should be less than or equal to 12"),
    ],
)
def test_a_study_that_cannot_be_is_said_in_one_line(tmp_path, change, message) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump(SMALL | change))
    result = gapeval("study", path, "-o", tmp_path / "out")
    assert result.status == 2
    assert message in result.last_line
    assert not (tmp_path / "out").exists()


def test_usage() -> None:
    assert "no such study; there are delta_r, resolution" in gapeval("study", "moon").last_line
    assert gapeval("study", "moon").status == 2
    assert gapeval("study", "--labels", "x.geojson").status == 2
    assert gapeval("study", "--log", "x.mcap").status == 2
    listed = gapeval("study", "--list")
    assert listed.status == 0
    assert all(name in listed.out for name in NAMES)


@pytest.mark.parametrize(("seeds", "frames", "log"), [(5, 1, "all"), (1, 12, "plain-lms151-seed0-frames12")])
def test_intervals_are_those_of_the_sweep_itself(tmp_path, seeds, frames, log) -> None:
    """Of whole logs where there are five, of blocks of time in one."""
    path = tmp_path / "same.yaml"
    run = {"scenes": ["plain"], "seeds": seeds, "frames": frames}
    path.write_text(yaml.safe_dump(PLAIN | {"runs": [run], "labels_by": []}))
    assert gapeval("study", path, "-o", tmp_path / "out", "--jobs", 1).status == 0
    ours = {row["configuration"]: row for row in rows(tmp_path / "out" / "same.csv") if row["scene"] == "all"}
    summary = rows(tmp_path / "out" / "same" / "runs" / "summary.csv")
    compared = 0
    for theirs in summary:
        if theirs["log"] == log:
            for name, value in ours[theirs["configuration"]].items():
                if name.endswith(("_low", "_high")):
                    assert value == theirs[name], name
                    compared += value != ""
    assert compared >= 8


@pytest.mark.parametrize("kind", ["sweep", "bins", "time"])
def test_unusable_clouds_of_a_log_are_told_once(tmp_path, kind) -> None:
    good, lost = [(stamp, cloud(index)) for index, stamp in enumerate(stamps(4))], np.full((50, 3), np.nan)
    log = drive_with(tmp_path / "drive.mcap", [*good, (stamps(6)[4], lost), (stamps(6)[5], lost)])
    path = tmp_path / "mine.yaml"
    runs = [{"name": "one", "kind": kind, "scenes": ["plain"]}, {"name": "two", "scenes": ["plain"]}]
    path.write_text(yaml.safe_dump(PLAIN | {"runs": runs, "labels_by": [], "claims": []}))
    given = ("--log", log, "--labels", labels(tmp_path / "gaps.geojson"), "--jobs", 1)
    result = gapeval("study", path, *given, "-o", tmp_path / "out")
    assert result.status == 0, result.err
    assert result.err.count(f"{log}: refused 2: ") == 1
    if kind == "sweep":
        assert {row["frames"] for row in rows(tmp_path / "out" / "mine.csv")} == {"4"}
