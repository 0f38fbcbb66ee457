"""What the detector says of scenes whose answer is known: edges of the box, blind zones, shadows, boxes."""

import math

import numpy as np
import pytest
import shapely
from pydantic import ValidationError

from gapeval import assess, detect
from gapeval.config import BlindBelow, BodyBox, Configuration, Detector, FieldOfView, Robot, Sensor
from gapeval.frame import Frame, Transform

LASER = (0.2, 0.0, 0.5)


def ground(*holes, step=0.02, reach=5.0):
    """A square grid of points on z = 0 all around, without those in the holes (x0, y0, x1, y1)."""
    axis = np.arange(-reach, reach, step) + step / 3
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    kept = np.ones(len(x), dtype=bool)
    for x0, y0, x1, y1 in holes:
        kept &= ~((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))
    return np.column_stack([x, y, np.zeros_like(x)])[kept]


def wall(x, y0, y1, z0=0.02, z1=0.9):
    """Points of a wall across the way, dense enough that no column misses it."""
    y, z = (a.ravel() for a in np.meshgrid(np.arange(y0, y1, 0.01), np.arange(z0, z1, 0.04)))
    return np.column_stack([np.full_like(y, x), y, z])


def detection_in(*points, laser=LASER, rotation=(0, 0, 0, 1), sensor=None, robot=None, lowest=-1.4, **params):
    """Detect in stacked points, with defaults that blank nothing of interest."""
    stacked = np.vstack([np.empty((0, 3)), *points]).astype(np.float32)
    frame = Frame(0, stacked, Transform.of(laser, rotation), lowest_elevation=lowest)
    configuration = Configuration(
        detector=Detector(**params), sensor=sensor or Sensor(), robot=robot or Robot()
    )
    return detect(frame, configuration)


def covered(detection, x0, y0, x1, y1):
    """Share of a rectangle's area that the gaps cover."""
    area = shapely.box(x0, y0, x1, y1)
    return shapely.union_all(detection.gaps.polygons).intersection(area).area / area.area


def gap_area(detection):
    return float(shapely.area(detection.gaps.polygons).sum())


HOLE = (1.2, -0.4, 1.8, 0.4)


def test_whole_ground_has_no_gap():
    assert gap_area(detection_in(ground())) == 0


def test_a_hole_is_one_gap_where_it_is():
    found = detection_in(ground(HOLE))
    assert len(found.gaps) == 1
    assert covered(found, *HOLE) > 0.65
    assert gap_area(found) - covered(found, *HOLE) * 0.48 < 0.1  # little beside it


def test_nothing_seen_is_all_one_gap_without_a_blind_zone():
    """Algorithm 1 as printed: the image starts full of ones."""
    found = detection_in(sensor=Sensor(blind_zone="none"), x_min=0.0, laser=(0, 0, 0.5))
    assert len(found.gaps) == 1
    assert gap_area(found) == pytest.approx(math.pi * 9 / 2, rel=1e-3)


@pytest.mark.parametrize("count", [0, 1])
def test_no_points_are_no_trouble(count):
    found = detection_in(np.zeros((count, 3)))
    assert len(found.gaps) == 1
    assert len(assess(found)) == 2


def test_defaults_need_no_configuration():
    frame = Frame(5, ground(HOLE).astype(np.float32), Transform.of(LASER, (0, 0, 0, 1)))
    assert detect(frame).stamp == 5
    assert len(detect(frame).gaps) == 1


# --- edges of the box -----------------------------------------------------------------------------------


def test_a_trench_cut_by_r_max_is_kept_with_data_and_lost_with_zero():
    """DESIGN.md, decision 6: 1.2 m wide, beginning at 2.3 m of R = 3 (both from the grid's pole)."""
    x0 = LASER[0] + 2.3
    seen = (x0, -1.0, LASER[0] + 2.7, 1.0)  # well inside R also at y = 1
    points = ground((x0, -3.0, x0 + 1.2, 3.0))
    assert covered(detection_in(points, edge="data"), *seen) > 0.6
    assert covered(detection_in(points, edge="zero"), *seen) < 0.05


