"""What scenes are about, for twenty seeds and every robot; their labels; their meshes; the casters."""

import math
import subprocess
import sys
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated import FACTS

from gapeval.errors import ConfigError
from gapeval.simulate.casting import cast, caster
from gapeval.simulate.layouts import SCENES
from gapeval.simulate.mesh import ground_triangles, solid_triangles, static_triangles
from gapeval.simulate.scene import Ground, Hole, Scene, Solid, rectangle, roughness
from gapeval.simulate.simulation import simulation
from gapeval.simulate.truth import can_be_crossed, narrowest

SEEDS = range(20)
ROBOTS = ("lms151", "vlp16")  # a sensor of each robot
NARROW = 0.45  # m; approach has trenches of 0.3, 0.6 and 1.2 m
HEIGHT = 0.6  # m; what begins below it is in a robot's way


def scenes(name, robot, frames=8):
    """The same scene by twenty seeds."""
    return [simulation(name, robot, frames, seed) for seed in SEEDS]


def footprint(place, robot, longer=0.0):
    """A robot's outline at x, y, yaw; longer: so much is put on at its front [m]."""
    facts = FACTS[robot]
    half = facts.length / 2
    box = shapely.box(-half, -facts.width / 2, half + longer, facts.width / 2)
    c, s = math.cos(place[2]), math.sin(place[2])
    return shapely.affinity.affine_transform(box, [c, -s, s, c, place[0], place[1]])


def holes_of(simulated):
    return shapely.union_all([hole.outline for hole in simulated.scene.holes])


def in_the_way(simulated):
    """What stands on the ground or hangs lower than a robot is high."""
    return shapely.union_all([s.outline for s in simulated.scene.solids if s.bottom < HEIGHT])


# Character


def test_robots_are_those_of_the_sensors():
    for sensor, facts in FACTS.items():
        robot = simulation("plain", sensor, 1, 0).sensor.robot
        assert (robot.length, robot.width, robot.ground_z) == (facts.length, facts.width, facts.ground_z)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", SCENES)
def test_holes_are_sound_and_apart(name, robot):
    for simulated in scenes(name, robot):
        holes = simulated.scene.holes
        assert all(hole.outline.is_valid and hole.outline.area > 0.05 and hole.depth > 0.2 for hole in holes)
        assert len({hole.id for hole in holes}) == len(holes)
        assert all(a.outline.distance(b.outline) > 0.05 for a, b in combinations(holes, 2))
        x0, y0, x1, y1 = simulated.scene.ground.core
        assert all(shapely.box(x0, y0, x1, y1).contains(hole.outline) for hole in holes)
        number = {"plain": 0, "slope": 0, "approach": 3}.get(name, 4)
        assert len(simulated.labels) == len(holes) == number


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", SCENES)
def test_a_robot_stands_clear_of_holes_and_things(name, robot):
    for simulated in scenes(name, robot, 17):
        taken = holes_of(simulated) | in_the_way(simulated)
        assert simulated.scene.stops.shape == (17, 3)
        for place in simulated.scene.stops:
            assert not footprint(place, robot).intersects(taken)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", SCENES)
def test_the_way_from_stop_to_stop_crosses_no_hole_and_nothing_that_stands(name, robot):
    for simulated in scenes(name, robot, 17):
        taken = holes_of(simulated) | in_the_way(simulated)
        for here, there in pairwise(simulated.scene.stops[:, :2]):
            assert not shapely.LineString([here, there]).intersects(taken)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", SCENES)
def test_a_robot_drives_over_no_hole(name, robot):
    """Its whole outline, at every published pose of the default frames."""
    for simulated in scenes(name, robot, SCENES[name].frames)[:10]:
        taken = holes_of(simulated)
        last = simulated.drive.times[-1]
        for place in simulated.drive.at(np.arange(0.0, last, 0.25)):
            assert not footprint(place, robot).intersects(taken)


