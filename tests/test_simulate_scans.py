"""Logs of the paper's laser as its robot records them: planar scans, and the joint that it rolls about.

What is expected comes from numbers that are written here: the mounting, the rates, the flat ground.
"""

import json
import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import shapely
from command import gapeval
from logs_checks import frames_of
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation, Slerp

from gapeval.errors import ConfigError
from gapeval.labels import labels_text
from gapeval.logs.write import CONTAINERS, log_path
from gapeval.simulate import scans as planar
from gapeval.simulate.log import write_simulation
from gapeval.simulate.scans import passes, scans
from gapeval.simulate.sensors import Noise
from gapeval.simulate.simulation import Taking, simulation
from gapeval.simulate.turns import turns
from gapeval.simulate.variation import Variation

START = 1_700_000_000 * 10**9
SCAN, BEAM = 20_000_000, 20e-3 / 720  # ns, s
HEIGHT, AHEAD, GROUND = 0.2132, 0.2502, -0.0705  # m: laser above the ground and before base_link; its foot
AZIMUTH = np.radians(np.arange(541) * 0.5 - 135.0)
PASS, RAMP = math.pi / 1.2, 0.2  # s
WAYS = {"standing": Taking(scans=True), "moving": Taking(scans=True, moving=True)}


def flat(way, frames=2, seed=0):
    """On ground that is level to the last bit, by a laser without noise that loses nothing."""
    made = simulation("plain", "lms151", frames, seed, Variation(roughness=0.0), WAYS[way])
    return replace(made, sensor=replace(made.sensor, noise=Noise(0.0), grazing=0.0))


def all_of(parts):
    parts = list(parts)
    return (np.concatenate([getattr(p, name) for p in parts]) for name in ("stamps", "ranges", "true"))


def rolls(way, made, seconds):
    """The joint's angle, from what is written about it: 1.2 rad/s from side to side, 0.2 s to get there."""
    if way == "moving":
        whole = int(made.drive.times[-1] / (PASS + 2 * RAMP))  # none that the drive is too short for
        begins = [RAMP + i * (PASS + 2 * RAMP) for i in range(whole)]
    else:
        begins = [(int(stamp) - START) / 1e9 - PASS for stamp in made.drive.stamps]
    angles = np.full(seconds.shape, -math.pi / 2 - 0.12)  # where it rests before the first pass
    for number, begin in enumerate(begins):
        side = 1 if number % 2 == 0 else -1
        t = seconds - begin
        speeding, slowing = (t + RAMP).clip(0, RAMP), (t - PASS).clip(0, RAMP)
        travelled = 3.0 * speeding**2 + 1.2 * t.clip(0, PASS) + 1.2 * slowing - 3.0 * slowing**2
        angles = np.where(t > -RAMP, side * (-math.pi / 2 - 0.12 + travelled), angles)
    return angles


# Geometry


@pytest.mark.parametrize("way", WAYS)
def test_every_beam_meets_flat_ground_where_geometry_says(way):
    """Range and place of each, by the pose and the roll at its own time; of all scans, at rest too."""
    made = flat(way)
    stamps, ranges, true = all_of(scans(made))
    assert ranges.dtype == np.float32
    seconds = (stamps - START)[:, None] / 1e9 + np.arange(541) * BEAM
    down = -np.sin(AZIMUTH) * np.sin(rolls(way, made, seconds))
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(down > 0, HEIGHT / down, np.inf)
    # A beam that ends within a hair of the farthest range may be on either side of it.
    sure = np.abs(expected - 20) > 1e-3
    near = expected < 20
    assert ((ranges > 0) == near)[sure].all()
    assert near.sum() > 40_000
    assert set(ranges[~near & sure]) == {0.0}
    both = near & (ranges > 0)
    assert np.abs(ranges - expected)[both].max() < 5e-6
    x, y, yaw = made.drive.at(seconds.reshape(-1)).T.reshape(3, *seconds.shape)
    along = AHEAD + ranges * np.cos(AZIMUTH)
    across = ranges * np.sin(AZIMUTH) * np.cos(rolls(way, made, seconds))
    places = np.stack(
        [
            x + np.cos(yaw) * along - np.sin(yaw) * across,
            y + np.sin(yaw) * along + np.cos(yaw) * across,
            np.zeros(x.shape),
        ],
        axis=-1,
    )
    assert np.abs(true - places)[both].max() < 2e-5
    assert np.isnan(true[ranges == 0]).all()