def test_a_gap_cut_by_x_min_is_kept_with_data():
    points = ground((0.4, -0.5, 0.85, 0.5))
    parts = [gap_area(detection_in(points, edge=edge, x_min=0.75)) for edge in ("data", "zero")]
    assert parts[0] > 0.04
    assert parts[1] < parts[0] / 4


def test_a_gap_cut_by_the_half_plane_is_kept_with_data():
    """x_min = 0 and the grid's pole at the robot: the image ends at +-90 degrees, the gap does not."""
    points = ground((-0.5, 1.0, 0.12, 1.8))
    beside = {"laser": (0.0, 0.0, 0.5), "x_min": 0.0, "k": 6}
    assert covered(detection_in(points, edge="data", **beside), 0.0, 1.1, 0.1, 1.7) > 0.5
    assert covered(detection_in(points, edge="zero", **beside), 0.0, 1.1, 0.1, 1.7) == 0


def test_a_gap_wholly_outside_the_box_is_none():
    far = LASER[0] + 3.3
    assert gap_area(detection_in(ground((far, -1.0, far + 1.0, 1.0)))) == 0
    assert gap_area(detection_in(ground((0.25, -0.2, 0.5, 0.2)), x_min=0.75)) == 0


def test_without_erosion_edges_do_not_matter():
    points = ground(HOLE, (2.6, -1.0, 4.0, 1.0))
    ones = [detection_in(points, edge=edge, n_o=0).surface.gap for edge in ("data", "zero")]
    assert ones[0] == ones[1]


def test_x_min_is_the_robots_and_r_max_the_grids():
    """Decision 2: the box begins at x_min of the robot frame and ends r_max from the laser's foot."""
    found = detection_in(sensor=Sensor(blind_zone="none"), x_min=0.9, r_max=2.0)
    x0, _, x1, _ = shapely.total_bounds(found.gaps.polygons)
    assert x1 == pytest.approx(LASER[0] + 2.0, abs=1e-2)
    assert x0 == pytest.approx(0.9, abs=0.1)
    as_printed = detection_in(sensor=Sensor(blind_zone="none"), x_min=0.9, r_max=2.0, origin="robot")
    assert shapely.total_bounds(as_printed.gaps.polygons)[2] == pytest.approx(2.0, abs=1e-2)


# --- what was never looked at ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sensor", "lowest"),
    [(Sensor(), -0.4), (Sensor(blind_zone=BlindBelow(below=-0.4)), -1.0)],
    ids=["auto", "below"],
)
def test_the_blind_zone_is_no_gap(sensor, lowest):
    """A ray 0.4 rad down from 0.5 m meets the ground after 1.18 m; nearer, nothing was looked at."""
    blind = 0.5 / math.tan(0.4)
    found = detection_in(sensor=sensor, lowest=lowest, x_min=0.3)
    nearest = shapely.distance(shapely.Point(LASER[:2]), shapely.union_all(found.gaps.polygons))
    assert nearest == pytest.approx(blind, abs=0.15)
    assert gap_area(found) > 5
    everything = detection_in(sensor=Sensor(blind_zone="none"), lowest=lowest, x_min=0.3)
    assert gap_area(everything) > gap_area(found) + 1


def test_the_blind_zone_leans_with_the_sensor():
    """Pitched forward by 0.3 rad, the sensor sees ground ahead that is nearer."""
    half = 0.15
    pitched = detection_in(lowest=-0.4, x_min=0.3, rotation=(0, math.sin(half), 0, math.cos(half)))
    nearest = shapely.distance(shapely.Point(LASER[:2]), shapely.union_all(pitched.gaps.polygons))
    assert nearest == pytest.approx(0.5 / math.tan(0.7), abs=0.1)


def test_a_gap_may_be_seen_over_the_rim_of_the_blind_zone():
    """`edge: data` opens before it masks: ground that was not looked at does not eat a gap beside it."""
    blind = LASER[0] + 0.5 / math.tan(0.5)
    points = ground((0.3, -0.4, blind + 0.2, 0.4))
    parts = [gap_area(detection_in(points, lowest=-0.5, edge=edge)) for edge in ("data", "zero")]
    assert parts[0] > 0.1
    assert parts[1] < parts[0] / 2