@pytest.mark.parametrize("name", ["street", "approach", "plain", "slope"])
def test_a_robot_turns_and_drives_where_it_looks(name):
    """Ahead or backwards along its own axis, no faster than 0.4 m/s and 0.5 rad/s; it stands at its stops."""
    for simulated in scenes(name, "lms151", 8)[:5]:
        drive, step = simulated.drive, 0.02
        places = drive.at(np.arange(0.0, drive.times[-1], step))
        moved = np.diff(places, axis=0)
        assert np.hypot(moved[:, 0], moved[:, 1]).max() <= 0.4 * step + 1e-9
        assert np.abs(moved[:, 2]).max() <= 0.5 * step + 1e-9
        c, s = np.cos(places[:-1, 2]), np.sin(places[:-1, 2])
        on_the_way = np.abs(moved[:, 2]) < 1e-9
        assert np.abs(c * moved[:, 1] - s * moved[:, 0])[on_the_way].max() < 1e-9
        turning = ~on_the_way
        # At most one step of the samples is partly a turn and partly a drive, at either end.
        assert (np.hypot(moved[:, 0], moved[:, 1])[turning] > 1e-9).sum() <= 2 * len(simulated.scene.stops)
        for stop, stamp in zip(simulated.scene.stops, drive.stamps, strict=True):
            seconds = (stamp - 1_700_000_000 * 10**9) / 1e9
            before = drive.at(np.linspace(seconds - FACTS["lms151"].period, seconds, 9))
            off = before - stop
            off[:, 2] = np.angle(np.exp(1j * off[:, 2]))  # it turns the short way, past pi if need be
            assert np.abs(off).max() < 1e-9
        turns = np.diff(drive.places[:, 2])
        assert np.abs(turns).max() <= np.pi + 1e-9


def test_a_block_turns_to_the_left():
    """Its yaw is from x towards y, as everything's."""
    corners = shapely.get_coordinates(rectangle((3.0, 1.0), (2.0, 0.0), math.pi / 6))
    tips = sorted(corners.round(9).tolist())
    assert np.allclose(tips[-1], [3 + math.cos(math.pi / 6), 1 + math.sin(math.pi / 6)])
    assert np.allclose(tips[0], [3 - math.cos(math.pi / 6), 1 - math.sin(math.pi / 6)])


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", ["tunnel", "barrel"])
def test_no_straight_way_leads_out(name, robot):
    """A robot that turns on the spot and drives two and a half lengths runs into a hole or a thing."""
    for simulated in scenes(name, robot, 2):
        taken = holes_of(simulated) | in_the_way(simulated)
        for x, y, _ in simulated.scene.stops:
            for yaw in np.radians(np.arange(0, 360, 5)):
                assert footprint((x, y, yaw), robot, 2.5 * FACTS[robot].length).intersects(taken)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", SCENES)
def test_things_stand_beside_holes(name, robot):
    for simulated in scenes(name, robot):
        low = [solid for solid in simulated.scene.solids if solid.bottom < 0.2]
        for solid in low:
            assert solid.outline.is_valid
            assert solid.outline.distance(holes_of(simulated)) > 0.05


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_tunnel_has_a_wreck_and_eight_lumps_apart(robot):
    for simulated in scenes("tunnel", robot):
        solids = simulated.scene.solids
        lumps = [solid for solid in solids if solid.top <= 0.3]
        others = shapely.union_all([s.outline for s in solids if s.top > 0.3 and s.bottom < HEIGHT])
        assert len(lumps) == 8
        for one, other in combinations(lumps, 2):
            assert one.outline.distance(other.outline) > 0.05
        for lump in lumps:
            assert lump.bottom < -0.05
            assert lump.outline.distance(others | holes_of(simulated)) > 0.05
        wreck = [solid for solid in solids if solid.bottom == 0.25]
        assert len(wreck) == 1
        assert wreck[0].outline.area > 5


def test_the_barrel_stands_before_the_laser_and_beside_the_way_over():
    for simulated in scenes("barrel", "lms151"):
        (drum,) = [s for s in simulated.scene.solids if s.outline.area < 1 and s.top < 1]
        (front,) = [hole for hole in simulated.scene.holes if hole.id == "front"]
        x, y = drum.outline.centroid.coords[0]
        assert 1.5 < x < 2.3
        assert 0.3 < y < 0.9
        assert front.outline.distance(drum.outline) > 0.2


