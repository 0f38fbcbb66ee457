"""Poses that are wrong on purpose: where points go, what stays, and what is made of it."""

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from command import gapeval
from hypothesis import given
from hypothesis import strategies as st
from logs_checks import frames_of
from small_logs import drive, labels
from sweeps import bytes_of

from gapeval.config import LogSection, PoseError, PoseNoise
from gapeval.frame import Frame
from gapeval.logs.read import describe, read_frames, read_recording
from gapeval.logs.read.pose_error import error_of
from gapeval.logs.read.transforms import Transforms, compose

angles = st.floats(-0.5, 0.5)
heights = st.floats(-1, 1)
NOISE = PoseNoise(roll=0.02, pitch=0.03, height=0.05)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return drive(tmp_path_factory.mktemp("drive") / "drive.mcap", 8)


def settings_of(**section):
    return LogSection.model_validate(section)


def turned(points, roll, pitch, height):
    """Point by point, by the formulas of two turns."""
    x, y, z = points.T
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    x, z = x * math.cos(pitch) + z * math.sin(pitch), -x * math.sin(pitch) + z * math.cos(pitch)
    return np.column_stack([x, y, z + height])


def errors_between(true, wrong):
    """Roll, pitch [rad] and height [m] that lead from one frame's points to the other's."""
    a, b = true.points.astype(np.float64), wrong.points.astype(np.float64)
    rotation, _, _, _ = np.linalg.lstsq(a - a.mean(axis=0), b - b.mean(axis=0), rcond=None)
    rotation = rotation.T
    height = (b.mean(axis=0) - rotation @ a.mean(axis=0))[2]
    return math.atan2(rotation[2, 1], rotation[2, 2]), math.asin(-rotation[2, 0]), height


# The transform


@given(angles, angles, heights)
def test_points_are_turned_about_x_then_y_then_lifted(roll, pitch, height):
    random = np.random.default_rng(5)
    cloud = Transforms(random.normal(size=(3, 3)), np.tile([0.0, 0.6, 0.0, 0.8], (3, 1)))
    error = PoseError(roll=roll, pitch=pitch, height=height)
    wrong = compose(error_of(np.arange(3), error, None), cloud)
    points = random.normal(0, 3, (20, 3))
    for index in range(3):
        expected = turned(cloud.at(index).apply(points), roll, pitch, height)
        np.testing.assert_allclose(wrong.at(index).apply(points), expected, atol=1e-12)


@given(angles)
def test_a_level_plane_is_tilted_by_the_pitch(pitch):
    wrong = error_of(np.zeros(1, np.int64), PoseError(pitch=pitch), None)
    x, y = np.meshgrid(np.linspace(0.5, 5, 7), np.linspace(-2, 2, 5))
    places = wrong.at(0).apply(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]))
    np.testing.assert_allclose(places[:, 2], -places[:, 0] * math.tan(pitch), atol=1e-12)
    np.testing.assert_allclose(places[:, 1], y.ravel(), atol=1e-12)


@given(angles)
def test_a_positive_roll_lifts_the_left(roll):
    wrong = error_of(np.zeros(1, np.int64), PoseError(roll=roll), None)
    left = wrong.at(0).apply(np.array([2.0, 1.0, 0.0]))
    assert left == pytest.approx([2.0, math.cos(roll), math.sin(roll)])


# Frames


def test_only_points_move(path):
    """The sensor, the pose, the stamp and the lowest ray are those of the log."""
    error = {"roll": 0.03, "pitch": -0.05, "height": 0.1}
    true, wrong = frames_of(path), frames_of(path, settings_of(pose_error=error))
    assert len(true) == len(wrong) == 8
    for one, other in zip(true, wrong, strict=True):
        expected = turned(one.points.astype(np.float64), **error)
        np.testing.assert_allclose(other.points, expected, atol=2e-6)
        assert replace(one, points=other.points).points is other.points
        assert (one.stamp, one.sensor, one.pose, one.dropped) == (
            other.stamp,
            other.sensor,
            other.pose,
            other.dropped,
        )
        assert one.lowest_elevation == other.lowest_elevation
        assert one.digest != other.digest


