"""gapeval simulate, as its users run it."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from command import gapeval
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from gapeval.config import LogSection
from gapeval.logs.read import read_frames, read_recording
from gapeval.simulate.layouts import SCENES
from gapeval.simulate.log import write_simulation
from gapeval.simulate.sensors import SENSORS
from gapeval.simulate.simulation import clouds, simulation

SUFFIXES = {"mcap": ".mcap", "ros1": ".bag", "ros2": ""}
CLOUD = "sensor_msgs/msg/PointCloud2"
TF = "tf2_msgs/msg/TFMessage"
PAPERS_ROBOT = "robot: {length: 0.68, width: 0.5, ground_z: -0.0705}\n"


def simulate(folder, *options, scene="tunnel", sensor="vlp16", frames=2):
    return gapeval("simulate", scene, "--sensor", sensor, "--frames", frames, *options, "-o", folder)


def contents(folder):
    """Every file below a folder, and what is in it."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def frames_of(path):
    recording = read_recording(path, LogSection())
    return list(read_frames(recording, 0, recording.matched))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder for each container, of the same simulation."""
    folders = {container: tmp_path_factory.mktemp(container) for container in SUFFIXES}
    for container, folder in folders.items():
        done = simulate(folder, "--format", container)
        assert done.status == 0, done.err
        assert f"{folder / 'tunnel'}{SUFFIXES[container]}: 2 clouds by vlp16, seed 0" in done.err
        assert f"{folder / 'labels.geojson'}: 4 labels" in done.err
    return folders


# Bytes


@pytest.mark.parametrize("container", SUFFIXES)
def test_same_seed_same_bytes(tmp_path, made, container):
    """Of the log and the labels; in a folder, of every file. Another seed gives others."""
    assert simulate(tmp_path / "again", "--format", container).status == 0
    first, again = contents(made[container]), contents(tmp_path / "again")
    assert first == again
    assert (
        set(first)
        == {
            "mcap": {"labels.geojson", "tunnel.mcap"},
            "ros1": {"labels.geojson", "tunnel.bag"},
            "ros2": {"labels.geojson", "tunnel/metadata.yaml", "tunnel/tunnel.db3"},
        }[container]
    )
    assert simulate(tmp_path / "other", "--format", container, "--seed", 1).status == 0
    other = contents(tmp_path / "other")
    assert all(other[name] != first[name] for name in first if name != "tunnel/metadata.yaml")


def test_the_bytes_are_those_of_another_process(tmp_path, made):
    """Nothing hangs on the order of a set or on what ran before."""
    command = [sys.executable, "-m", "gapeval", "simulate", "tunnel", "--sensor", "vlp16", "--frames", "2"]
    environment = os.environ | {"PYTHONHASHSEED": "77"}
    subprocess.run([*command, "-o", tmp_path / "out"], check=True, env=environment, timeout=60)
    assert contents(tmp_path / "out") == contents(made["mcap"])


def test_every_cloud_has_noise_of_its_own():
    """A robot that stands still sees other points each time; fewer frames are the first of more."""
    one, two = clouds(simulation("plain", "vlp16", 2, 0))
    (alone,) = clouds(simulation("plain", "vlp16", 1, 0))
    other = next(clouds(simulation("plain", "vlp16", 1, 1)))
    assert {c.dtype for c in (one, two, alone)} == {np.dtype(np.float32)}
    phases = [np.angle(np.exp(1800j * np.arctan2(c[:, 1], c[:, 0])).mean()) for c in (one, two, other)]
    assert min(abs(phases[0] - phases[1]), abs(phases[0] - phases[2])) > 0.01
    assert len(alone) > 5000


# Containers


def test_frames_are_the_same_from_every_container(made):
    """Point by point and pose by pose."""
    several = [frames_of(folder / ("tunnel" + SUFFIXES[name])) for name, folder in made.items()]
    assert [len(frames) for frames in several] == [2, 2, 2]
    for frames in zip(*several, strict=True):
        assert len({frame.digest for frame in frames}) == 1
        for other in frames[1:]:
            assert other.points.tobytes() == frames[0].points.tobytes()
            assert other.pose.matrix.tobytes() == frames[0].pose.matrix.tobytes()
            assert other.pose.translation.tobytes() == frames[0].pose.translation.tobytes()
            assert other.stamp == frames[0].stamp


def stamp_of(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


@pytest.mark.parametrize("container", SUFFIXES)
def test_an_independent_reader_finds_the_topics(made, container):
    """Clouds of float32 x, y, z; poses fifty times a second, none at the stamp of a cloud; one mount."""
    path = made[container] / ("tunnel" + SUFFIXES[container])
    store = get_typestore(Stores.ROS2_HUMBLE) if container == "mcap" else None
    with AnyReader([path], default_typestore=store) as reader:
        topics = {name: (info.msgtype, info.msgcount) for name, info in reader.topics.items()}
        messages = [(c.topic, time, reader.deserialize(raw, c.msgtype)) for c, time, raw in reader.messages()]
    assert {name: kind for name, (kind, _) in topics.items()} == {
        "/points": CLOUD,
        "/tf": TF,
        "/tf_static": TF,
    }
    assert (topics["/points"][1], topics["/tf_static"][1]) == (2, 1)
    expected = [len(cloud) for cloud in clouds(simulation("tunnel", "vlp16", 2, 0))]
    scans, poses = [], []
    for topic, recorded, message in messages:
        if topic == "/points":
            assert [f.name for f in message.fields] == ["x", "y", "z"]
            assert [f.datatype for f in message.fields] == [7, 7, 7]
            assert [f.offset for f in message.fields] == [0, 4, 8]
            assert (message.header.frame_id, message.point_step, message.is_bigendian) == (
                "velodyne",
                12,
                False,
            )
            assert message.width * message.height == expected[len(scans)]
            scans.append(stamp_of(message.header))
            assert recorded > scans[-1]
        else:
            links = {(t.header.frame_id, t.child_frame_id): stamp_of(t.header) for t in message.transforms}
            if topic == "/tf_static":
                assert list(links) == [("base_link", "velodyne")]
            else:
                assert list(links) == [("map", "odom"), ("odom", "base_link")]
                assert len(set(links.values())) == 1
                poses.append(next(iter(links.values())))
    assert set(np.diff(poses)) == {20_000_000}
    assert not set(poses) & set(scans)
    assert poses[0] < scans[0]
    assert scans[-1] < poses[-1]
    order = [recorded for _, recorded, _ in messages]
    assert order == sorted(order)


def test_mcap_s_own_reader_finds_the_channels(made):
    with (made["mcap"] / "tunnel.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        stamps = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    kinds = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
    assert kinds == {"/points": CLOUD, "/tf": TF, "/tf_static": TF}
    assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
    assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
    assert len(stamps) == summary.statistics.message_count
    assert stamps == sorted(stamps), "not written in the order of time"


# The command


def test_the_list_names_every_scene_and_sensor():
    done = gapeval("simulate", "--list")
    assert done.status == 0
    first = [line.split()[0] for line in done.out.splitlines() if line.strip()]
    assert set(SCENES) | set(SENSORS) <= set(first)
    assert len(first) == len(SCENES) + len(SENSORS) + 2


@pytest.mark.parametrize(
    ("scene", "sensor", "choices"), [("canyon", "lms151", SCENES), ("plain", "radar", SENSORS)]
)
def test_unknown_names_are_answered_with_the_known(tmp_path, scene, sensor, choices):
    done = simulate(tmp_path / "out", scene=scene, sensor=sensor)
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert all(name in done.err for name in choices)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("options", [("--frames", 0), ("--seed", -1), ("--format", "csv")])
def test_impossible_options_are_refused(tmp_path, options):
    assert gapeval("simulate", "plain", *options, "-o", tmp_path / "out").status == 2
    assert not (tmp_path / "out").exists()


def test_the_same_command_again_succeeds(tmp_path, made):
    folder = tmp_path / "out"
    for container in ("mcap", "mcap", "ros2", "ros2", "ros1"):
        assert simulate(folder, "--format", container).status == 0
    alone = {name: content for other in made.values() for name, content in contents(other).items()}
    assert contents(folder) == alone


@pytest.mark.parametrize(
    "other",
    [
        {"scene": "barrel"},
        {"sensor": "hdl32e"},
        {"frames": 3},
        {"seed": 5},
    ],
)
def test_another_simulation_s_folder_is_left_alone(tmp_path, made, other):
    """One line, exit 1, nothing changed."""
    shutil.copytree(made["mcap"], tmp_path / "out")
    before = contents(tmp_path / "out")
    seed = ("--seed", other.pop("seed")) if "seed" in other else ()
    done = simulate(tmp_path / "out", *seed, **other)
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert str(tmp_path / "out") in done.err
    assert contents(tmp_path / "out") == before


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("labels.geojson", '{"type": "FeatureCollection", "frame_id": "map", "features": []}'),
        ("labels.geojson", "drawn by hand, not even JSON"),
        ("labels.geojson", "[]"),
        ("labels.geojson", '{"simulated": null}'),
        ("tunnel.mcap", "recorded"),
        ("tunnel", "a file where a folder goes"),
    ],
)
def test_the_work_of_a_hand_is_not_overwritten(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    done = simulate(tmp_path, "--format", "ros2" if name == "tunnel" else "mcap")
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert name in done.err
    assert contents(tmp_path) == {name: content.encode()}


def test_a_folder_of_somebody_else_s_beside_our_labels_is_not_deleted(tmp_path, made):
    """It has the name of the ROS 2 bag that is asked for, but what is in it is no bag of ours."""
    shutil.copy(made["mcap"] / "labels.geojson", tmp_path)
    (tmp_path / "tunnel").mkdir()
    (tmp_path / "tunnel/notes.txt").write_text("not to be lost")
    done = simulate(tmp_path, "--format", "ros2")
    assert (tmp_path / "tunnel/notes.txt").read_text() == "not to be lost"
    assert done.status == 1
    assert done.err.count("\n") == 1


@pytest.mark.parametrize("container", SUFFIXES)
@pytest.mark.parametrize("reason", [KeyboardInterrupt, RuntimeError])
def test_nothing_unfinished_is_left_behind(tmp_path, made, container, reason):
    """In an empty folder nothing; in one with the result, that result."""

    def give_up():
        raise reason

    simulated = simulation("tunnel", "vlp16", 2, 0)
    for folder, before in ((tmp_path / "new", {}), (tmp_path / "old", contents(made[container]))):
        if before:
            shutil.copytree(made[container], folder)
        with pytest.raises(reason):
            write_simulation(simulated, folder, container, give_up)
        assert contents(folder) == before
        assert not [p for p in folder.rglob("*") if p.name.endswith(".part")]


# A job in the background of a shell is born deaf to Ctrl-C.
LISTENING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from gapeval.cli import main
main(sys.argv[1:])
"""