@pytest.mark.parametrize("robot", ROBOTS)
def test_people_pass_before_c_and_d_alone(robot):
    """Two, in front of the robot and near, on firm ground, in nobody's way but the laser's."""
    for simulated in scenes("street", robot, 16):
        scene = simulated.scene
        taken = holes_of(simulated) | in_the_way(simulated)
        for stop, place in enumerate(scene.stops):
            people = scene.passing_at(stop)
            assert len(people) == (2 if stop in (2, 3, 11, 12) else 0)  # a ... h, and back again
            for person in people:
                assert (person.bottom, person.top) == (0.0, 1.75)
                away = np.array(person.outline.centroid.coords[0]) - place[:2]
                assert 1.0 < math.hypot(*away) < 2.5
                assert abs(math.remainder(math.atan2(away[1], away[0]) - place[2], 2 * math.pi)) < 0.6
                assert not person.outline.intersects(footprint(place, robot))
                assert not person.outline.intersects(taken)
            assert not any(a.outline.intersects(b.outline) for a, b in combinations(people, 2))


LAY_OUT = """
from gapeval.simulate.simulation import simulation
for name in ("tunnel", "street"):
    for sensor in ("lms151", "vlp16"):
        for seed in range(400):
            simulation(name, sensor, 17, seed)
"""


def test_every_seed_can_be_laid_out():
    """Nobody looks for ever for room that there is not."""
    done = subprocess.run([sys.executable, "-c", LAY_OUT], timeout=45)
    assert done.returncode == 0


def test_only_the_street_has_people():
    for name in set(SCENES) - {"street"}:
        assert not any(simulation(name, "lms151", 8, 0).scene.passing)


@pytest.mark.parametrize("name", SCENES)
def test_seeds_differ_and_are_repeated(name):
    def outline(seed):
        scene = simulation(name, "lms151", 4, seed).scene
        rings = [shapely.get_coordinates(hole.outline).ravel() for hole in scene.holes]
        rest = [shapely.get_coordinates(solid.outline).ravel() for solid in scene.solids]
        return np.concatenate([*rings, *rest, scene.stops.ravel(), scene.ground.waves.ravel()]).tobytes()

    assert outline(3) == outline(3)
    assert len({outline(seed) for seed in SEEDS}) == len(SEEDS)
    if SCENES[name].build(np.random.default_rng(0), simulation(name, "lms151", 1, 0).sensor, 1).holes:
        holes = {simulation(name, "lms151", 4, seed).scene.holes[0].outline.wkb for seed in SEEDS}
        assert len(holes) == len(SEEDS)


def test_the_ground_is_rough_by_a_centimetre():
    for name in SCENES:
        ground = simulation(name, "lms151", 4, 5).scene.ground
        x, y = np.meshgrid(np.arange(-4, 8, 0.07), np.arange(-4, 4, 0.07))
        rough = ground.height(np.stack([x, y], axis=-1)) - np.interp(x, *ground.profile.T)
        assert 0.007 < rough.std() < 0.013
        assert abs(rough.mean()) < 0.004
        assert np.abs(rough).max() < 0.05
        lengths = 2 * np.pi / np.hypot(ground.waves[:, 0], ground.waves[:, 1])
        assert 0.5 <= lengths.min() < 0.8
        assert 2.0 < lengths.max() <= 3.0


def test_unknown_names_name_the_known():
    for scene, sensor, listed in (("canyon", "lms151", SCENES), ("plain", "radar", FACTS)):
        with pytest.raises(ConfigError) as caught:
            simulation(scene, sensor, 1, 0)
        assert all(name in str(caught.value) for name in listed)


# Labels


def widths_at(ring, yaw):
    """How wide a shape is along directions (N,)."""
    return np.ptp(ring @ [np.cos(yaw), np.sin(yaw)], axis=0)


def least_width(outline):
    """Width, direction, middle and length of the narrowest box, by trying thousands of angles."""
    ring = shapely.get_coordinates(outline.exterior)
    angles = np.linspace(-math.pi / 2, math.pi / 2, 3600, endpoint=False)
    for step in (math.pi / 3600, 1e-6):
        best = angles[np.argmin(widths_at(ring, angles))]
        angles = np.linspace(best - step, best + step, 2001)
    v = np.array([math.cos(best), math.sin(best)])
    u = np.array([-v[1], v[0]])
    middle = sum((np.max(ring @ w) + np.min(ring @ w)) / 2 * w for w in (u, v))
    width, long = widths_at(ring, np.array([best, best + math.pi / 2]))
    return width, best, middle, long