@pytest.mark.parametrize(
    "nothing",
    [
        {"pose_error": {}},
        {"pose_error": {"roll": 0, "pitch": 0.0, "height": -0.0}},
        {"pose_noise": {}},
        {"pose_noise": {"seed": 4}, "pose_error": None},
    ],
)
def test_an_error_of_zero_is_none(path, nothing):
    true, wrong = read_recording(path, LogSection()), read_recording(path, settings_of(**nothing))
    assert (wrong.pose_error, wrong.pose_noise) == (None, None)
    for one, other in zip(read_frames(true, 0, 8), read_frames(wrong, 0, 8), strict=True):
        assert one.points.tobytes() == other.points.tobytes()
        assert one.digest == other.digest


def test_noise_is_the_same_in_any_order_and_any_process(path):
    """One frame alone, in a recording that came from another process, has the error that it has among all."""
    recording = read_recording(path, LogSection(pose_noise=NOISE))
    every = list(read_frames(recording, 0, 8))
    sent = pickle.loads(pickle.dumps(recording))
    assert sent.pose_noise == NOISE
    for index in (5, 0, 7):
        (alone,) = read_frames(sent, index, index + 1)
        assert isinstance(alone, Frame)
        assert alone.digest == every[index].digest


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=8, unique=True), st.randoms())
def test_a_draw_depends_on_the_stamp_alone(stamps, random):
    def wrong(order):
        rows = np.array(order, dtype=np.int64)
        return error_of(rows, None, NOISE).quaternion

    shuffled = random.sample(stamps, len(stamps))
    of = dict(zip(stamps, wrong(stamps).tolist(), strict=True))
    assert [of[stamp] for stamp in shuffled] == wrong(shuffled).tolist()
    assert len({tuple(row) for row in of.values()}) == len(stamps)


def test_noise_has_the_standard_deviations_that_are_asked():
    stamps = 1_700_000_000_000_000_000 + np.arange(4000) * 2_738_000_000
    drawn = error_of(stamps, None, NOISE)
    half = drawn.quaternion[:, :3]
    assert 2 * half[:, 0].std() == pytest.approx(0.02, rel=0.05)
    assert 2 * half[:, 1].std() == pytest.approx(0.03, rel=0.05)
    assert drawn.translation[:, 2].std() == pytest.approx(0.05, rel=0.05)
    assert np.abs(drawn.translation[:, :2]).max() == 0
    together = np.column_stack([half[:, :2], drawn.translation[:, 2]])
    assert np.abs(np.corrcoef(together.T) - np.eye(3)).max() < 0.06
    assert np.abs(np.corrcoef(together[1:].T, together[:-1].T)[:3, 3:]).max() < 0.06
    assert np.abs(together.mean(axis=0) / together.std(axis=0)).max() < 0.06


def test_another_seed_draws_other_errors_and_error_and_noise_add_up(path):
    true = frames_of(path)
    noisy = frames_of(path, LogSection(pose_noise=NOISE))
    other = frames_of(path, LogSection(pose_noise=NOISE.model_copy(update={"seed": 1})))
    both = frames_of(path, LogSection(pose_noise=NOISE, pose_error=PoseError(pitch=0.1, height=-0.2)))
    for frames in zip(true, noisy, other, both, strict=True):
        by_noise, by_other, by_both = (errors_between(frames[0], frame) for frame in frames[1:])
        assert min(abs(a - b) for a, b in zip(by_noise, by_other, strict=True)) > 1e-5
        assert by_both == pytest.approx(np.add(by_noise, (0, 0.1, -0.2)), abs=1e-5)


