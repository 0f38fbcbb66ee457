"""A planar laser that turns: its scans make a cloud for each pass."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from logs_checks import frames_of, line
from logs_writer import Record, static_record, tf_record, write_sorted
from moving_robot import SECOND, START, into_robot, poses, scan, tf

from gapeval.config import BodyBox, LogSection, RotatingLaser
from gapeval.frame import Transform, of_body, rotation_matrices
from gapeval.logs.read import read_frames, read_recording
from gapeval.logs.read.laser import beam_times, echoes, grazing, increment, last_beam
from gapeval.logs.read.messages.measurement import LaserScan
from gapeval.logs.read.motion import moved
from gapeval.logs.read.passes import passes, rotation, untwisted
from gapeval.logs.read.transforms import Transforms, slerp

# The shape of a turn


def stamps_of(count, rate=50):
    return START + np.arange(count) * (SECOND // rate)


def swing(rests, extent=math.pi / 2, rate=1.2, step=0.02):
    """Angles of a laser that goes to and fro, resting for so many scans at each turning point."""
    up = np.arange(-extent, extent, rate * step)
    parts = []
    for number, rest in enumerate(rests):
        one = up if number % 2 == 0 else -up
        parts += [one, np.full(rest, one[-1])]
    return np.concatenate(parts)


@given(st.lists(st.integers(0, 200), min_size=3, max_size=6), st.floats(0.2, math.pi / 2))
def test_each_way_of_a_swing_is_a_pass(rests, extent):
    angles = swing(rests, extent)
    found = passes(angles, stamps_of(len(angles)))
    assert len(found) == len(rests)
    assert all(one.is_whole for one in found)
    for one in found:
        assert np.ptp(angles[one.first : one.last]) >= 2 * extent - 3 * 1.2 * 0.02
    # No scan is in two passes.
    assert all(a.last <= b.first for a, b in pairwise(found))


@given(
    st.lists(st.integers(0, 60), min_size=3, max_size=4),
    st.floats(0.5, math.pi / 2),
    st.sampled_from([0.1, 0.3, 1.2]),
    st.sampled_from([0.0, 0.25, 1.0]),
    st.sampled_from([0.0, 0.2]),
    st.randoms(use_true_random=False),
)
def test_a_joint_may_tremble_and_count_in_steps(rests, extent, rate, grid, noise, random):
    """An encoder of 1 degree on a laser that turns by 0.1 degrees from scan to scan, with 0.2 of noise."""
    true = swing(rests, extent, rate)
    degrees = np.rad2deg(true) + noise * np.random.default_rng(random.randrange(2**32)).normal(size=len(true))
    told = np.deg2rad(degrees if grid == 0 else np.round(degrees / grid) * grid)
    found = passes(told, stamps_of(len(told)))
    assert len(found) == len(rests)
    assert all(one.is_whole for one in found)
    assert all(a.last <= b.first for a, b in pairwise(found))
    firsts = np.cumsum([0, *(len(swing([rest], extent, rate)) for rest in rests)])
    away = np.deg2rad(1.0 + 4 * noise + grid) + rate * 0.02 * 6
    for number, one in enumerate(found):
        turning = slice(firsts[number], firsts[number + 1] - rests[number])
        inside = np.abs(true[turning]) < extent - away
        kept = np.zeros(len(true), dtype=bool)
        kept[one.first : one.last] = True
        assert kept[turning][inside].all()
        # Of what rests beside it there is no more than it turns 5 degrees in.
        assert kept.sum() <= turning.stop - turning.start + 2 * (away + np.deg2rad(5)) / (rate * 0.02)


def test_a_laser_that_stops_on_its_way_makes_two_parts():
    angles = swing([0, 0, 0])
    middle = 65 + 131
    stopped = np.concatenate([angles[:middle], np.full(50, angles[middle]), angles[middle:]])
    found = passes(stopped, stamps_of(len(stopped)))
    assert [one.is_whole for one in found] == [True, False, False, True]
    assert (found[1].last, found[2].first) == (middle + 1, middle + 50)


def test_passes_of_a_laser_that_swings_like_a_pendulum():
    stamps = stamps_of(1000)
    angles = 1.3 * np.sin((stamps - START) / SECOND * 0.9 + 0.4)
    found = passes(angles, stamps)
    assert [one.is_whole for one in found] == [False, *[True] * 5, False]
    for one in found[1:-1]:
        assert abs(angles[one.first]) > 1.29
        assert abs(angles[one.last - 1]) > 1.29


@given(st.floats(0, 2 * math.pi), st.sampled_from([1, -1]))
def test_a_laser_that_goes_round_makes_a_pass_with_each_half_turn(first, way):
    angles = first + way * np.arange(0, 5 * math.pi, 0.03)
    found = passes(angles, stamps_of(len(angles)))
    whole = [one for one in found if one.is_whole]
    assert 4 <= len(whole) <= 5
    for one in whole:
        middle = (angles[one.first] + angles[one.last - 1]) / 2
        assert abs(math.remainder(middle, math.pi)) < 0.36  # through 0 or 180 degrees


def test_a_pass_that_the_log_cuts_is_incomplete():
    angles = swing([0, 0, 0])[60:]
    found = passes(angles, stamps_of(len(angles)))
    assert [one.is_whole for one in found] == [False, True, True]


@pytest.mark.parametrize(("part", "whole"), [(0.2, False), (0.6, False), (1.0, True)])
def test_a_pass_that_is_alone_is_whole_only_if_it_sees_all_around(part, whole):
    """Nothing says then how far the laser usually turns; half a turn sees all."""
    angles = swing([0])[: round(part * len(swing([0])))]
    assert [one.is_whole for one in passes(angles, stamps_of(len(angles)))] == [whole]


def test_a_laser_that_went_round_after_a_rest_is_cut_into_halves():
    angles = np.concatenate([np.full(100, 0.3), 0.3 + np.arange(0, 4.2 * math.pi, 0.03)])
    whole = [one for one in passes(angles, stamps_of(len(angles))) if one.is_whole]
    assert len(whole) >= 3
    for one in whole:
        assert np.ptp(angles[one.first : one.last]) == pytest.approx(math.pi, rel=0.21)


def test_scans_that_are_missing_end_a_pass():
    angles, stamps = swing([0, 0, 0]), stamps_of(3 * len(swing([0])))
    keep = np.r_[0:160, 240 : len(angles)]
    found = passes(angles[keep], stamps[keep])
    assert [one.is_whole for one in found] == [True, False, False, True]


@given(
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda v: np.linalg.norm(v) > 0.1),
)
def test_the_axis_is_found_however_the_laser_is_mounted(axis, mount):
    axis = np.array(axis) / np.linalg.norm(axis)
    mount = Transform.of([0, 0, 0], mount)
    angles = swing([3, 3])
    turns = np.column_stack([np.sin(angles / 2)[:, None] * axis, np.cos(angles / 2)])
    attitudes = _product(np.tile(mount.quaternion, (len(angles), 1)), turns)
    found = rotation(attitudes)
    assert abs(found.axis @ axis) > 1 - 1e-6
    assert np.ptp(found.angles) == pytest.approx(np.ptp(angles), abs=1e-6)
    still = rotation_matrices(untwisted(attitudes, found.axis))
    assert np.abs(still - still[0]).max() < 1e-6


@given(
    st.sampled_from([(0, 0, 1, 0), (0, 1, 0, 0), (1, 0, 0, 0), (0, 0, 0.8, 0.6)]),
    st.tuples(*[st.floats(-0.05, 0.05)] * 3),
    st.sampled_from([0, 1, 2]),
    st.sampled_from([-1, 1]),
)
def test_a_laser_may_look_back_or_hang_upside_down(mount, tilt, column, way):
    """Its mount stands upright or hangs, but never on its side, as one that is told from noise might."""
    mount = Transform.of([0, 0, 0], np.array([*tilt, 0.0]) + mount)
    axis = np.eye(3)[column]
    angles = way * swing([3, 3])
    turns = np.column_stack([np.sin(angles / 2)[:, None] * axis, np.cos(angles / 2)])
    attitudes = _product(np.tile(mount.quaternion, (len(angles), 1)), turns)
    found = rotation(attitudes)
    assert abs(found.axis @ axis) > 1 - 1e-6
    assert [one.is_whole for one in passes(found.angles, stamps_of(len(angles)))] == [True, True]
    np.testing.assert_allclose(np.diff(found.angles), np.diff(angles), atol=1e-9)
    still = rotation_matrices(untwisted(attitudes, found.axis))
    assert np.abs(still - still[0]).max() < 1e-6
    assert abs(still[0, 2, 2]) > 0.97
    # The angle is that from the mount as it is said to stand.
    turned = rotation_matrices(
        np.column_stack([np.sin(found.angles / 2)[:, None] * found.axis, np.cos(found.angles / 2)])
    )
    np.testing.assert_allclose(still @ turned, rotation_matrices(attitudes), atol=1e-9)


def test_what_does_not_turn_has_no_axis():
    assert rotation(np.tile([0.0, 0.0, 0.0, 1.0], (100, 1))) is None
    assert rotation(np.array([[0.0, 0.0, 0.0, 1.0]])) is None
    assert rotation(np.tile([0.0, 0.0, 1.0, 0.0], (100, 1))) is None
    shaking = 0.01 * np.random.default_rng(0).normal(size=100)
    turns = np.column_stack([np.sin(shaking / 2), np.zeros((100, 2)), np.cos(shaking / 2)])
    assert rotation(turns) is None


def _product(a, b):
    x1, y1, z1, w1 = a.T
    x2, y2, z2, w2 = b.T
    return np.column_stack(
        [
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
        ]
    )


# One scan


def a_scan(ranges, **other):
    values = {
        "stamp": START, "frame": "laser", "ranges": np.array(ranges, dtype=float).reshape(len(ranges), -1),
        "intensities": None, "angle_min": -1.0, "angle_increment": 0.5, "time_increment": 0.001,
        "range_min": 0.1, "range_max": 30.0,
    }  # fmt: skip
    return LaserScan(**(values | other))


def test_only_ranges_within_all_limits_count():
    ranges = [0.05, 0.1, 5.0, 30.0, math.inf, math.nan, 0.0, -1.0, 29.9]
    found = echoes(a_scan(ranges), RotatingLaser())
    assert np.hypot(found.points[:, 0], found.points[:, 1]) == pytest.approx([0.1, 5.0, 29.9])
    assert found.nanoseconds.tolist() == [1_000_000, 2_000_000, 8_000_000]
    angle = np.arctan2(found.points[:, 1], found.points[:, 0])
    assert angle[:2] == pytest.approx([-0.5, 0.0])
    assert (found.no_echo, found.shadows) == (6, 0)
    nearer = echoes(a_scan(ranges), RotatingLaser(range=(1.0, 10.0)))
    assert len(nearer.points) == 1


def test_the_users_time_from_beam_to_beam_wins():
    found = echoes(a_scan([1, 2, 3], time_increment=0.0), RotatingLaser(time_increment=2e-5))
    assert found.nanoseconds.tolist() == [0, 20_000, 40_000]


@pytest.mark.parametrize("own", [math.nan, math.inf, -math.inf, 1e30, -1e30])
def test_what_is_no_time_counts_as_none(own):
    found = echoes(a_scan([1, 2, 3], time_increment=own), RotatingLaser())
    assert found.nanoseconds.tolist() == [0, 0, 0]
    assert last_beam(3, increment(own, RotatingLaser(time_increment=2e-5))) == 40_000


@pytest.mark.parametrize(("echo", "expected"), [("first", [1, 4]), ("last", [3, 4]), ("strongest", [2, 4])])
def test_one_echo_of_each_beam(echo, expected):
    ranges = [[3.0, 2.0, 1.0], [math.nan, 4.0, math.nan], [math.nan] * 3]
    strength = np.array([[1.0, 9.0, math.nan], [0.0, 1.0, 99.0], [0.0, 0.0, 0.0]])
    found = echoes(a_scan(ranges, intensities=strength), RotatingLaser(echo=echo))
    assert np.hypot(found.points[:, 0], found.points[:, 1]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("echo", "expected"), [("first", [2, 5, 3]), ("last", [7, 5, 4]), ("strongest", [7, 5, 3])]
)
def test_echoes_that_are_no_measurements_do_not_hide_others(echo, expected):
    """Some drivers fill up with 0 or with more than range_max; a strength may be unknown."""
    ranges = [[0.0, 2.0, 7.0, 65.5], [0.02, 5.0, 40.0, math.inf], [math.nan, 3.0, 4.0, math.nan]]
    strength = np.array([[99, 1, 5, 99], [99, 1, 99, 0], [math.nan] * 4])
    found = echoes(a_scan(ranges, intensities=strength), RotatingLaser(echo=echo))
    assert np.hypot(found.points[:, 0], found.points[:, 1]) == pytest.approx(expected)
    assert (found.no_echo, found.shadows) == (0, 0)
    nearer = echoes(a_scan(ranges, intensities=strength), RotatingLaser(echo=echo, range=(2.5, 6.0)))
    assert np.hypot(*nearer.points.T[:2]) == pytest.approx([5, 4 if echo == "last" else 3])
    assert nearer.no_echo == 1


@given(
    st.integers(0, 2000), st.floats(-1e-3, 1e-3) | st.integers(-99999, 99999).map(lambda n: (n + 0.5) * 1e-9)
)
def test_the_last_beam_is_looked_up_at_the_time_that_it_has(beams, seconds):
    """One nanosecond more, and the whole pass would be measured beyond its transforms."""
    assert [last_beam(beams, seconds)] == beam_times(beams, seconds)[-1:].tolist() or beams == 0


@given(st.lists(st.floats(0.2, 20) | st.just(math.inf), min_size=2, max_size=20), st.floats(0.01, 0.5))
def test_the_shadow_filter_against_plain_geometry(ranges, least):
    """Two neighbours go where the line between them and one of their beams make too small an angle."""
    step, expected = 0.01, [False] * len(ranges)
    for i, (a, b) in enumerate(pairwise(ranges)):
        if math.isfinite(a) and math.isfinite(b):
            p, q = np.array([a, 0.0]), b * np.array([math.cos(step), math.sin(step)])
            line = q - p
            angle = math.acos(np.clip(abs(line @ [1.0, 0.0]) / np.linalg.norm(line), 0, 1))
            if abs(angle - least) < 1e-6:
                return
            if angle < least:
                expected[i] = expected[i + 1] = True
    assert grazing(np.array(ranges), step, least).tolist() == expected


@settings(max_examples=30)
@given(st.randoms(use_true_random=False))
def test_points_are_moved_as_one_by_one(random):
    rng = np.random.default_rng(random.randrange(2**32))
    knots = np.sort(rng.choice(10**8, 6, replace=False)) + START
    turns = rng.normal(size=(6, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    transforms = Transforms(rng.normal(size=(6, 3)), turns)
    points, times = rng.normal(size=(30, 3)), rng.integers(knots[0], knots[-1] + 1, 30)
    found = moved(points, times, knots, transforms)
    for point, time, place in zip(points, times, found, strict=True):
        left = min(int(np.searchsorted(knots, time, side="right")) - 1, 4)
        share = (time - knots[left]) / (knots[left + 1] - knots[left])
        turn = slerp(turns[left : left + 1], turns[left + 1 : left + 2], np.array([[share]]))[0]
        shift = transforms.translation[left] * (1 - share) + transforms.translation[left + 1] * share
        np.testing.assert_allclose(place, Transform.of(shift, turn).apply(point), atol=1e-9)


# Whole logs: a laser that rolls about its x axis before a wall and over the ground, on a robot that drives

FIRST, STEP, BEAMS = -2.2, 0.02, 221
INCREMENT = 2e-5
MOUNT = Transform.of([0.25, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0])
RATE = 1.2  # rad/s


def roll(stamps):
    """To and fro between -90 and 90 degrees, beginning at START."""
    t = (np.asarray(stamps) - START) / SECOND * RATE
    phase = np.mod(t, 2 * math.pi)
    return np.where(phase < math.pi, phase - math.pi / 2, 1.5 * math.pi - phase)


def ranges_at(stamp, moves):
    """Distances along each beam, at its own time, to the ground z = 0 or a wall x = 9 of the map."""
    times = stamp + np.round(np.arange(BEAMS) * INCREMENT * SECOND).astype(np.int64)
    azimuth = FIRST + STEP * np.arange(BEAMS)
    angle = roll(times)
    rays = np.column_stack(
        [np.cos(azimuth), np.sin(azimuth) * np.cos(angle), np.sin(azimuth) * np.sin(angle)]
    )
    place, turn = poses(times if moves else np.full(BEAMS, START))
    matrices = rotation_matrices(turn)
    rays = np.einsum("nij,nj->ni", matrices, rays)
    origin = np.einsum("nij,j->ni", matrices, MOUNT.translation) + place + [0, 0, 0.4]
    with np.errstate(divide="ignore"):
        ground, wall = -origin[:, 2] / rays[:, 2], (9 - origin[:, 0]) / rays[:, 0]
    distance = np.minimum(np.where(ground > 0, ground, np.inf), np.where(wall > 0, wall, np.inf))
    return np.where(distance < 40, distance, np.inf), origin + rays * np.minimum(distance, 50)[:, None]


def laser_log(path, moves, seconds=6.0, increment=INCREMENT, container="mcap-lz4", scans=None):
    joint = [
        tf_record(
            int(s), [("mount", "laser", (0, 0, 0), (math.sin(roll(s) / 2), 0, 0, math.cos(roll(s) / 2)))]
        )
        for s in START - SECOND // 4 + np.arange(int((seconds + 0.5) * 100)) * (SECOND // 100) + 555
    ]
    lifted = static_record(
        START - SECOND, [("base_link", "mount", MOUNT.translation.tolist(), MOUNT.quaternion.tolist())]
    )
    up = static_record(START - SECOND, [("world", "map", (0, 0, 0.4), (0, 0, 0, 1))])
    scans = scans or [
        scan(int(s), ranges_at(int(s), moves)[0], FIRST, STEP, increment)
        for s in START + np.arange(int(seconds * 50)) * (SECOND // 50)
    ]
    driving = tf(seconds) if moves else []
    return write_sorted(path, lifted, *([up] if moves else []), joint, driving, scans, container=container)


@pytest.mark.parametrize("container", ["mcap-lz4", "bag", "sqlite3"])
@pytest.mark.parametrize(("moves", "apart"), [(False, 0.005), (True, 0.02)])
def test_a_pass_is_the_cloud_that_a_laser_without_delay_would_see(tmp_path, moves, apart, container):
    path = laser_log(tmp_path / "log", moves, container=container)
    recording = read_recording(path, LogSection(fixed_frame="map" if moves else None))
    frames = frames_of(path, LogSection(fixed_frame="map" if moves else None))
    assert recording.planar
    assert recording.total == 3
    told = "3 passes of the laser, the whole ones of 178 to 180 deg, 0 scans in none of them"
    assert f"/scan: 300 planar scans, {told}" in recording.notices
    assert recording.refused == {"incomplete pass of the rotating laser": 1}
    assert len(frames) == 2
    first = START
    for frame in frames:
        stamps = np.arange(first, frame.stamp + 1, SECOND // 50)
        true = []
        for s in stamps:
            distance, world = ranges_at(int(s), moves)
            world = world[np.isfinite(distance)] - [0, 0, 0.4]
            at = frame.stamp if moves else START
            true.append(into_robot(world, np.full(len(world), at)))
        expected = np.vstack(true)
        assert len(frame.points) == len(expected)
        distance = np.linalg.norm(frame.points - expected, axis=1)
        assert distance.max() < apart
        # Another pass begins where this one ends.
        first = frame.stamp + SECOND // 50
        np.testing.assert_allclose(frame.sensor.matrix, np.eye(3), atol=1e-3)
        assert frame.others == ()


def test_a_wrong_time_from_beam_to_beam_can_be_overridden(tmp_path):
    path = laser_log(tmp_path / "log", moves=True, seconds=3.0, increment=0.0)
    as_recorded = read_recording(path, LogSection(fixed_frame="map"))
    assert any("no time from beam to beam" in notice for notice in as_recorded.notices)
    mended = frames_of(path, LogSection(fixed_frame="map", laser=RotatingLaser(time_increment=INCREMENT)))
    right = frames_of(laser_log(tmp_path / "right", moves=True, seconds=3.0), LogSection(fixed_frame="map"))
    wrong = frames_of(path, LogSection(fixed_frame="map"))
    assert mended[0].points.tobytes() == right[0].points.tobytes()
    assert np.abs(wrong[0].points - right[0].points).max() > 0.02


def test_time_may_run_backwards_through_a_scan(tmp_path):
    """The same beams, told from the last to the first: the same points, in another order."""
    usual = laser_log(tmp_path / "usual", moves=True, seconds=3.0)

    def backwards(stamp):
        ranges = ranges_at(stamp, True)[0][::-1]
        last = stamp + round((BEAMS - 1) * INCREMENT * SECOND)
        return scan(last, ranges, FIRST + STEP * (BEAMS - 1), -STEP, -INCREMENT)

    stamps = [int(s) for s in START + np.arange(150) * (SECOND // 50)]
    path = laser_log(tmp_path / "log", moves=True, seconds=3.0, scans=[backwards(s) for s in stamps])
    shadow = RotatingLaser(shadow_filter=0.05)
    for laser in (RotatingLaser(), shadow):
        (right,) = frames_of(usual, LogSection(fixed_frame="map", laser=laser))
        (found,) = frames_of(path, LogSection(fixed_frame="map", laser=laser))
        assert found.stamp == right.stamp + round((BEAMS - 1) * INCREMENT * SECOND)
        world = [frame.pose.apply(frame.points.astype(np.float64)) for frame in (right, found)]
        assert len(world[0]) == len(world[1])
        order = [np.lexsort(np.round(points, 2).T) for points in world]
        assert np.median(np.linalg.norm(world[0][order[0]] - world[1][order[1]], axis=1)) < 1e-3


MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
STAMPS = [int(s) for s in START + np.arange(150) * (SECOND // 50)]


def echo_scan(stamp, ranges):
    """As scan, each beam with its echo, none before it, and sometimes one behind it."""

    def build(store):
        single = scan(stamp, np.zeros(BEAMS), FIRST, STEP, INCREMENT).build(store)
        make = store.types["sensor_msgs/msg/LaserEcho"]
        every = [[r] if i % 3 else [] if np.isinf(r) else [0.0, r, r + 1] for i, r in enumerate(ranges)]
        values = {name: getattr(single, name) for name in single.__dataclass_fields__ if name[0] != "_"}
        values |= {
            "ranges": [make(echoes=np.array(one, dtype=np.float32)) for one in every],
            "intensities": [make(echoes=np.ones(len(one), dtype=np.float32)) for one in every],
        }
        return store.types[MULTI_ECHO](**values)

    return Record("/scan", MULTI_ECHO, stamp, build)


def test_scans_of_several_echoes_make_the_same_clouds(tmp_path):
    usual = frames_of(laser_log(tmp_path / "usual", True, 3.0), LogSection(fixed_frame="map"))
    scans = [echo_scan(stamp, ranges_at(stamp, True)[0]) for stamp in STAMPS]
    path = laser_log(tmp_path / "log", True, 3.0, scans=scans)
    assert len(usual) == 1
    for echo, is_same in (("first", True), ("strongest", True), ("last", False)):
        log = LogSection(fixed_frame="map", laser=RotatingLaser(echo=echo))
        (found,) = frames_of(path, log)
        assert (found.points.tobytes() == usual[0].points.tobytes()) == is_same
        assert found.dropped == usual[0].dropped


def test_beams_may_come_and_go_and_bag_times_may_be_the_right_ones(tmp_path):
    """Every third scan has fewer beams; the headers' clock is a day late."""
    day = 86400 * SECOND
    beams = [BEAMS - 60 * (i % 3 == 0) for i in range(len(STAMPS))]
    scans = []
    for stamp, count in zip(STAMPS, beams, strict=True):
        late = scan(stamp - day, ranges_at(stamp, True)[0][:count], FIRST, STEP, INCREMENT)
        scans.append(replace(late, time=stamp))
    path = laser_log(tmp_path / "log", True, 3.0, scans=scans)
    (found,) = frames_of(path, LogSection(fixed_frame="map", stamps="bag"))
    count = STAMPS.index(found.stamp) + 1
    true = []
    for stamp, kept in zip(STAMPS[:count], beams[:count], strict=True):
        distance, world = ranges_at(stamp, True)
        true.append((world - [0, 0, 0.4])[:kept][np.isfinite(distance[:kept])])
    expected = into_robot(np.vstack(true), np.full(sum(map(len, true)), found.stamp))
    assert np.linalg.norm(found.points - expected, axis=1).max() < 0.02