def brute_crossing(simulated, hole):
    """The paper's rules, by discs: no longer than half the robot, and free ground at both ends."""
    facts = FACTS[str(simulated.about["sensor"])]
    length, yaw, middle, _ = least_width(hole.outline)
    if length > facts.length / 2:
        return False
    v = np.array([math.cos(yaw), math.sin(yaw)])
    taken = [other.outline for other in simulated.scene.holes if other is not hole]
    taken += [s.outline for s in simulated.scene.solids if s.bottom < 1.0]
    discs = [
        shapely.Point(middle + side * (length / 2 + facts.length / 2) * v).buffer(facts.width / 2, 64)
        for side in (-1, 1)
    ]
    return not any(disc.intersects(shape) for disc in discs for shape in [*taken, hole.outline])


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("name", ["tunnel", "barrel", "street", "approach"])
def test_labels_know_what_brute_force_finds(name, robot):
    """Length is the least width, crossing_yaw its direction, traversable what the rules say of the scene."""
    for simulated in scenes(name, robot, 2)[:8]:
        for label, hole in zip(simulated.labels, simulated.scene.holes, strict=True):
            length, yaw, _, long = least_width(hole.outline)
            assert abs(label.length - length) < 1e-6
            box = shapely.get_coordinates(shapely.minimum_rotated_rectangle(hole.outline))[:3]
            assert label.length <= min(math.dist(*box[:2]), math.dist(*box[1:])) + 1e-9
            if length / long > 0.9 + 1e-6:
                assert label.crossing_yaw is None
            elif length / long < 0.9 - 1e-6:
                assert abs(math.remainder(label.crossing_yaw - yaw, math.pi)) < 1e-4
            assert label.traversable is brute_crossing(simulated, hole)


@pytest.mark.parametrize("robot", ROBOTS)
def test_what_can_be_crossed_is_what_the_scene_is_about(robot):
    """Nothing in tunnel and street, the gap ahead before the barrel, the narrow trench on the approach."""
    for seed in range(40):
        for name in ("tunnel", "street"):
            assert not any(label.traversable for label in simulation(name, robot, 8, seed).labels)
        crossed = [label.id for label in simulation("barrel", robot, 8, seed).labels if label.traversable]
        assert crossed == ["front"]
        trenches = simulation("approach", robot, 8, seed).labels
        assert sorted(t.length < NARROW for t in trenches) == [False, False, True]
        assert [t.traversable for t in trenches] == [t.length < NARROW for t in trenches]


@pytest.mark.parametrize("sensor", FACTS)
def test_every_sensor_s_robot_can_cross_the_gap_before_the_barrel(sensor):
    for seed in SEEDS:
        labels = simulation("barrel", sensor, 1, seed).labels
        assert {label.id: label.traversable for label in labels} == {
            "front": True,
            "left": False,
            "right": False,
            "rear": False,
        }


def trench(width=0.3, x=2.0, y=0.0, half=1.0):
    return Hole("t", shapely.box(x, y - half, x + width, y + half), 0.5)


def crossing_of(hole, others=(), solids=()):
    level = Ground(np.zeros((1, 2)), np.zeros((0, 4)), (0.0, 0.0, 1.0, 1.0))
    scene = Scene(level, (hole, *others), tuple(solids), np.zeros((1, 3)))
    return can_be_crossed(scene, narrowest(hole.outline), simulation("plain", "lms151", 1, 0).sensor.robot)


def test_the_rules_of_crossing_at_their_limits():
    """d_r is 0.34, the ends are 0.34 before and behind, with 0.25 free around them."""
    assert crossing_of(trench(0.339))
    assert not crossing_of(trench(0.341))
    behind = 2.3 + 0.34 + 0.25
    assert crossing_of(trench(), [trench(x=behind + 0.001)])
    assert not crossing_of(trench(), [trench(x=behind - 0.001)])
    before = 2.0 - 0.34 - 0.25

    def box(x1, bottom):
        return Solid(shapely.box(x1 - 0.3, -0.2, x1, 0.2), bottom, 5.0)

    assert crossing_of(trench(), solids=[box(before - 0.001, 0.0)])
    assert not crossing_of(trench(), solids=[box(before + 0.001, 0.0)])
    assert crossing_of(trench(), solids=[box(before + 0.3, 2.0)]), "a roof is in nobody's way"


