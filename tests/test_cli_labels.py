"""gapeval info and gapeval labels."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from command import gapeval
from small_logs import TRENCH, drive, feature, labels, stamps, trench_ring


def test_the_picture_lies_where_the_world_file_says(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 3)
    done = gapeval("labels", "image", log, "-o", tmp_path / "out", "--resolution", 0.05, "--range", 5)
    assert done.status == 0, done.err
    pixels = cv2.imread(str(tmp_path / "out/drive.mcap.png"), cv2.IMREAD_UNCHANGED)
    step, _, _, down, left, top = map(float, (tmp_path / "out/drive.mcap.pgw").read_text().split())
    about = json.loads((tmp_path / "out/drive.mcap.json").read_text())
    assert (step, down) == (0.05, -0.05)
    assert (about["frame_id"], about["resolution"], about["frames"]) == ("map", 0.05, 3)
    assert (about["height"], about["width"]) == pixels.shape[:2]
    x, y = about["origin"]
    assert left == pytest.approx(x + step / 2)
    assert top == pytest.approx(y + step * about["height"] - step / 2)

    def seen(x: float, y: float) -> bool:
        return bool(pixels[round((y - top) / down), round((x - left) / step), 3])

    (near, right), (far, _) = TRENCH
    assert not seen((near + far) / 2, 0.0)
    assert not seen((near + far) / 2, right + 0.1)
    assert seen(near - 0.1, 0.0)
    assert seen(far + 0.1, 0.0)
    assert seen((near + far) / 2, right - 0.1)


def test_labels_and_gaps_are_drawn(tmp_path: Path) -> None:
    log, drawn = drive(tmp_path / "drive.mcap", 2), labels(tmp_path / "labels.geojson")
    assert gapeval("detect", log, "-o", tmp_path / "found.geojson", "-p", "delta_r=1.05").status == 0
    options = ("--labels", drawn, "--detections", tmp_path / "found.geojson")
    assert gapeval("labels", "image", log, "-o", tmp_path / "out", *options).status == 0
    pixels = cv2.imread(str(tmp_path / "out/drive.mcap.png"), cv2.IMREAD_UNCHANGED)
    top, left = -float((tmp_path / "out/drive.mcap.pgw").read_text().split()[5]), None
    left = float((tmp_path / "out/drive.mcap.pgw").read_text().split()[4])
    rows, columns = np.nonzero((pixels == (180, 0, 180, 255)).all(axis=2))
    assert columns.min() * 0.05 + left == pytest.approx(TRENCH[0][0], abs=0.11)
    assert columns.max() * 0.05 + left == pytest.approx(TRENCH[1][0], abs=0.11)
    assert -rows.max() * 0.05 - top == pytest.approx(TRENCH[0][1], abs=0.11)
    assert (pixels == (255, 60, 0, 255)).all(axis=2).any()


def test_a_picture_that_is_too_large_says_what_to_do(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    done = gapeval("labels", "image", log, "-o", tmp_path / "out", "--resolution", 0.001, "--range", 50)
    assert done.status == 1
    assert "use a larger --resolution or a smaller --range" in done.last_line
    assert list((tmp_path / "out").iterdir()) == []


def test_check_lists_every_problem_by_feature(tmp_path: Path) -> None:
    ring = trench_ring()
    bad = labels(
        tmp_path / "bad.geojson",
        [feature(ring), feature(ring[:-1], id="open"), {"type": "Feature"}, feature(ring, id="trench")],
    )
    done = gapeval("labels", "check", bad)
    assert done.status == 1
    assert done.out.splitlines() == [
        "feature 1 (open): an open ring: repeat its first position at the end",
        "feature 2: no `properties`; a label needs at least an `id`",
        "feature 3 (trench): the id trench is used before",
    ]
    assert done.last_line == f"gapeval: {bad}: 3 problems"


def test_check_against_a_log(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    assert gapeval("labels", "check", labels(tmp_path / "good.geojson"), "--log", log).status == 0
    far = [[x + 90, y, z] for x, y, z in trench_ring()]
    bad = labels(
        tmp_path / "bad.geojson",
        [
            feature(far, id="far"),
            feature(trench_ring(), id="later", start=str(stamps(2)[1] + 1), end=None),
            feature([[x - 5, y, z] for x, y, z in trench_ring()], id="elsewhere", frame_id="mars"),
        ],
        stamps=[str(stamps(2)[0]), "7"],
    )
    done = gapeval("labels", "check", bad, "--log", log)
    assert done.status == 1
    first, second, third, fourth = done.out.splitlines()
    assert first == (
        "label far: is never nearer than 92.0 m to the robot, and r_max is 3 m; "
        "set detector.r_max with --config or -p"
    )
    assert second == "label later: holds at no cloud of drive.mcap"
    assert "'mars'" in third
    assert fourth == "file: stamp 7 is no cloud of drive.mcap"


def test_info_is_text_and_json(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    text = gapeval("info", log)
    assert text.status == 0
    assert "/points" in text.out
    assert "map" in text.out
    (about,) = json.loads(gapeval("info", "--json", log).out)
    assert about["container"] == "MCAP"


def test_info_goes_on_after_a_log_that_cannot_be_read(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 2)
    done = gapeval("info", tmp_path / "no.bag", log, tmp_path / "neither.bag")
    assert done.status == 1
    assert "/points" in done.out
    assert ["no.bag" in line for line in done.err.splitlines()] == [True, False]
    assert "neither.bag" in done.last_line


def test_every_problem_of_one_feature_is_told(tmp_path: Path) -> None:
    worst = feature(trench_ring()[:-1], id="worst", kind="hole", traversable="yes", start="5", end="4")
    done = gapeval("labels", "check", labels(tmp_path / "bad.geojson", [worst], frame_id=None))
    reasons = [line.removeprefix("feature 0 (worst): ") for line in done.out.splitlines()]
    assert [reason.split()[0] for reason in reasons] == ["start", "kind", "no", "an", "traversable"]