def test_outside_the_field_of_view_is_no_gap():
    fov = FieldOfView(azimuth=(-0.5, 0.2))
    found = detection_in(sensor=Sensor(fov=fov), x_min=0.3)
    outline = shapely.get_coordinates(found.gaps.polygons) - np.array(LASER[:2])
    azimuth = np.arctan2(outline[:, 1], outline[:, 0])
    assert azimuth.min() == pytest.approx(-0.5, abs=math.pi / 65)
    assert azimuth.max() == pytest.approx(0.2, abs=math.pi / 65)


@pytest.mark.parametrize(("elevation", "near", "far"), [((-0.3, 0.0), 1.6, 3.0), ((-1.0, -0.3), 0.3, 1.6)])
def test_elevations_of_the_field_of_view_are_rings_on_the_ground(elevation, near, far):
    found = detection_in(sensor=Sensor(fov=FieldOfView(elevation=elevation)), x_min=0.0, n_o=0)
    outline = shapely.get_coordinates(found.gaps.polygons) - np.array(LASER[:2])
    r = np.hypot(*outline.T)
    assert r.min() == pytest.approx(near, abs=0.15)
    assert r.max() == pytest.approx(far, abs=0.15)


# --- marks ----------------------------------------------------------------------------------------------


def marks(z, **params):
    """(ground, obstacle) of the cell of one point ahead, at this height."""
    found = detection_in(np.array([[1.5, 0.01, z]]), **params)
    return bool(found.surface.ground.any()), bool(found.surface.obstacle.any())


def test_the_threshold_itself_is_ground():
    """|t| <= pl_th is on the plane, t > pl_th above it; 0.125 is exact in float32."""
    assert marks(0.125, pl_th=0.125) == (True, False)
    assert marks(-0.125, pl_th=0.125) == (True, False)
    assert marks(np.nextafter(np.float32(0.125), np.float32(1)), pl_th=0.125) == (False, True)
    assert marks(np.nextafter(np.float32(-0.125), np.float32(-1)), pl_th=0.125) == (False, False)


def test_heights_are_above_the_robots_ground():
    assert marks(-0.5, robot=Robot(ground_z=-0.5)) == (True, False)
    assert marks(0.0, robot=Robot(ground_z=-0.5)) == (False, True)
    assert marks(0.0, robot=Robot(ground_z=0.5)) == (False, False)


def test_the_box_in_z_counts_from_the_robot_frame():
    """And both limits belong to it."""
    robot = Robot(ground_z=-0.5)
    assert marks(0.25, robot=robot, z_max=0.25) == (False, True)
    assert marks(0.26, robot=robot, z_max=0.25) == (False, False)
    assert marks(-0.5, robot=robot, z_min=0.5) == (True, False)
    assert marks(-0.5, robot=robot, z_min=0.49) == (False, False)


def test_points_under_the_plane_mark_nothing():
    """The floor of a hole does not fill it, nor throw a shadow."""
    floor = ground() - [0, 0, 0.6]
    x0, y0, x1, y1 = HOLE
    inside = (floor[:, 0] > x0) & (floor[:, 0] < x1) & (floor[:, 1] > y0) & (floor[:, 1] < y1)
    empty, filled = detection_in(ground(HOLE)), detection_in(ground(HOLE), floor[inside])
    assert filled.surface.gap == empty.surface.gap
    assert not filled.surface.shaded.any()


def test_what_an_obstacle_hides_is_no_gap():
    blocked = detection_in(ground(HOLE), wall(1.0, -0.6, 0.6))
    assert gap_area(blocked) == 0
    assert gap_area(detection_in(ground(HOLE), wall(1.0, 0.7, 1.2))) > 0.3  # beside it
    assert gap_area(detection_in(ground(HOLE), wall(2.2, -0.6, 0.6))) > 0.3  # behind it


def test_a_shadow_is_as_wide_as_its_obstacle():
    found = detection_in(ground(HOLE), wall(0.95, 0.0, 0.5), n_o=0)
    assert covered(found, 1.2, 0.05, 1.8, 0.4) == 0
    assert covered(found, 1.2, -0.4, 1.8, -0.15) > 0.7