# The mesh


def area(triangles):
    """Of triangles seen from above."""
    (ax, ay), (bx, by) = (
        (triangles[:, 1] - triangles[:, 0])[:, :2].T,
        (triangles[:, 2] - triangles[:, 0])[:, :2].T,
    )
    return float(np.abs(ax * by - ay * bx).sum() / 2)


def flat_parts(triangles):
    """Those that are not upright."""
    (ax, ay), (bx, by) = (
        (triangles[:, 1] - triangles[:, 0])[:, :2].T,
        (triangles[:, 2] - triangles[:, 0])[:, :2].T,
    )
    return np.abs(ax * by - ay * bx) > 1e-13


@st.composite
def outlines(draw):
    """One to three holes: boxes on grid lines or off them, and stars of any corners."""
    found = []
    for index in range(draw(st.integers(1, 3))):
        x, y = -1.5 + 1.1 * index, draw(st.sampled_from([-0.5, 0.0, 0.13]))
        if draw(st.booleans()):
            digits = draw(st.sampled_from([1, 2]))
            w, h = (round(draw(st.floats(0.1, 0.9)), digits) for _ in "wh")
            found.append(
                shapely.box(round(x, 1), round(y, digits), round(x + w, digits), round(y + h, digits))
            )
        else:
            corners = draw(st.lists(st.floats(0.12, 0.5), min_size=5, max_size=12))
            angles = np.linspace(0, 2 * math.pi, len(corners), endpoint=False)
            star = np.column_stack([np.cos(angles), np.sin(angles)]) * np.array(corners)[:, None]
            found.append(shapely.Polygon(star + np.array([x + 0.5, y])))
    return found


@settings(max_examples=40, deadline=None)
@given(outlines(), st.integers(0, 10**6))
def test_the_ground_without_its_holes_is_whole(found, seed):
    """What is left and what is cut out make up all of it; rays down by the rim meet ground or floor."""
    random = np.random.default_rng(seed)
    ground = Ground(np.zeros((1, 2)), roughness(random, 0.01), (-2.0, -1.5, 2.5, 1.5))
    holes = tuple(Hole(str(i), outline, 0.3 + 0.1 * i) for i, outline in enumerate(found))
    triangles = ground_triangles(ground, holes)
    top = triangles[flat_parts(triangles) & (triangles[..., 2].min(axis=1) > -0.2)]
    whole = (4.5 + 300.0) * (3.0 + 300.0)
    removed = sum(outline.area for outline in found)
    assert abs(area(top) + removed - whole) < 1e-6
    floors = triangles[flat_parts(triangles) & (triangles[..., 2].max(axis=1) < -0.2)]
    assert abs(area(floors) - removed) < 1e-9
    scene = caster(triangles)
    for hole in holes:
        rim = hole.outline.exterior
        along = np.sort(random.uniform(0, rim.length, 60))
        places = shapely.get_coordinates(shapely.line_interpolate_point(rim, along))
        for away, inside in ((-1e-3, True), (1e-3, False)):
            ring = shapely.buffer(hole.outline, away, join_style="mitre")
            beside = shapely.get_coordinates(shapely.shortest_line(shapely.points(places), ring.boundary))[
                1::2
            ]
            assert (shapely.contains_xy(hole.outline, beside) == inside).all()
            for x, y in beside:
                hit = cast(scene, np.array([x, y, 2.0]), np.array([[0.0, 0.0, -1.0]]))
                z = 2.0 - hit.distance[0]
                if inside:
                    assert abs(z + hole.depth) < 1e-6
                else:
                    assert abs(z - ground.height(np.array([x, y]))) < 0.004


