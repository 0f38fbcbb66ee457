"""A simulated log, read back, against what geometry alone says: ranges, walls, floors, poses, labels."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from simulated import (
    FACTS,
    FLOOR,
    GROUND,
    NOTHING,
    SOLID,
    WALL,
    Logs,
    first_hits,
    ground_ahead,
    in_sensor_frame,
    raster,
    true_pose,
    true_sensor,
)

from gapeval.frame import robot_plane
from gapeval.labels import crossing_yaw, place
from gapeval.simulate.casting import Hits
from gapeval.simulate.sensors import SENSORS

EVERY_SENSOR = tuple(FACTS)
GAPS = (
    ("tunnel", "lms151", 2, 0),
    ("barrel", "os1-64", 1, 1),
    ("street", "hdl32e", 3, 2),
    ("approach", "lms151", 3, 8),
)  # the last frame of each is looked at

LEAST = {
    "tunnel": {WALL: 200, SOLID: 30},
    "barrel": {WALL: 500, SOLID: 500},
    "street": {WALL: 150, SOLID: 200},
    "approach": {WALL: 500, FLOOR: 50},
}  # rays that meet each at the very least


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    return Logs(tmp_path_factory.mktemp("simulated"))


def test_there_is_no_sensor_that_is_not_written_down_here():
    assert list(SENSORS) == list(FACTS)


# Rays


@pytest.mark.parametrize("sensor", EVERY_SENSOR)
def test_every_echo_came_by_a_ray_of_the_data_sheet(logs, sensor):
    """Rings, columns, beams and scans; each by a ray of its own, from the lowest ring or the first roll on.

    Another frame has another phase.
    """
    log = logs.of("plain", sensor, 2)
    phases = []
    for frame in log.frames:
        found = raster(log.facts, in_sensor_frame(frame))
        assert found.off < 0.02
        assert (np.diff(found.order) >= 0).all()
        phases.append(found.phase)
        assert np.isfinite(found.ranges).sum() > 5000
    assert abs(phases[0] - phases[1]) > 0.02


@pytest.mark.parametrize("sensor", EVERY_SENSOR)
def test_the_sensor_is_where_it_says_and_looks_where_it_says(logs, sensor):
    """The log's own static transform: height above the ground, and tilt about the y axis, nose down."""
    log = logs.of("plain", sensor, 2)
    mount = log.frames[0].sensor
    facts = log.facts
    np.testing.assert_allclose(mount.translation, [facts.x, 0, facts.height + facts.ground_z], atol=1e-12)
    down = math.radians(facts.down)
    np.testing.assert_allclose(mount.matrix[:, 0], [math.cos(down), 0, -math.sin(down)], atol=1e-12)
    np.testing.assert_allclose(mount.matrix[:, 1], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("scene", "sensor", "frames", "stop"),
    [
        *(("plain", sensor, 2, 1) for sensor in EVERY_SENSOR),
        ("slope", "lms151", 4, 1),
        ("slope", "os1-128", 6, 4),
    ],
)
def test_ground_is_at_its_range_to_the_noise(logs, scene, sensor, frames, stop):
    """Of rays that go down steeply, against the height field as defined; on the ramps too."""
    log = logs.of(scene, sensor, frames)
    facts, truth = log.facts, log.truth.scene
    found = raster(facts, in_sensor_frame(log.frames[stop]))
    rotation, origin = true_sensor(truth, facts, stop)
    directions = found.rays.reshape(-1, 3) @ rotation.T
    measured = found.ranges.ravel()
    # Rays that meet the ground within 3 m: there is nothing else, so they are back, but for the near limit.
    steep = np.flatnonzero(directions[:, 2] < -facts.height / 3)
    steep = np.random.default_rng(0).permutation(steep)[:2500]
    expected, sine = ground_ahead(truth.ground, origin, directions[steep])
    sure = np.isfinite(expected) & (sine > 0.12) & (expected > facts.nearest + 0.1)
    back = np.isfinite(measured[steep])
    assert sure.sum() > 1000
    if facts.rings:
        assert back[sure].all()
    else:
        assert back[sure].mean() > 0.9  # the shadow filter
    sure &= back
    residual = (measured[steep] - expected)[sure]
    noise = facts.deviation(expected[sure])
    off = residual / noise
    # Between the vertices of the mesh, 0.1 m apart, the ground is lower or higher by a millimetre.
    mesh = 0.001 / sine[sure]
    assert (np.abs(residual) < 4.5 * noise + 3 * mesh).all()
    # Close by the laser's own shadow filter takes the worst of the noise away.
    clear = (mesh < 0.4 * noise) & (facts.rings > 0 or expected[sure] > 1.0)
    assert clear.sum() > 50
    assert abs(off[clear].mean()) < 4 / math.sqrt(clear.sum())
    assert 0.9 < off[clear].std() < 1.15