def test_the_laser_turns_to_and_fro_through_a_right_angle_to_either_side():
    for way in WAYS:
        made = flat(way, 3)
        every = list(passes(made))
        assert len(every) >= 2
        for number, one in enumerate(every):
            roll = rolls(way, made, (one.stamps - START) / 1e9)
            assert abs(roll).max() < math.pi / 2 + 0.12 + 1e-9
            assert (np.sign(np.diff(roll)) == (1 if number % 2 == 0 else -1)).all()
            inside = np.flatnonzero(abs(roll) < math.pi / 2)
            assert np.allclose(np.abs(np.diff(roll[inside])), 1.2 / 50, atol=1e-9)
            assert len(inside) in (130, 131)
            assert one.stamp == one.stamps[-1]
            # The whole sphere, near enough.
            assert roll[inside].min() < -math.pi / 2 + 0.03
            assert roll[inside].max() > math.pi / 2 - 0.03


def test_true_points_are_those_that_the_robot_sees_from_where_it_is_at_the_last_scan():
    made = flat("moving", 3)
    stamps, _, true = all_of(scans(made))
    for one in passes(made):
        x, y, yaw = made.drive.at(np.array([(one.stamp - START) / 1e9]))[0]
        away = true[np.searchsorted(stamps, one.stamps)] - [x, y, 0.0]
        c, s = math.cos(yaw), math.sin(yaw)
        expected = np.stack(
            [c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0], away[..., 2] + GROUND],
            axis=-1,
        )
        seen = np.isfinite(one.true)
        assert (seen == np.isfinite(expected)).all()
        assert np.abs(one.true - expected)[seen].max() < 1e-9


def test_noise_is_the_sensor_s_and_no_scan_has_another_s():
    made = simulation("plain", "lms151", 2, 0, Variation(roughness=0.0), WAYS["standing"])
    exact = replace(made, sensor=replace(made.sensor, noise=Noise(0.0), grazing=0.0))
    stamps, noisy, _ = all_of(scans(made))
    _, right, _ = all_of(scans(exact))
    both = (noisy > 0) & (right > 0.3) & (right < 10)
    deviation = np.maximum(0.012, 0.0068 * right + 0.0008)
    off = ((noisy - right) / deviation)[both]
    assert abs(off.mean()) < 0.01
    assert abs(off.std() - 1) < 0.01
    assert abs(np.corrcoef(off[:-1], off[1:])[0, 1]) < 0.02
    # A joint at rest sees the same ground in scan after scan, each time a little differently.
    rest = np.flatnonzero(planar.joint_of(made).passes((stamps - START) / 1e9) < 0)[:2]
    assert (noisy[rest[0]] != noisy[rest[1]])[both[rest].all(axis=0)].mean() > 0.99


# The drive