def test_walls_reach_from_rim_to_floor():
    """Level rays from within a hole meet its outline at any height between floor and rim."""
    random = np.random.default_rng(8)
    star = shapely.Polygon(
        [(0.1, 0.0), (0.9, -0.3), (1.7, 0.2), (1.3, 0.5), (1.5, 1.1), (0.6, 0.9), (0.2, 1.2)]
    )
    ground = Ground(np.zeros((1, 2)), roughness(random, 0.01), (-2.0, -1.5, 2.5, 1.5))
    scene = caster(ground_triangles(ground, (Hole("star", star, 0.7),)))
    angle = random.uniform(0, 2 * math.pi, 300)
    rays = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(300)])
    for z in (-0.699, -0.4, -0.05):
        origin = np.array([0.8, 0.4, z])
        hit = cast(scene, origin, rays)
        for ray, distance, grazing in zip(rays, hit.distance, hit.grazing, strict=True):
            far = shapely.LineString([origin[:2], origin[:2] + 5 * ray[:2]])
            meets = far.intersection(star.exterior)
            expected = shapely.Point(origin[:2]).distance(meets)
            assert abs(distance - expected) < 1e-6
            assert 0 < grazing <= 1 + 1e-12


def test_a_prism_is_closed_and_as_large_as_it_says():
    """Rays at it from all sides meet its sides, top and bottom."""
    outline = shapely.Polygon([(1.0, -0.5), (2.0, -0.4), (2.2, 0.5), (1.1, 0.3)])
    scene = caster(solid_triangles([Solid(outline, 0.3, 1.2)]))
    down = cast(scene, np.array([1.5, 0.0, 5.0]), np.array([[0.0, 0.0, -1.0]]))
    up = cast(scene, np.array([1.5, 0.0, -5.0]), np.array([[0.0, 0.0, 1.0]]))
    assert abs(down.distance[0] - 3.8) < 1e-9
    assert abs(up.distance[0] - 5.3) < 1e-9
    for z, inside in ((0.29, False), (0.31, True), (1.19, True), (1.21, False)):
        for angle in np.linspace(0, 2 * math.pi, 36, endpoint=False):
            away = np.array([math.cos(angle), math.sin(angle)])
            centre = np.array([1.5, 0.0])
            hit = cast(scene, np.array([*(centre + 4 * away), z]), np.array([[*-away, 0.0]]))
            assert np.isfinite(hit.distance[0]) == inside
            if inside:
                line = shapely.LineString([centre + 4 * away, centre])
                expected = shapely.Point(centre + 4 * away).distance(line.intersection(outline.exterior))
                assert abs(hit.distance[0] - expected) < 1e-6


# Casters


SLOW = """
import sys
sys.modules["embreex"] = None
import numpy as np
from gapeval.simulate.casting import cast, caster, has_embree
assert not has_embree()
given = np.load(sys.argv[1])
hits = cast(caster(given["triangles"]), given["origin"], given["rays"])
np.savez(sys.argv[2], distance=hits.distance, grazing=hits.grazing)
"""


def test_without_embree_rays_end_at_the_same_places(tmp_path):
    scene = simulation("barrel", "lms151", 1, 2).scene
    triangles = static_triangles(scene)
    near = triangles[np.abs(triangles[..., :2]).max(axis=(1, 2)) < 3.5]
    random = np.random.default_rng(6)
    rays = random.normal(size=(600, 3)) * [1, 1, 0.5]
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    origin = np.array([0.25, 0.01, 0.3])
    fast = cast(caster(near), origin, rays)
    np.savez(tmp_path / "given.npz", triangles=near, origin=origin, rays=rays)
    command = [sys.executable, "-c", SLOW, tmp_path / "given.npz", tmp_path / "slow.npz"]
    subprocess.run(command, check=True, timeout=300)
    slow = np.load(tmp_path / "slow.npz")
    assert 200 < np.isfinite(fast.distance).sum() < 600
    np.testing.assert_allclose(slow["distance"], fast.distance, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(slow["grazing"], fast.grazing, rtol=1e-9, atol=1e-9)


def test_without_trimesh_one_line_names_the_extra(tmp_path):
    hide = "import sys; sys.modules['trimesh'] = None; from gapeval.cli import main; main(sys.argv[1:])"
    command = [sys.executable, "-c", hide, "simulate", "plain", "--frames", "1", "-o", tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "gapeval[simulate]" in done.stderr
    assert not (tmp_path / "out").exists()