def test_ctrl_c_leaves_nothing_behind(tmp_path):
    command = [sys.executable, "-c", LISTENING, "simulate", "plain", "--sensor", "vlp16", "--frames", "400"]
    process = subprocess.Popen([*command, "-o", tmp_path / "out"], stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 60
    while not list((tmp_path / "out").glob("plain*")) and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    # Python itself dies of the signal where it came within an exec(), as of a message's definition.
    assert process.returncode in (130, -signal.SIGINT)
    assert "interrupted" in err
    assert contents(tmp_path / "out") == {}


FULL = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from gapeval.cli import main
import gapeval.simulate.log
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
main(sys.argv[1:])
"""


@pytest.mark.parametrize("container", SUFFIXES)
def test_a_disk_that_is_full_is_one_line(tmp_path, container):
    """Of a limit to the size of a file; nothing is left behind."""
    command = [sys.executable, "-c", FULL, "simulate", "tunnel", "--sensor", "vlp16", "--frames", "3"]
    done = subprocess.run(
        [*command, "--format", container, "-o", tmp_path / "out"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1, done.stderr
    assert "a bug of ours" not in done.stderr
    assert contents(tmp_path / "out") == {}


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("here")
    done = simulate(tmp_path / "file" / "out")
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "-o" in done.err
    assert (tmp_path / "file").read_text() == "here"


def test_labels_check_and_info_are_content(made):
    labels, log = made["mcap"] / "labels.geojson", made["mcap"] / "tunnel.mcap"
    document = json.loads(labels.read_text())
    assert document["frame_id"] == "map"
    assert document["simulated"] == {"scene": "tunnel", "sensor": "vlp16", "frames": 2, "seed": 0}
    assert all(set(f["properties"]) >= {"id", "kind", "traversable", "length"} for f in document["features"])
    assert gapeval("labels", "check", labels).status == 0
    assert gapeval("info", log).status == 0


def test_a_sweep_finds_the_gaps(tmp_path):
    """The issue's own demand, by the paper's parameters at k 8."""
    assert simulate(tmp_path / "sim", sensor="lms151", frames=3).status == 0
    (tmp_path / "robot.yaml").write_text(PAPERS_ROBOT)
    options = ("-p", "k=8", "-p", "n_o=1", "-p", "delta_r=1.1", "--config", tmp_path / "robot.yaml")
    done = gapeval(
        "sweep", tmp_path / "sim/tunnel.mcap", "--labels", tmp_path / "sim/labels.geojson", *options,
        "-o", tmp_path / "out", "--jobs", 1,
    )  # fmt: skip
    assert done.status == 0, done.err
    with (tmp_path / "out/summary.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert all(float(row["hit_rate"]) > 0.9 for row in rows)
    assert {row["frames"] for row in rows} == {"3"}


def test_plain_ground_has_no_gap_to_find(tmp_path):
    assert simulate(tmp_path / "sim", scene="plain", frames=1).status == 0
    assert json.loads((tmp_path / "sim/labels.geojson").read_text())["features"] == []
