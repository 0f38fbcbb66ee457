"""What is hidden from wherever a cloud was seen from: of cells by detection, of polygons by scoring."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from test_detection_scenes import covered, ground, wall

from gapeval import detect
from gapeval.config import BlindBelow, Configuration, Detector, Domain, FieldOfView, Robot, Scoring, Sensor
from gapeval.detection.grid import cell_polygons, polar_grid
from gapeval.detection.viewpoints import Standing
from gapeval.frame import Frame, Transform, Viewpoint, robot_plane
from gapeval.scoring.scene import seen_together, view
from gapeval.visibility import domain, shadow

RANDOM = settings(max_examples=150, deadline=None, derandomize=True)
LASER = (0.2, 0.0, 0.5)
LEVEL = [0, 0, 0, 1]
PIT = (2.0, -0.3, 2.6, 0.3)
WALL = wall(1.5, -0.5, 0.5)
TRENCH = ground(PIT)


def seen_from(x, y, height=0.5, lowest=-1.4):
    return Viewpoint(Transform.of([x, y, height], LEVEL), lowest)


def found(*others, points=(TRENCH, WALL), lowest=-1.4, sensor=None):
    """What is detected where no ground was seen from anywhere behind the wall."""
    cloud = np.vstack(points).astype(np.float32)
    x, y, z = cloud.T
    cloud = cloud[~((x > 1.55) & (np.abs(y) < 0.4 * x) & (z < 0.01))]
    frame = Frame(0, cloud, Transform.of(LASER, LEVEL), lowest, others=others)
    return detect(frame, Configuration(detector=Detector(k=6, r_max=4.0), sensor=sensor or Sensor()))


# --- cells -------------------------------------------------------------------------------------------


def test_behind_a_wall_is_no_gap_unless_another_viewpoint_looks_there():
    assert covered(found(), *PIT) == 0
    assert covered(found(seen_from(0.0, 0.0)), *PIT) == 0  # the wall is in its way too
    assert covered(found(seen_from(2.3, -2.0)), *PIT) > 0.9  # from the right, along the wall
    assert covered(found(seen_from(0.0, 0.0), seen_from(2.3, -2.0)), *PIT) > 0.9


def test_the_wall_itself_stays_an_obstacle():
    surface = found(seen_from(2.3, -2.0)).surface
    assert surface.obstacle.any()
    assert (surface.shaded | ~surface.obstacle).all()
    assert np.array_equal(surface.obstacle, found().surface.obstacle)


def test_what_stands_behind_the_robot_hides_from_a_viewpoint_farther_back():
    """Also where the grid has no cells in front, and beyond r_max."""
    behind, before, barred = seen_from(-6.0, 0.0, lowest=-1.0), wall(-7.0, -1, 1), wall(-4.5, -1, 1)
    assert covered(found(behind, points=(TRENCH, barred)), *PIT) > 0.9  # the sensor sees it by itself
    for obstacle, share in (((), 1), ((before,), 1), ((barred,), 0)):
        # The sensor does not look at the pit at all: the viewpoint behind it decides.
        surface = found(behind, points=(TRENCH, *obstacle), lowest=-0.1)
        assert covered(surface, *PIT) == pytest.approx(share, abs=0.1)


def test_looking_there_from_under_the_ground_is_no_looking():
    assert covered(found(seen_from(2.3, -2.0, height=-0.1)), *PIT) == 0


def test_a_place_in_one_blind_zone_and_another_shadow_is_not_seen():
    """No viewpoint sees it, though each only for its own reason."""
    blind = {"lowest": -0.1}
    assert covered(found(seen_from(2.3, -2.0), **blind), *PIT) > 0.9
    assert covered(found(seen_from(0.0, 0.0), **blind), *PIT) == 0
    assert covered(found(seen_from(2.3, -2.0, lowest=-0.05), **blind), *PIT) == 0


def test_settings_of_the_sensor_hold_for_every_viewpoint():
    beside = seen_from(2.3, -2.0)
    assert covered(found(beside, sensor=Sensor(fov=FieldOfView(azimuth=(-0.5, 0.5)))), *PIT) == 0
    assert covered(found(beside, sensor=Sensor(fov=FieldOfView(azimuth=(1.0, 2.0)))), *PIT) > 0.9
    assert covered(found(beside, sensor=Sensor(blind_zone=BlindBelow(below=-0.1))), *PIT) == 0


def between(low, high):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


@RANDOM
@given(
    st.tuples(st.integers(3, 14), st.integers(2, 14), st.sampled_from([1.05, 1.3, 2.0])),
    st.lists(st.tuples(st.integers(0, 40), st.integers(0, 60)), min_size=1, max_size=4),
    st.tuples(between(-4, 4), between(-4, 4)),
    st.integers(0, 2**32 - 1),
    st.sampled_from([8, 90, 720]),
)
def test_before_is_what_bins_and_distances_say(size, standing, origin, seed, count):
    """Against polygons: a bin is a wedge, a cell is before what lies in a wedge that it reaches into."""
    height, width, delta_r = size
    grid = polar_grid(height, width, delta_r, 3.0, (0.3, -0.2))
    obstacle = np.zeros((grid.rows, 2 * width), dtype=np.bool_)
    for row, column in standing:
        obstacle[row % grid.rows, column % (2 * width)] = True
    cells = Standing.of(grid, obstacle)
    quads = shapely.polygons(cells.corners)
    view, step = shapely.Point(origin), 2 * math.pi / count
    away = shapely.distance(shapely.boundary(quads), view)
    assume(away.min() > 1e-6)
    rng = np.random.default_rng(seed)
    # Some anywhere, some just before and behind the nearest points of cells.
    edges = shapely.get_coordinates(shapely.shortest_line(view, shapely.boundary(quads)))[1::2]
    ends = np.repeat(edges, 4, axis=0) - origin
    places = origin + np.vstack(
        [rng.uniform(-5, 5, (20, 2)), ends * rng.choice([0.99, 1.01], (len(ends), 1))]
    )
    place = np.floor(np.arctan2(*(places - origin).T[::-1]) / step)
    sides = [place * step, (place + 1) * step]
    wedges = [np.column_stack([origin[0] + 99 * np.cos(a), origin[1] + 99 * np.sin(a)]) for a in sides]
    apex = np.tile(origin, (len(places), 1))
    wedges = shapely.polygons(np.stack([apex, *wedges], axis=1))
    common = shapely.area(shapely.intersection(wedges[:, None], quads))
    touching = shapely.dwithin(wedges[:, None], quads, 1e-9) & (common < 1e-9)
    expected = (
        (common > 1e-9)
        & ~shapely.contains(quads, view)
        & (np.hypot(*(places - origin).T)[:, None] >= shapely.distance(quads, view))
    ).any(axis=1)
    sure = ~touching.any(axis=1)
    assert np.array_equal(cells.before(places, np.array(origin), count)[sure], expected[sure])


def test_a_cell_whose_corner_is_the_viewpoint_hides_what_is_behind_it():
    """Two lasers one above the other: the cells at the pole begin where they are."""
    grid = polar_grid(9, 9, 1.1, 3.0, (0.2, 0.1))
    obstacle = np.zeros((grid.rows, 18), dtype=np.bool_)
    obstacle[0, 6] = True  # from 30 to 50 degrees to the left
    origin = np.array(grid.origin)
    angles = np.radians([31, 40, 49, 27, 53, 0, 220])
    places = origin + 2 * np.column_stack([np.cos(angles), np.sin(angles)])
    before = Standing.of(grid, obstacle).before(places, origin, 720)
    assert before.tolist() == [True] * 3 + [False] * 4


def test_without_obstacles_nothing_is_before_anything():
    grid = polar_grid(9, 9, 1.1, 3.0, (0.0, 0.0))
    none = Standing.of(grid, np.zeros((grid.rows, 18), dtype=np.bool_))
    assert not none.before(np.ones((3, 2)), np.zeros(2), 720).any()
    assert none.before(np.empty((0, 2)), np.zeros(2), 720).shape == (0,)


def test_corners_are_those_of_the_cells_in_front():
    grid = polar_grid(9, 7, 1.3, 3.0, (0.4, 0.1))
    obstacle = np.zeros((grid.rows, 14), dtype=np.bool_)
    obstacle[:, :7] = True
    row, column = np.nonzero(obstacle)
    found = shapely.polygons(Standing.of(grid, obstacle).corners)
    expected = cell_polygons(grid, row, column)
    assert shapely.area(shapely.symmetric_difference(found, expected)).max() < 1e-12


# --- polygons ----------------------------------------------------------------------------------------

BOX = Domain(x_min=0.5, r_max=5)


PLACES = st.tuples(between(-3, 3), between(-3, 3), between(0.3, 1.0), between(-1.4, -0.2))


def scene_view(*others, points=WALL, lowest=-1.2, sensor=None, **rules):
    frame = Frame(0, points.astype(np.float32), Transform.of(LASER, LEVEL), lowest, others=others)
    return view(frame, BOX, "sensor", Configuration(sensor=sensor or Sensor()), Scoring(**rules))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(between(-3, 3), between(-3, 3), between(0.3, 1.0), between(-1.4, -0.2)), max_size=3)
)
def test_a_place_is_seen_if_one_viewpoint_looks_there_with_nothing_before_it(others):
    views = [seen_from(*other) for other in others]
    together = scene_view(*views)
    plane, points = robot_plane(0.0), WALL.astype(np.float32)
    each = []
    for one in [Viewpoint(Transform.of(LASER, LEVEL), -1.2), *views]:
        looked = domain(0.5, 5, LASER[:2], plane, one.mount, one.lowest_elevation, None)
        reach = 5 + math.dist(one.mount.translation[:2], LASER[:2])
        each.append((looked, shadow(points, plane, one.mount, 0.2, 2.0, reach)))
    x, y = np.random.default_rng(0).uniform((0.5, -5), (5, 5), (400, 2)).T
    outlines = [shapely.boundary(part) for pair in each for part in pair]
    sure = shapely.distance(shapely.union_all(outlines), shapely.points(x, y)) > 1e-6
    inside = np.array([[shapely.contains_xy(part, x, y) for part in pair] for pair in each])
    seen = (inside[:, 0] & ~inside[:, 1]).any(axis=0)
    assert np.array_equal(shapely.contains_xy(together.visible, x, y)[sure], seen[sure])
    assert np.array_equal(shapely.contains_xy(together.domain, x, y)[sure], inside[:, 0].any(axis=0)[sure])
    assert together.origin == LASER[:2]


def test_a_shadow_is_what_no_viewpoint_sees():
    alone, again, beside = scene_view(), scene_view(seen_from(*LASER)), scene_view(seen_from(2.3, -2.0))
    assert alone.shadow.contains(shapely.Point(2.3, 0))
    assert again.visible.symmetric_difference(alone.visible).area < 1e-6
    assert not beside.shadow.contains(shapely.Point(2.3, 0))
    assert beside.shadow.area < alone.shadow.area


def test_detection_and_scoring_mean_the_same_by_looked_at():
    far = scene_view(seen_from(0.0, 0.0, height=-0.2), seen_from(1.0, 1.0, height=-3.0))
    assert far.visible.equals(scene_view().visible)  # from below nothing is seen
    below = scene_view(seen_from(2.3, -2.0, lowest=-1.5), sensor=Sensor(blind_zone=BlindBelow(below=-0.05)))
    assert below.domain.area < 1e-9
    both = scene_view(seen_from(2.3, -2.0), sensor=Sensor(fov=FieldOfView(azimuth=(1.0, 2.0))))
    assert both.domain.contains(shapely.Point(2.3, 0))
    assert not both.domain.contains(shapely.Point(3.0, -2.0))


def test_one_viewpoint_together_is_itself():
    alone = scene_view()
    looked, hidden = seen_together([(alone.domain, alone.shadow)])
    assert looked.symmetric_difference(alone.domain).area < 1e-9
    assert hidden.symmetric_difference(alone.shadow.intersection(alone.domain)).area < 1e-9


# --- gravity -----------------------------------------------------------------------------------------


def turn(roll, pitch):
    """Quaternion of a robot that leans: fixed<-robot."""
    (sr, sp), (cr, cp) = np.sin([roll / 2, pitch / 2]), np.cos([roll / 2, pitch / 2])
    return [sr * cp, cr * sp, -sr * sp, cr * cp]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(between(-0.4, 0.4), between(-0.4, 0.4))
def test_a_leaning_robot_finds_on_a_level_plane_what_a_level_one_finds(roll, pitch):
    hole = (1.2, -0.4, 2.0, 0.4)
    level = np.vstack([ground(hole), wall(2.6, 0.6, 1.4)])
    pose = Transform.of([0, 0, 0], turn(roll, pitch))  # the ground's height is that of the robot's origin
    params = {"k": 6, "r_max": 3.0, "delta_r": 1.05, "z_max": 5.0}
    mount = Transform.of(pose.apply_inverse(np.array(LASER)), LEVEL)
    leaning = Frame(0, pose.apply_inverse(level).astype(np.float32), mount, up=up_of(pose))
    found = detect(leaning, Configuration(detector=Detector(plane="gravity", **params)))
    assert found.fallback == ""
    upright = Frame(0, level.astype(np.float32), Transform.of(LASER, LEVEL))
    usual = shapely.union_all(detect(upright, Configuration(detector=Detector(**params))).gaps.polygons)

    def fixed(places):
        on_plane = np.column_stack([places, found.plane.height(places)])
        return pose.apply(on_plane)[:, :2]

    seen = shapely.transform(shapely.union_all(found.gaps.polygons), fixed)
    assert usual.intersection(shapely.box(*hole)).area > 0.5
    assert seen.symmetric_difference(usual).area < 0.35 * usual.area  # by the size of cells


def up_of(pose):
    """Against gravity, in the frame of a robot with this pose."""
    return tuple((pose.matrix.T @ [0, 0, 1]).tolist())


@RANDOM
@given(st.tuples(between(-1, 1), between(-1, 1), between(-1, 1)), between(-1, 1))
def test_gravity_is_level_through_the_ground_below_the_robot(direction, ground_z):
    length = math.hypot(*direction)
    assume(length > 0.1)
    up = tuple(value / length for value in direction)
    assume(abs(up[2] - 0.5) > 1e-9)
    frame = Frame(0, np.zeros((0, 3), np.float32), up=up)
    config = Configuration(detector=Detector(plane="gravity"), robot=Robot(ground_z=ground_z))
    made = detect(frame, config)
    if math.acos(up[2]) > math.radians(60):
        assert (made.plane, made.fallback) == (robot_plane(ground_z), "tilted too much")
        return
    assert made.fallback == ""
    assert (made.plane.a, made.plane.b, made.plane.c) == up
    assert made.plane.distance(np.array([0, 0, ground_z])) == pytest.approx(0, abs=1e-12)


def test_gravity_of_a_level_robot_is_its_own_plane_and_without_orientation_too():
    for up, fallback in (((0.0, 0.0, 1.0), ""), (None, "no orientation")):
        frame = Frame(0, TRENCH.astype(np.float32), up=up)
        config = Configuration(detector=Detector(plane="gravity"), robot=Robot(ground_z=-0.07))
        made = detect(frame, config)
        assert (made.plane, made.fallback) == (robot_plane(-0.07), fallback)
        usual = detect(frame, Configuration(robot=Robot(ground_z=-0.07)))
        assert made.gaps.image == usual.gaps.image


def test_labels_and_shadows_follow_gravity():
    """Else a robot that leans forward would take the ground ahead for an obstacle."""
    pose = Transform.of([0, 0, 0], turn(0.0, 0.2))
    points = pose.apply_inverse(TRENCH).astype(np.float32)
    up = up_of(pose)
    frame = Frame(0, points, Transform.of(pose.apply_inverse(np.array(LASER)), LEVEL), up=up)
    usual = view(frame, BOX, "sensor", Configuration(), Scoring())
    level = view(frame, BOX, "sensor", Configuration(), Scoring(), "gravity")
    assert usual.shadow.area > 5
    assert level.shadow.area == 0
    assert (level.plane.a, level.plane.b, level.plane.c) == up
    nothing = view(replace(frame, up=None), BOX, "sensor", Configuration(), Scoring(), "gravity")
    assert nothing.plane == robot_plane(0.0)