def test_info_says_what_the_log_says(path):
    wrong = LogSection(pose_error=PoseError(roll=0.4, height=1.0), pose_noise=NOISE)
    assert describe(path, wrong) == describe(path, LogSection())


# Sweeps


def swept(tmp_path, path, name, *options):
    """A sweep over one log; the folder and the entry of its log in the manifest."""
    drawn = labels(tmp_path / "labels.geojson")
    done = gapeval("sweep", path, "--labels", drawn, "-p", "n_o=0,1", *options, "-o", tmp_path / name)
    assert done.status == 0, done.err
    (entry,) = json.loads((tmp_path / name / "manifest.json").read_text())["logs"]
    return done, bytes_of(tmp_path / name), entry


def test_the_manifest_names_the_error_only_where_there_is_one(tmp_path, path):
    _, plain, entry = swept(tmp_path, path, "plain", "--jobs", 1)
    _, zero, _ = swept(tmp_path, path, "zero", "--jobs", 1, "-p", "log.pose_error.pitch=0")
    assert "pose_error" not in entry
    assert "pose_noise" not in entry
    assert "pose" not in plain["config.yaml"].decode().replace("pose_topic", "")
    assert {n: b for n, b in zero.items() if n != "config.yaml"} == {
        n: b for n, b in plain.items() if n != "config.yaml"
    }
    done, wrong, entry = swept(tmp_path, path, "wrong", "-p", "log.pose_error.pitch=0.04", "--jobs", 1)
    assert "pose_error roll=0.0 pitch=0.04 height=0.0" in done.err
    assert entry["pose_error"] == {"roll": 0.0, "pitch": 0.04, "height": 0.0}
    assert "pose_noise" not in entry
    assert wrong["frames.csv"] != plain["frames.csv"]


def test_noise_does_not_depend_on_workers_and_resumed_sweeps_tell_errors_apart(tmp_path, path):
    """The same folder, asked with another error, evaluates everything anew, and gives that error's bytes."""
    noise = ("-p", "log.pose_noise={pitch: 0.02, height: 0.03}")
    _, alone, entry = swept(tmp_path, path, "alone", "--jobs", 1, *noise)
    _, together, _ = swept(tmp_path, path, "out", "--jobs", 3, *noise)
    assert alone == together
    assert entry["pose_noise"] == {"roll": 0.0, "pitch": 0.02, "height": 0.03, "seed": 0}
    again, _, _ = swept(tmp_path, path, "out", *noise)
    assert "resuming: 8 of 8 frames are there" in again.err
    changed, plain, _ = swept(tmp_path, path, "out", "--jobs", 1)
    assert "resuming" not in changed.err
    assert plain == swept(tmp_path, path, "plain", "--jobs", 1)[1]
    assert plain["frames.csv"] != alone["frames.csv"]


def test_a_pitch_that_sinks_the_ground_ahead_makes_a_gap_of_it(tmp_path):
    """Section 4.5: ground that a wrong pose puts below the plane is no ground to the detector."""
    path = drive(tmp_path / "drive.mcap", 2)
    _, plain, _ = swept(tmp_path, path, "plain", "--jobs", 1)
    _, wrong, _ = swept(tmp_path, path, "wrong", "--jobs", 1, "-p", "log.pose_error.pitch=0.06")

    def over_area(files):
        head, first = files["frames.csv"].decode().splitlines()[:2]
        return float(dict(zip(head.split(","), first.split(","), strict=True))["over_area_sum"])

    assert over_area(wrong) > over_area(plain) + 2


@pytest.mark.parametrize(
    "option", ["pose_error.roll=2", "pose_error.yaw=0", "pose_noise.pitch=-1", "pose_noise.seed=0.5"]
)
def test_what_cannot_be_is_one_line(tmp_path, path, option):
    done = gapeval("sweep", path, "-p", f"log.{option}", "-o", tmp_path / "out")
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert option.partition("=")[0].partition(".")[2] in done.err