@pytest.mark.parametrize("scene", ["tunnel", "street", "approach"])
@pytest.mark.parametrize("sensor", ["lms151", "vlp16"])
def test_a_robot_that_drives_on_changes_its_speed_gently(scene, sensor):
    """So that what is interpolated between poses 20 ms apart is right to a tenth of a millimetre."""
    made = simulation(scene, sensor, 5, 1, taking=Taking(scans=sensor == "lms151", moving=True))
    drive, step = made.drive, 0.02
    places = drive.at(np.arange(drive.times[0], drive.times[-1], step))
    speed = np.diff(places, axis=0) / step
    assert np.hypot(speed[:, 0], speed[:, 1]).max() <= 0.4 + 1e-6
    assert np.abs(speed[:, 2]).max() <= 0.5 + 1e-6
    change = np.diff(speed, axis=0) / step
    assert np.hypot(change[:, 0], change[:, 1]).max() <= 2 * 0.4 / 0.4 + 1e-6
    assert np.abs(change[:, 2]).max() <= 2 * 0.5 / 0.4 + 1e-6
    by = drive.at((drive.stamps - START) / 1e9)
    assert np.hypot(*(by - made.scene.stops).T[:2]).max() < 0.05
    turned = by[:, 2] - made.scene.stops[:, 2]
    assert np.abs(np.remainder(turned + math.pi, 2 * math.pi) - math.pi).max() < 0.06
    assert np.allclose(drive.at(np.zeros(1))[0], made.scene.stops[0], atol=1e-9)
    assert np.allclose(drive.places[-1], drive.places[-2], atol=3e-4)  # it has come to rest
    # From stop to stop it takes a pass, or as long as there is to drive.
    least = PASS + 2 * RAMP if sensor == "lms151" else 0.1
    assert np.diff(drive.stamps).min() >= least * 1e9 - 1e6


@pytest.mark.parametrize("scene", ["tunnel", "barrel", "street", "approach"])
def test_a_robot_that_drives_on_drives_over_no_hole(scene):
    for seed in range(5):
        made = simulation(scene, "lms151", 8, seed, taking=WAYS["moving"])
        taken = shapely.union_all([hole.outline for hole in made.scene.holes])
        for x, y, yaw in made.drive.at(np.arange(0.0, made.drive.times[-1], 0.25)):
            box = shapely.affinity.rotate(
                shapely.box(-0.34, -0.25, 0.34, 0.25), yaw, (0, 0), use_radians=True
            )
            assert not shapely.affinity.translate(box, x, y).intersects(taken)


def test_the_robot_goes_on_while_a_scan_is_made():
    """0.4 m/s for the 15 ms from the first beam to the last, seen from where the rays began."""
    made = simulation("approach", "lms151", 2, 0, Variation(roughness=0.0), WAYS["moving"])
    middle = (made.drive.times[-1] / 2) // 0.02 * 0.02
    ends = made.drive.at(np.array([middle, middle + 540 * BEAM]))
    assert np.hypot(*(ends[1] - ends[0])[:2]) == pytest.approx(0.4 * 540 * BEAM, rel=1e-6)
    origins, _ = planar.mounts_at(made, np.array([middle, middle + 540 * BEAM]))
    assert np.linalg.norm(origins[1] - origins[0]) == pytest.approx(0.4 * 540 * BEAM, rel=1e-3)


def test_people_are_gone_when_the_robot_has_left():
    """They stand before the third stop of the street until it drives on to the fourth."""
    made = simulation("street", "lms151", 4, 2, taking=WAYS["standing"])
    people = shapely.union_all([solid.outline for solid in made.scene.passing_at(2)]).buffer(0.05)
    before, at = made.drive.departures[1], made.drive.departures[2]
    hit = {"before": 0, "at": 0, "after": 0}
    for part in scans(made):
        seconds = (part.stamps - START) / 1e9
        for when, own in (
            ("before", seconds < before),
            ("at", (seconds > before) & (seconds < at - 0.02)),
            ("after", seconds > at),
        ):
            high = part.true[own & (seconds > before - 3)]
            high = high[high[..., 2] > 0.5]
            hit[when] += int(shapely.contains_xy(people, high[:, 0], high[:, 1]).sum())
    assert hit["at"] > 500
    assert hit["before"] == 0
    # The stop after it has people of its own, elsewhere.
    assert hit["after"] == 0 or len(made.scene.passing_at(3)) == 2


# The log


@pytest.fixture(scope="module", params=WAYS)
def made(request, tmp_path_factory):
    """Way, simulation and a log of it."""
    simulated = simulation("approach", "lms151", 2, 3, taking=WAYS[request.param])
    log, _ = write_simulation(simulated, tmp_path_factory.mktemp("made"), "mcap", lambda: None)
    return request.param, simulated, log