@pytest.mark.parametrize("sensor", ["lms151", "hdl32e"])
def test_walls_are_at_their_range_to_the_noise(logs, sensor):
    """Plane walls of the tunnel, with no mesh to excuse anything: mean, spread at every range, tails."""
    log = logs.of("barrel", sensor, 1, 5)
    facts, truth = log.facts, log.truth.scene
    found = raster(facts, in_sensor_frame(log.frames[0]))
    rotation, origin = true_sensor(truth, facts, 0)
    rows, columns = np.indices(found.ranges.shape).reshape(2, -1)
    pick = np.random.default_rng(1).permutation(len(rows))[:12000]
    rays = found.rays[rows[pick], columns[pick]] @ rotation.T
    expected, kind, sine = first_hits(truth, (), origin, rays, 0.0)
    measured = found.ranges[rows[pick], columns[pick]]
    with np.errstate(invalid="ignore"):
        over_the_ground = origin[2] + expected * rays[:, 2] > 0.06
    at_wall = (kind == SOLID) & (sine > 0.5) & (expected > 1.4) & over_the_ground & np.isfinite(measured)
    off = (measured - expected) / facts.deviation(expected)
    assert (np.abs(off[at_wall]) < 5).all()
    for low, high in ((1.4, 3.0), (3.0, 6.0), (6.0, 30.0)):
        some = off[at_wall & (expected > low) & (expected < high)]
        if len(some) > 250:
            assert abs(some.mean()) < 4 / math.sqrt(len(some))
            assert abs(some.std() - 1) < 4 / math.sqrt(2 * len(some))
            assert 0.25 < (np.abs(some) > 1).mean() < 0.39
    assert at_wall.sum() > 2000


@pytest.mark.parametrize("sensor", EVERY_SENSOR)
def test_as_many_echoes_of_plain_ground_as_geometry_says(logs, sensor):
    """Rays that go down come back, but at grazing angles; none that goes up does."""
    log = logs.of("plain", sensor, 2)
    facts = log.facts
    frame = log.frames[1]
    found = raster(facts, in_sensor_frame(frame))
    rotation, _ = true_sensor(log.truth.scene, facts, 1)
    down = -(found.rays @ rotation.T)[..., 2]
    seen = np.isfinite(found.ranges)
    assert found.ranges[seen].min() >= facts.nearest
    assert found.ranges[seen].max() <= facts.farthest + 5 * facts.deviation(np.array(facts.farthest))
    assert not seen[down < 0].any()
    reach = facts.height / np.where(down > 0, down, np.nan)
    possible = (reach > facts.nearest + 0.15) & (reach < facts.farthest)
    lost = np.minimum(1.0, down / math.sin(math.radians(facts.grazing)))
    expected = lost[possible].sum()
    got = (seen & possible).sum()
    assert (0.97 if facts.rings else 0.8) * expected < got < 1.03 * expected


# What a sensor loses