def test_what_stands_nearer_than_x_min_shades_too():
    assert gap_area(detection_in(ground(HOLE), wall(0.5, -0.4, 0.4), x_min=0.7)) == 0


def test_what_hangs_above_z_max_neither_shades_nor_is_an_obstacle():
    beam = wall(1.0, -0.6, 0.6, z0=1.25, z1=1.5)
    free = detection_in(ground(HOLE), beam, z_max=1.2)
    assert free.surface.gap == detection_in(ground(HOLE)).surface.gap
    assert not free.surface.obstacle.any()
    assert gap_area(detection_in(ground(HOLE), beam, z_max=2.0)) == 0


def test_ground_behind_an_obstacle_stays_ground():
    surface = detection_in(ground(HOLE), wall(1.0, -0.6, 0.6)).surface
    hidden = surface.shaded & ~surface.ground
    assert hidden.any()
    assert (surface.shaded & surface.ground).any()
    assert np.array_equal(surface.unknown, ~surface.gap.cells & (~surface.seen.cells | hidden))


def test_points_of_the_body_are_dropped():
    """They neither shade nor count as ground; the faces of the box belong to the body."""
    robot = Robot(body=BodyBox(x=(-0.5, 0.75), y=(-0.25, 0.25), z=(0.015625, 1.0)))
    arm = wall(0.75, -0.24, 0.24, z0=0.015625)
    assert gap_area(detection_in(ground(HOLE), arm)) < 0.2
    free = detection_in(ground(HOLE), arm, robot=robot)
    assert free.surface.gap == detection_in(ground(HOLE)).surface.gap
    assert not free.surface.obstacle.any()
    low = Robot(body=BodyBox(x=(-0.5, 0.75), y=(-0.25, 0.25), z=(-0.1, 1.0)))
    under_the_arm = 40, 32  # 0.3 m before the laser
    assert detection_in(ground()).surface.ground[under_the_arm]
    assert not detection_in(ground(), robot=low).surface.ground[under_the_arm]


@pytest.mark.parametrize("left", [1, -1])
def test_columns_are_rays_of_the_laser(left):
    """Decision 2: two posts and no gap. Centred on the robot, the grid casts their shadows the wrong way."""
    laser = (0.4, 0.0, 0.5)
    posts = np.array([[0.95, 0.45 * left], [1.0, -0.35 * left]])
    seen = ground()
    for post in posts:
        ray, to_post = seen[:, :2] - laser[:2], post - laser[:2]
        along = ray @ to_post / np.linalg.norm(to_post)
        aside = np.abs(ray @ [-to_post[1], to_post[0]]) / np.linalg.norm(to_post)
        hidden = (along > np.linalg.norm(to_post)) & (aside < 0.1 * along / np.linalg.norm(to_post))
        seen = seen[~hidden]
    angle = np.linspace(0, 2 * np.pi, 60)
    post_points = np.vstack(
        [
            np.column_stack([x + 0.1 * np.cos(angle), y + 0.1 * np.sin(angle), np.full(60, height)])
            for x, y in posts
            for height in (0.2, 0.4, 0.6)
        ]
    )
    assert gap_area(detection_in(seen, post_points, laser=laser)) == 0
    assert gap_area(detection_in(seen, post_points, laser=laser, origin="robot")) > 0.05


def test_erosion_takes_what_is_thin_and_keeps_what_is_thick():
    slit = ground((1.2, -0.03, 1.8, 0.03))
    assert gap_area(detection_in(slit, n_o=0, k=6)) > 0
    assert gap_area(detection_in(slit, n_o=1, k=6)) == 0
    areas = [gap_area(detection_in(ground(HOLE), n_o=n_o)) for n_o in (0, 1, 2)]
    assert areas[0] >= areas[1] >= areas[2]


# --- parameters that cannot be --------------------------------------------------------------------------


@pytest.mark.parametrize("delta_r", [1.0, 0.5, 0.0, -2.0, math.nan, math.inf])
def test_a_factor_that_does_not_grow_is_refused(delta_r):
    with pytest.raises(ValidationError, match="delta_r"):
        Detector(delta_r=delta_r)


def test_an_empty_box_is_refused():
    with pytest.raises(ValidationError, match="x_min"):
        Detector(x_min=3.0, r_max=3.0)