def stamp_of(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def messages_of(path):
    store = get_typestore(Stores.ROS2_HUMBLE) if path.suffix == ".mcap" else None
    with AnyReader([path], default_typestore=store) as reader:
        return [(c.topic, time, reader.deserialize(raw, c.msgtype)) for c, time, raw in reader.messages()]


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("way", WAYS)
def test_an_independent_reader_finds_the_scans_of_a_real_driver(tmp_path, way, container):
    simulated = simulation("tunnel", "lms151", 2, 0, taking=WAYS[way])
    log, _ = write_simulation(simulated, tmp_path, container, lambda: None)
    stamps, ranges, _ = all_of(scans(simulated))
    messages = messages_of(log)
    assert {topic for topic, _, _ in messages} == {"/scan", "/tf", "/tf_static"}
    found = [message for topic, _, message in messages if topic == "/scan"]
    assert [stamp_of(m.header) for m in found] == stamps.tolist()
    assert set(np.diff(stamps)) == {SCAN}
    for message, row in zip(found, ranges, strict=True):
        assert message.ranges.tobytes() == row.tobytes()
    one = found[0]
    assert (one.header.frame_id, len(one.ranges), len(one.intensities)) == ("laser", 541, 0)
    assert (one.angle_min, one.angle_max) == pytest.approx((-0.75 * math.pi, 0.75 * math.pi))
    assert one.angle_increment == pytest.approx(math.radians(0.5))
    assert (one.time_increment, one.scan_time) == pytest.approx((BEAM, 0.02))
    assert (one.range_min, one.range_max) == pytest.approx((0.2, 20.0))
    seconds = (stamps - START) / 1e9
    inside = np.abs(rolls(way, simulated, seconds)) < math.pi / 2
    assert inside.sum() >= 2 * 130 if way == "standing" else 130
    order = [time for _, time, _ in messages]
    assert order == sorted(order)


def interpolated(messages, stamps):
    """fixed<-laser at stamps: rotations and translations, from tf alone."""
    total, place = Rotation.identity(len(stamps)), np.zeros((len(stamps), 3))
    samples = {}
    for topic, _, message in messages:
        for link in message.transforms if topic.startswith("/tf") else ():
            name = link.header.frame_id, link.child_frame_id
            t, q = link.transform.translation, link.transform.rotation
            values = (t.x, t.y, t.z, q.x, q.y, q.z, q.w)
            samples.setdefault(name, []).append((stamp_of(link.header), *values))
    chain = [("map", "odom"), ("odom", "base_link"), ("base_link", "laser_mount"), ("laser_mount", "laser")]
    assert set(samples) == set(chain)
    for name in chain:
        rows = samples[name]
        times = np.array([row[0] for row in rows])
        values = np.array([row[1:] for row in rows])
        if len(rows) == 1:
            offset, turn = np.repeat(values[:, :3], len(stamps), 0), Rotation.from_quat(values[0, 3:])
        else:
            assert not set(times) & set(stamps), f"{name} has a sample at a scan's stamp"
            assert times[0] < stamps[0]
            assert stamps[-1] + SCAN < times[-1]
            base = times[0]
            offset = np.column_stack([np.interp(stamps - base, times - base, v) for v in values.T[:3]])
            turn = Slerp(times - base, Rotation.from_quat(values[:, 3:]))(stamps - base)
        place = place + total.apply(offset)
        total = total * turn
    return total, place, {name: np.diff([row[0] for row in rows]) for name, rows in samples.items()}


def test_tf_between_its_samples_is_where_the_rays_began(made):
    """At the first and last beam of a scan to 0.1 mm and 0.2 mrad, also where the joint speeds up.

    A joint at a constant rate is exact; one that speeds up by 6 rad/s2 is 0.08 mrad off between samples 10 ms
    apart, the robot's yaw by 2.5 rad/s2 0.13 mrad between those 20 ms apart.
    """
    way, simulated, log = made
    messages = messages_of(log)
    first = np.array([stamp_of(m.header) for topic, _, m in messages if topic == "/scan"])
    for stamps in (first, first + round(540 * BEAM * 1e9)):
        turned, place, steps = interpolated(messages, stamps)
        seconds = (stamps - START) / 1e9
        roll = rolls(way, simulated, seconds)
        x, y, yaw = simulated.drive.at(seconds).T
        exact = Rotation.from_euler("ZX", np.column_stack([yaw, roll]))
        expected = np.column_stack(
            [x + AHEAD * np.cos(yaw), y + AHEAD * np.sin(yaw), np.full(len(x), HEIGHT)]
        )
        still = np.ones(len(stamps), dtype=bool)
        if way == "standing":  # while it drives it starts at once, and nobody asks for those scans
            still = planar.joint_of(simulated).passes(seconds) >= 0
        assert np.linalg.norm(place - expected, axis=1)[still].max() < 1e-4
        off = (turned.inv() * exact).magnitude()
        assert off[still].max() < 2e-4
        if way == "standing":
            assert off[still & (np.abs(roll) < math.pi / 2 - 0.03)].max() < 1e-6
    assert set(steps[("laser_mount", "laser")]) == {10_000_000}
    assert set(steps[("odom", "base_link")]) == {20_000_000}


# Bytes


def test_same_seed_same_bytes_in_another_process(tmp_path):
    made = simulation("barrel", "lms151", 2, 3, taking=WAYS["moving"])
    write_simulation(made, tmp_path / "here", "mcap", lambda: None)
    command = [sys.executable, "-m", "gapeval", "simulate", "barrel", "--frames", "2", "--seed", "3"]
    environment = os.environ | {"PYTHONHASHSEED": "77"}
    subprocess.run(
        [*command, "--scans", "--moving", "-o", tmp_path / "there"], check=True, env=environment, timeout=60
    )
    for name in ("barrel.mcap", "labels.geojson"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()


def test_scans_are_the_same_however_many_are_cast_at_once(monkeypatch):
    made = simulation("barrel", "lms151", 2, 0, taking=WAYS["moving"])
    _, whole, places = all_of(scans(made))
    monkeypatch.setattr(planar, "AT_ONCE", 37)
    _, again, same = all_of(scans(made))
    assert whole.tobytes() == again.tobytes()
    assert np.array_equal(places, same, equal_nan=True)
    other = simulation("barrel", "lms151", 2, 1, taking=WAYS["moving"])
    assert next(scans(other)).ranges.tobytes() != whole[:37].tobytes()


# The command


def test_labels_are_those_of_clouds_and_say_how_the_log_was_taken(made):
    way, simulated, log = made
    document = json.loads((log.parent / "labels.geojson").read_text())
    told = {"scene": "approach", "sensor": "lms151", "frames": 2, "seed": 3, "scans": True}
    assert document["simulated"] == told | ({"moving": True} if way == "moving" else {})
    assert "stamps" not in document
    clouds = simulation("approach", "lms151", 2, 3)
    assert labels_text(simulated.labels, "map") == labels_text(clouds.labels, "map")


def test_the_command_says_what_it_wrote_and_refuses_another_in_its_place(tmp_path):
    command = ("simulate", "tunnel", "--frames", 2, "-o", tmp_path)
    done = gapeval(*command, "--scans")
    assert done.status == 0
    assert "scans in 2 passes by lms151, seed 0; " in done.err
    before = (tmp_path / "tunnel.mcap").read_bytes()
    for options in ((), ("--scans", "--moving")):
        done = gapeval(*command, *options)
        assert (done.status, done.err.count("\n")) == (1, 1)
        assert (
            "holds another simulation (scene tunnel, sensor lms151, frames 2, seed 0, scans True)" in done.err
        )
    assert (tmp_path / "tunnel.mcap").read_bytes() == before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--scans", "--sensor", "vlp16"), "vlp16 makes no planar scans"),
        (("--moving",), "clouds of lms151 are of a robot that stands"),
        (("--scans", "--moving", "--frames", 1), "take 2 frames or more"),
    ],
)
def test_what_cannot_be_taken_is_one_line(tmp_path, options, said):
    done = gapeval("simulate", "plain", *options, "-o", tmp_path / "out")
    assert (done.status, done.err.count("\n")) == (2, 1)
    assert said in done.err
    assert not (tmp_path / "out").exists()