@pytest.mark.parametrize("sensor", EVERY_SENSOR)
def test_nothing_is_measured_nearer_or_farther_than_the_sensor_does(sensor):
    facts = FACTS[sensor]
    true = np.linspace(facts.nearest - 0.1, facts.farthest + 1, 40000)
    hits = Hits(true[:, None], np.ones((len(true), 1)))
    measured = SENSORS[sensor].ranges(hits, np.random.default_rng(3))[:, 0]
    noise = facts.deviation(true)
    seen = np.isfinite(measured)
    assert measured.min() >= facts.nearest
    assert not seen[true > facts.farthest].any()
    assert seen[(true > facts.nearest + 6 * noise) & (true < facts.farthest - 6 * noise)].all()
    off = (measured - true)[seen] / noise[seen]
    assert abs(off.mean()) < 0.03
    assert abs(off.std() - 1) < 0.02


@pytest.mark.parametrize("sensor", EVERY_SENSOR)
def test_echoes_thin_out_at_grazing_angles(sensor):
    """None is lost above the sensor's angle, half at the half, all at nothing."""
    limit = math.sin(math.radians(FACTS[sensor].grazing))
    for share, expected in ((0.0, 0.0), (0.25, 0.25), (0.5, 0.5), (0.75, 0.75), (1.0, 1.0), (3.0, 1.0)):
        hits = Hits(np.full((20000, 1), 3.0), np.full((20000, 1), share * limit))
        seen = np.isfinite(SENSORS[sensor].ranges(hits, np.random.default_rng(4)))
        assert abs(seen.mean() - expected) < 0.015
    nothing = Hits(np.full((9, 1), np.inf), np.ones((9, 1)))
    assert not np.isfinite(SENSORS[sensor].ranges(nothing, np.random.default_rng(4))).any()


def meets_beam_at(r: float, other: float) -> float:
    """Angle between a beam and the line from its echo to that of its neighbour, half a degree on."""
    step = math.radians(0.5)
    line = other * math.cos(step) - r, other * math.sin(step)
    angle = math.atan2(abs(line[1]), line[0])
    return min(angle, math.pi - angle)


def test_the_shadow_filter_echo_by_echo():
    """An echo goes if the line to a neighbour's runs along the beam: by 0.1 rad, or the half degree between
    the two beams more or less, as it may be that of either."""
    random = np.random.default_rng(5)
    ranges = np.exp(np.cumsum(random.normal(0, 0.08, (40, 541)), axis=1) * (random.random((40, 541)) < 0.7))
    ranges[random.random(ranges.shape) < 0.05] = np.inf
    kept = SENSORS["lms151"].pattern.kept(ranges)
    counts = {"dropped": 0, "kept": 0}
    for row, keep in zip(ranges.tolist(), kept.tolist(), strict=True):
        for i, r in enumerate(row):
            around = [row[k] for k in (i - 1, i + 1) if 0 <= k < len(row) and math.isfinite(row[k])]
            if not math.isfinite(r):
                continue
            angles = [meets_beam_at(r, other) for other in around]
            if any(angle < 0.1 - 0.009 for angle in angles):
                assert not keep[i]
                counts["dropped"] += 1
            elif all(angle > 0.1 + 0.009 for angle in angles):
                assert keep[i]
                counts["kept"] += 1
    assert min(counts.values()) > 3000
    for sensor in ("vlp16", "hdl32e", "os1-64", "os1-128"):
        assert SENSORS[sensor].pattern.kept(ranges).all()


def test_no_pair_of_neighbours_in_a_cloud_should_have_been_filtered(logs):
    log = logs.of("tunnel", "lms151", 2)
    ranges = raster(log.facts, in_sensor_frame(log.frames[0])).ranges
    pairs = [
        (a, b) for row in ranges.tolist() for a, b in pairwise(row) if math.isfinite(a) and math.isfinite(b)
    ]
    assert len(pairs) > 40000
    assert min(meets_beam_at(a, b) for a, b in pairs) > 0.1 - 0.009


# Gaps


