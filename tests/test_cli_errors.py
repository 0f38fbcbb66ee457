"""Every bad input: one helpful line, the right exit status, and nothing written that looks whole."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command import gapeval
from logs_writer import cloud_record, tf_record, write_records
from small_logs import START, drive, drive_with, feature, labels, stamps, trench_ring

Inputs = Callable[[Path], tuple[object, ...]]


def sweep_log(log: Callable[[Path], Path]) -> Inputs:
    return lambda folder: ("sweep", log(folder / "drive.mcap"))


def sweep_labels(**top: object) -> Inputs:
    def inputs(folder: Path) -> tuple[object, ...]:
        features = top.pop("features", None)
        return (
            *("sweep", drive(folder / "drive.mcap", 1)),
            *("--labels", labels(folder / "labels.geojson", features, **top)),  # type: ignore[arg-type]
        )

    return inputs


def sweep_with(*options: str) -> Inputs:
    return lambda folder: ("sweep", drive(folder / "drive.mcap", 1), *options)


def written(content: bytes | str) -> Callable[[Path], Path]:
    def write(path: Path) -> Path:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def configured(text: str) -> Inputs:
    return lambda folder: (
        *("sweep", drive(folder / "drive.mcap", 1)),
        *("--config", written(text)(folder / "config.yaml")),
    )


def without_tf(path: Path) -> Path:
    return write_records(path, [cloud_record(stamp, np.ones((9, 3))) for stamp in stamps(2)])


def tf_at_another_time(path: Path) -> Path:
    later = [stamp + 3600 * 10**9 for stamp in stamps(3)]
    still = ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
    transforms = [("map", "base_link", *still), ("base_link", "lidar", *still)]
    return write_records(
        path,
        [cloud_record(stamp, np.ones((9, 3))) for stamp in stamps(3)]
        + [tf_record(stamp, transforms) for stamp in later],
    )


def lying(path: Path) -> Path:
    """A header that promises a million points."""
    still = ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0))
    transforms = [("map", "base_link", *still), ("base_link", "lidar", *still)]
    around = [START - 10**8, START + 10**8]
    return write_records(
        path,
        [
            cloud_record(START, np.ones((9, 3)), width=1_000_000),
            *(tf_record(stamp, transforms) for stamp in around),
        ],
    )


def clouds_of(points: np.ndarray) -> Callable[[Path], Path]:
    return lambda path: drive_with(path, [(stamp, points) for stamp in stamps(2)])


def shifted(dx: float) -> list[list[float]]:
    return [[x + dx, y, z] for x, y, z in trench_ring()]


BOW_TIE = [[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]

CASES: dict[str, tuple[Inputs, int, str]] = {
    "missing log": (lambda folder: ("sweep", folder / "no.bag"), 1, "no.bag: "),
    "no log": (sweep_log(written(b"\x00\x01junk" * 99)), 1, "drive.mcap: no log: "),
    "empty file": (sweep_log(written(b"")), 1, "drive.mcap: "),
    "wrong topic": (sweep_with("--cloud-topic", "/nope"), 1, "/points"),
    "no tf path": (sweep_log(without_tf), 1, "lidar"),
    "no overlap in time": (sweep_log(tf_at_another_time), 1, "clouds"),
    "empty clouds": (sweep_log(clouds_of(np.empty((0, 3)))), 1, "empty cloud"),
    "all NaN": (sweep_log(clouds_of(np.full((9, 3), np.nan))), 1, "no finite point"),
    "lying header": (sweep_log(lying), 1, "header"),
    "zero frames": (sweep_log(lambda path: drive(path, 0)), 1, "cloud"),
    "unknown robot frame": (sweep_with("--robot-frame", "torso"), 1, "base_link"),
    "unknown fixed frame": (sweep_with("--fixed-frame", "earth"), 1, "map"),
    "missing configuration": (sweep_with("--config", "no.yaml"), 2, "no.yaml: cannot be read"),
    "invalid YAML": (configured("detector: {k: 6\nrobot: }"), 2, "config.yaml:2: not valid YAML"),
    "YAML without sections": (configured("- 1"), 2, "expected sections"),
    "unknown section": (configured("detektor: {k: 6}"), 2, "detektor: no such parameter"),
    "unknown key": (
        configured("detector: {kk: 6}"),
        2,
        "detector.kk: no such parameter; did you mean detector.k?",
    ),
    "unknown key in the grid": (configured("grid: {delta: [1]}"), 2, "grid.delta: no such parameter"),
    "delta_r 1": (configured("detector: {delta_r: 1}"), 2, "delta_r: input should be greater than 1"),
    "delta_r 1 in the grid": (configured("grid: {delta_r: [1.1, 1]}"), 2, "detector.delta_r=1)"),
    "empty grid": (configured("grid: {k: []}"), 2, "grid.k: no values"),
    "grid over the log": (configured("grid: {cloud_topic: [/a]}"), 2, "only detector and crossing"),
    "unknown parameter": (sweep_with("-p", "delt_r=2"), 2, "did you mean detector.delta_r?"),
    "no value": (sweep_with("-p", "k="), 2, "no value"),
    "parameter of the wrong type": (sweep_with("-p", "k=many"), 2, "detector.k"),
    "unknown option": (sweep_with("--nope"), 2, "No such option"),
    "no command": (lambda _: ("swoop",), 2, "No such command"),
    "self-intersecting label": (sweep_labels(features=[feature(BOW_TIE)]), 1, "Self-intersection"),
    "open ring": (sweep_labels(features=[feature(trench_ring()[:-1])]), 1, "open ring"),
    "invalid ring": (sweep_labels(features=[feature([[0, 0], [1, 1], [0, 0]])]), 1, "a ring of 3 positions"),
    "overlapping labels": (
        sweep_labels(features=[feature(trench_ring()), feature(shifted(0.1), id="other")]),
        1,
        "label other: overlaps label trench by 1 m2",
    ),
    "labels in an unknown frame": (sweep_labels(frame_id="mars"), 1, "'mars'"),
    "missing labels": (sweep_with("--labels", "no.geojson"), 1, "no.geojson: cannot be read"),
    "labels that are no JSON": (
        lambda folder: (*sweep_with()(folder), "--labels", written("{")(folder / "labels.geojson")),
        1,
        "labels.geojson: not JSON",
    ),
    "a log named twice": (
        lambda folder: ("sweep", drive(folder / "a.mcap", 1), folder / "a.mcap"),
        2,
        "named twice",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_one_line(tmp_path: Path, case: str) -> None:
    inputs, status, line = CASES[case]
    out = tmp_path / "out"
    done = gapeval(*inputs(tmp_path), "-o", out, "--jobs", 1) if case != "no command" else gapeval("swoop")
    assert done.status == status, done.err
    assert line in done.last_line
    assert done.last_line.startswith(("gapeval: ", "Error: "))
    assert "Traceback" not in done.err
    assert "bug of ours" not in done.err
    assert done.out == ""
    assert not out.exists() or list(out.iterdir()) == []


def test_unwritable_output(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for command in ("sweep", "detect"):
        output = tmp_path / "file" / ("out" if command == "sweep" else "out.geojson")
        done = gapeval(command, drive(tmp_path / f"{command}.mcap", 1), "-o", output)
        assert done.status == 1
        assert "cannot write here" in done.last_line
    image = gapeval("labels", "image", drive(tmp_path / "image.mcap", 1), "-o", tmp_path / "file")
    assert (image.status, "cannot write here" in image.last_line) == (1, True)


def test_detect_refuses_a_choice(tmp_path: Path) -> None:
    done = gapeval("detect", drive(tmp_path / "a.mcap", 1), "-o", tmp_path / "a.geojson", "-p", "k=5,6")
    assert done.status == 2
    assert "the grid has 2 configurations; detect runs one: choose k with -p" in done.last_line
    assert not (tmp_path / "a.geojson").exists()


def test_detect_leaves_no_half_file(tmp_path: Path) -> None:
    log = clouds_of(np.full((9, 3), np.nan))(tmp_path / "a.mcap")
    assert gapeval("detect", log, "-o", tmp_path / "a.geojson").status == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.parametrize(
    ("document", "line"),
    [
        ("{", "not JSON"),
        ({"type": "Feature"}, "expected a GeoJSON FeatureCollection"),
        ({"type": "FeatureCollection", "frame_id": "base_link"}, "no `frames`"),
        ({"type": "FeatureCollection", "frames": [{"stamp": "1"}]}, "no `frame_id`"),
        ({"type": "FeatureCollection", "frame_id": "base_link", "frames": [{}]}, "frame 0: no 'stamp'"),
        ({"type": "FeatureCollection", "frame_id": "base_link", "frames": []}, "'map'"),
    ],
)
def test_detections_that_cannot_be_scored(tmp_path: Path, document: object, line: str) -> None:
    text = document if isinstance(document, str) else json.dumps(document)
    path = written(text)(tmp_path / "found.geojson")
    done = gapeval("score", path, labels(tmp_path / "labels.geojson"), "-o", tmp_path / "out")
    assert done.status == 1
    assert line in done.last_line
    assert not (tmp_path / "out").exists()


def test_foreign_detections_need_a_domain(tmp_path: Path) -> None:
    pose = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}
    gap = feature(trench_ring(), id="x", stamp="1")
    document = {
        "type": "FeatureCollection",
        "frame_id": "base_link",
        "fixed_frame": "map",
        "frames": [{"stamp": "1", "pose": pose}],
        "features": [gap],
    }
    path = written(json.dumps(document))(tmp_path / "found.geojson")
    without = gapeval("score", path, labels(tmp_path / "labels.geojson"))
    assert without.status == 2
    assert "no domain in the file" in without.last_line
    given = gapeval(
        "score", path, labels(tmp_path / "labels.geojson"), "-p", "scoring.domain={x_min: 0.6, r_max: 4}"
    )
    assert given.status == 0
    assert "hit_rate           1 " in given.out


def test_debug_shows_the_traceback(tmp_path: Path) -> None:
    from gapeval.errors import LogError

    with pytest.raises(LogError):
        gapeval("--debug", "sweep", tmp_path / "no.bag")


def test_version_and_help() -> None:
    assert gapeval("--version").out == "gapeval, version 0.1.0\n"
    assert "sweep" in gapeval("--help").out


@pytest.mark.parametrize("taken", ["drive.mcap", "labels.geojson", "folder"])
def test_detect_replaces_nothing_but_detections(tmp_path: Path, taken: str) -> None:
    log = drive(tmp_path / "drive.mcap", 1)
    labels(tmp_path / "labels.geojson")
    (tmp_path / "folder").mkdir()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    done = gapeval("detect", log, "-o", tmp_path / taken)
    assert done.status == 1
    assert "name a" in done.last_line
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before
    for _ in range(2):
        assert gapeval("detect", log, "-o", tmp_path / "found.geojson").status == 0


def test_labelled_stamps_that_no_frame_has(tmp_path: Path) -> None:
    log, near = drive(tmp_path / "drive.mcap", 1), str(START + 1000)
    assert gapeval("detect", log, "-o", tmp_path / "found.geojson", "-p", "delta_r=1.05").status == 0
    drawn = labels(tmp_path / "labels.geojson", stamps=[near])
    done = gapeval("score", tmp_path / "found.geojson", drawn)
    assert (done.status, "--stamp-tolerance" in done.last_line) == (1, True)
    assert gapeval("score", tmp_path / "found.geojson", drawn, "--stamp-tolerance", "0.001").status == 0


def test_a_picture_with_labels_of_another_frame(tmp_path: Path) -> None:
    log, mars = drive(tmp_path / "drive.mcap", 1), labels(tmp_path / "labels.geojson", frame_id="mars")
    done = gapeval("labels", "image", log, "-o", tmp_path / "out", "--labels", mars)
    assert (done.status, "'mars'" in done.last_line) == (1, True)