def test_the_robots_body_is_cut_out_of_each_scan(tmp_path):
    path = laser_log(tmp_path / "log", True, 3.0)
    box = BodyBox(x=(0.5, 1.5), y=(-0.5, 0.5), z=(-1.0, 1.0))
    recording = read_recording(path, LogSection(fixed_frame="map"), body=box)
    (found,) = read_frames(recording, 0, 1)
    count = STAMPS.index(found.stamp) + 1
    kept = 0
    for stamp in STAMPS[: count - 1]:
        distance, world = ranges_at(stamp, True)
        own = into_robot(
            world[np.isfinite(distance)] - [0, 0, 0.4], np.full(np.isfinite(distance).sum(), stamp)
        )
        kept += int((~of_body(own.astype(np.float32), box)).sum())
    last = int(np.isfinite(ranges_at(STAMPS[count - 1], True)[0]).sum())
    (whole,) = frames_of(path, LogSection(fixed_frame="map"))
    assert kept + last < 0.99 * len(whole.points)
    assert abs(len(found.points) - kept - last) <= 5  # at the edges of the box


def test_a_planar_laser_that_does_not_turn_is_told(tmp_path):
    fixed = static_record(START, [("base_link", "laser", (0, 0, 0.3), (0, 0, 0, 1))])
    scans = [scan(START + i * SECOND // 50, np.full(90, 3.0), -1.0, 0.02, 0.0) for i in range(20)]
    path = write_sorted(tmp_path / "log", fixed, tf(1.0), scans)
    assert line(path) == (
        "the planar laser on /scan does not turn against base_link, so its scans make no clouds; gapeval "
        "needs clouds, or planar scans of a laser that turns by tf"
    )