@pytest.mark.parametrize(("scene", "sensor", "frames", "seed"), GAPS)
def test_every_ray_ends_where_geometry_says(logs, scene, sensor, frames, seed):
    """On walls and floors of holes, on the things around, on the ground: ray by ray, and none is missing."""
    log = logs.of(scene, sensor, frames, seed)
    facts, truth = log.facts, log.truth.scene
    stop = frames - 1
    found = raster(facts, in_sensor_frame(log.frames[stop]))
    rotation, origin = true_sensor(truth, facts, stop)
    rows, columns = np.indices(found.ranges.shape).reshape(2, -1)
    near = (found.rays.reshape(-1, 3) @ rotation.T)[:, 2] < -0.05
    pick = np.random.default_rng(1).permutation(np.flatnonzero(near))[:14000]
    rays = found.rays[rows[pick], columns[pick]] @ rotation.T
    people = truth.passing_at(stop)
    expected, kind, sine = first_hits(truth, people, origin, rays, 0.0)
    # The ground is rough by a centimetre: what is hit whether it were 5 cm higher or lower, is hit.
    sure = np.ones(len(rays), dtype=bool)
    for level in (-0.05, 0.05):
        other, other_kind, _ = first_hits(truth, people, origin, rays, level)
        sure &= (other_kind == kind) & ((other == expected) | (kind == GROUND))
    measured = found.ranges[rows[pick], columns[pick]]
    seen = np.isfinite(measured)
    assert not seen[sure & (kind == NOTHING)].any()
    noise = facts.deviation(np.where(np.isfinite(expected), expected, 0.0))
    off = (measured - expected) / noise
    met = {}
    for what in (WALL, FLOOR, SOLID):
        these = sure & (kind == what) & (expected > facts.nearest + 0.1) & (expected < 15)
        plain_view = these & (sine > math.sin(math.radians(facts.grazing)))
        if facts.rings and plain_view.any():
            assert seen[plain_view].mean() > 0.999
        elif these.sum() > 100:
            # The shadow filter takes what is beside an edge: of low rubble, a handful of beams high, most.
            assert seen[these & (sine > 0.4)].mean() > (0.3 if what == SOLID else 0.9)
        some = off[these & seen]
        met[what] = len(some)
        if len(some) < 20:
            continue
        assert (np.abs(some) < 5).mean() > 0.997
        inliers = some[np.abs(some) < 5]
        assert abs(inliers.mean()) < 5 / math.sqrt(len(inliers))
        assert abs(inliers.std() - 1) < 0.05 + 4 / math.sqrt(2 * len(inliers))
    assert all(met[what] > least for what, least in LEAST[scene].items())
    ground = sure & (kind == GROUND) & seen & (expected < 10)
    heights = origin[2] + measured[ground] * rays[ground, 2]
    assert ground.sum() > 300
    assert (np.abs(heights) < 0.05 + 5 * noise[ground] * np.abs(rays[ground, 2])).all()


@pytest.mark.parametrize(("scene", "sensor", "frames", "seed"), GAPS)
def test_no_point_floats_over_a_gap_and_no_ground_lies_in_one(logs, scene, sensor, frames, seed):
    """By the log's own poses and labels: inside a label all lies on a wall, the floor or the roof."""
    log = logs.of(scene, sensor, frames, seed)
    depths = {hole.id: hole.depth for hole in log.truth.scene.holes}
    roof = 2.9 * (log.facts.length / 0.68)
    inside = 0
    for frame in log.frames[-2:]:
        points = frame.pose.apply(frame.points.astype(np.float64))
        away = np.linalg.norm(frame.points - frame.sensor.translation, axis=1)
        noise = log.facts.deviation(away)
        for label in log.labels.labels:
            outline = shapely.Polygon(label.parts[0][0][:, :2])
            within = shapely.contains_xy(outline, points[:, :2]) & (points[:, 2] < roof)
            wall = shapely.distance(outline.exterior, shapely.points(points[within, :2]))
            floor = np.abs(points[within, 2] + depths[label.id])
            assert (np.minimum(wall, floor) < 5 * noise[within]).all()
            over = points[within, 2] > 0.05 + 5 * noise[within]
            assert not over.any()
            inside += int(within.sum())
    assert inside > 100


# Poses and labels


LABELLED = (
    *(("tunnel", "lms151", 2, seed) for seed in (0, 7)),
    *(("barrel", "vlp16", 2, seed) for seed in (1, 8)),
    *(("street", "lms151", 3, seed) for seed in (2, 9)),
    *(("approach", "vlp16", 3, seed) for seed in (3, 10)),
)