def test_other_ways_are_refused_in_python_too():
    with pytest.raises(ConfigError, match="planar"):
        simulation("plain", "os1-64", 2, 0, taking=Taking(scans=True))


# Spinning sensors on a robot that drives on


def test_points_of_a_spinning_sensor_lie_where_it_was_at_their_times(tmp_path):
    """On flat ground: carried by the pose at its own time, every point is on it, by the one of the cloud's
    stamp it is not; and the truth is.
    """
    made = simulation("plain", "vlp16", 3, 0, Variation(roughness=0.0), Taking(moving=True))
    made = replace(made, sensor=replace(made.sensor, noise=Noise(0.0), grazing=0.0))
    turned = math.cos(math.radians(15)), math.sin(math.radians(15))  # the sensor looks down so far
    path = log_path(tmp_path, "plain", "ros1")
    write_simulation(made, tmp_path, "ros1", lambda: None)
    clouds = [m for topic, _, m in messages_of(path) if topic == "/points"]
    assert {tuple((f.name, f.offset, f.datatype) for f in m.fields) for m in clouds} == {
        (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("t", 12, 6))
    }
    stamps = [stamp_of(m.header) for m in clouds]
    assert set(np.diff(stamps)) == {100_000_000}
    kind = np.dtype([("xyz", "<f4", 3), ("t", "<u4")])
    worst = 0.0
    for message, turn in list(zip(clouds, turns(made), strict=True))[5::6]:
        rows = np.frombuffer(bytes(message.data), dtype=kind)
        assert rows["xyz"].tobytes() == turn.points.tobytes()
        assert rows["t"].tobytes() == turn.nanoseconds.tobytes()
        times = rows["t"].astype(np.int64)
        assert times.max() < 1e8
        assert np.ptp(times) > 5e7  # it looks down ahead and up behind
        azimuth = np.arctan2(rows["xyz"][:, 1], rows["xyz"][:, 0])
        column = np.remainder(azimuth + math.pi + 1e-6, 2 * math.pi) / (2 * math.pi)
        assert np.abs(column - times / 1e8).max() < 1e-4
        x, y, z = rows["xyz"].astype(float).T
        along, up = turned[0] * x + turned[1] * z + 0.3, turned[0] * z - turned[1] * x + 0.6
        assert np.abs(up).max() < 2e-5
        place = made.drive.at((turn.stamp + times - START) / 1e9)
        now = made.drive.at(np.array([(turn.stamp - START) / 1e9]))[0]
        there = carried(place, along, y)
        away = there - now[:2]
        c, s = math.cos(now[2]), math.sin(now[2])
        seen = np.column_stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]])
        assert np.abs(seen - turn.true[:, :2]).max() < 1e-4
        assert np.abs(turn.true[:, 2] + 0.1).max() < 2e-5
        worst = max(worst, float(np.linalg.norm(np.column_stack([along, y]) - seen, axis=1).max()))
    assert worst > 0.035  # m that it is skewed by: 0.4 m/s for 0.1 s


def carried(place, along, across):
    x, y, yaw = place.T
    return np.column_stack(
        [
            x + np.cos(yaw) * along - np.sin(yaw) * across,
            y + np.sin(yaw) * along + np.cos(yaw) * across,
        ]
    )


def test_skewed_clouds_are_read_as_any_cloud(tmp_path):
    made = simulation("barrel", "vlp16", 2, 0, taking=Taking(moving=True))
    path, _ = write_simulation(made, tmp_path, "ros2", lambda: None)
    frames = frames_of(path)
    assert [frame.stamp for frame in frames] == [turn.stamp for turn in turns(made)]
    assert len(frames) >= 5