@pytest.mark.parametrize(("scene", "sensor", "frames", "seed"), LABELLED)
def test_labels_are_the_holes_in_every_frame(logs, scene, sensor, frames, seed):
    """To a millimetre, through the log's own transforms, and with the way across turned alike."""
    log = logs.of(scene, sensor, frames, seed)
    truth, facts = log.truth.scene, log.facts
    assert [label.id for label in log.labels.labels] == [hole.id for hole in truth.holes]
    assert {label.frame_id for label in log.labels.labels} == {log.recording.fixed_frame} == {"map"}
    assert len(log.frames) == len(truth.stops) == frames
    for stop, frame in enumerate(log.frames):
        rotation, translation = true_pose(truth, facts, stop)
        for label, hole in zip(log.labels.labels, truth.holes, strict=True):
            ring = shapely.get_coordinates(hole.outline.exterior)
            there = (np.column_stack([ring, np.zeros(len(ring))]) - translation) @ rotation
            np.testing.assert_allclose(there[:, 2], facts.ground_z, atol=1e-9)
            placed = place(label, frame.pose, robot_plane(facts.ground_z), log.recording.robot_frame)
            assert shapely.hausdorff_distance(placed, shapely.Polygon(there[:, :2])) < 1e-3
            np.testing.assert_allclose(label.parts[0][0][:, 2], 0.0, atol=1e-9)
            if label.crossing_yaw is not None:
                yaw = crossing_yaw(label, frame.pose, log.recording.robot_frame)
                turned = label.crossing_yaw - truth.stops[stop, 2] - yaw
                assert abs(math.remainder(turned, 2 * math.pi)) < 1e-9


@pytest.mark.parametrize(
    ("scene", "sensor", "frames", "seed"),
    [*LABELLED, ("slope", "lms151", 4, 0), ("slope", "os1-128", 6, 0), ("plain", "lms151", 2, 0)],
)
def test_the_pose_at_a_cloud_is_where_the_robot_stood(logs, scene, sensor, frames, seed):
    """Through map, odom and base_link; on the ramps it pitches with them, nose up on the way up."""
    log = logs.of(scene, sensor, frames, seed)
    assert (log.recording.robot_frame, log.recording.matched) == ("base_link", frames)
    for stop, frame in enumerate(log.frames):
        rotation, translation = true_pose(log.truth.scene, log.facts, stop)
        np.testing.assert_allclose(frame.pose.matrix, rotation, atol=1e-9)
        np.testing.assert_allclose(frame.pose.translation, translation, atol=1e-9)
    stamps = [frame.stamp for frame in log.frames]
    assert (np.diff(stamps) > 1e9 * log.facts.period).all()


@pytest.mark.parametrize(("sensor", "frames"), [("lms151", 4), ("os1-128", 6)])
def test_the_robot_pitches_with_the_ramp(logs, sensor, frames):
    """Eleven to fifteen degrees, up on the near ramp and down on the far one, level elsewhere."""
    log = logs.of("slope", sensor, frames)
    x, z = log.truth.scene.ground.profile.T
    ramp = math.degrees(math.atan2(z[1] - z[0], x[1] - x[0]))
    assert 11 <= ramp <= 15
    half = log.facts.length / 2
    on = {"up": 0, "down": 0, "level": 0}
    for frame in log.frames:
        place_x = float(frame.pose.translation[0])
        nose = math.degrees(math.asin(frame.pose.matrix[2, 0]))
        if x[0] + half + 0.1 < place_x < x[1] - half - 0.1:
            assert abs(nose - ramp) < 0.05
            on["up"] += 1
        elif x[2] + half + 0.1 < place_x < x[3] - half - 0.1:
            assert abs(nose + ramp) < 0.05
            on["down"] += 1
        elif place_x < x[0] - half - 0.1 or x[1] + half + 0.1 < place_x < x[2] - half - 0.1:
            assert abs(nose) < 1e-9
            on["level"] += 1
    assert on["level"] > 0
    assert on["up"] + on["down"] > 0
