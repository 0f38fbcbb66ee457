"""The sensory box, what a sensor looks at, and line-of-sight shadow, against loops over single rays."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval.config import BlindBelow, BodyBox, FieldOfView, Sensor
from gapeval.frame import Frame, Plane, Transform, robot_plane
from gapeval.visibility import (
    areas_only,
    domain,
    in_box,
    looked_at,
    lowest_ray,
    shadow,
    without_body,
)

RANDOM = settings(deadline=None, derandomize=True)
GROUND = robot_plane(0.0)
STRAIGHT_DOWN = -math.pi / 2
BIN = math.radians(0.5)


def quaternion(roll, pitch, yaw):
    """x, y, z, w of Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, sp, sy), (cr, cp, cy) = (
        np.sin(np.array([roll, pitch, yaw]) / 2),
        np.cos([roll / 2, pitch / 2, yaw / 2]),
    )
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]


def mount(x=0.0, y=0.0, height=1.0, roll=0.0, pitch=0.0, yaw=0.0):
    return Transform.of([x, y, height], quaternion(roll, pitch, yaw))


# --- box and robot's body ----------------------------------------------------------------------------


def test_the_box_begins_at_x_min_of_the_robot_and_ends_before_r_max_of_the_origin():
    places = np.array(
        [[0.6, 0.0], [0.59, 0.0], [2.9, 0.0], [3.5, 0.0], [3.4999, 0.0], [0.7, -2.9], [0.7, 3.0]]
    )
    assert in_box(places, 0.6, (0.5, 0.0), 3.0).tolist() == [True, False, True, False, True, True, False]


def test_points_of_the_robots_body_are_dropped_and_those_around_it_kept():
    body = BodyBox(x=(-1, 1), y=(-0.5, 0.5), z=(0, 2))
    points = np.array([[0, 0, 1], [1, 0.5, 2], [1.01, 0, 1], [0, -0.51, 1], [0, 0, -0.1]], dtype=np.float32)
    assert without_body(points, body).tolist() == points[2:].tolist()
    assert without_body(points, None) is points


def test_the_blind_zone_is_measured_given_or_none():
    frame = Frame(1, np.zeros((0, 3), np.float32), lowest_elevation=-0.4)
    assert lowest_ray(Sensor(), frame) == -0.4
    assert lowest_ray(Sensor(blind_zone=BlindBelow(below=-0.3)), frame) == -0.3
    assert lowest_ray(Sensor(blind_zone="none"), frame) == STRAIGHT_DOWN


# --- what a sensor looks at --------------------------------------------------------------------------


def seen_by_trigonometry(place, plane, sensor, lowest, fov):
    """One place on the plane, with scalars only; and how near it is to an edge of the view [rad]."""
    x, y = place
    z = -(plane.a * x + plane.b * y + plane.d) / plane.c
    offset = [x - sensor.translation[0], y - sensor.translation[1], z - sensor.translation[2]]
    ray = [sum(sensor.matrix[row][axis] * offset[row] for row in range(3)) for axis in range(3)]
    elevation = math.asin(ray[2] / math.sqrt(sum(part * part for part in ray)))
    azimuth = math.atan2(ray[1], ray[0])
    edges = [elevation - lowest]
    if fov is not None:
        edges += [elevation - fov.elevation[0], fov.elevation[1] - elevation]
        if fov.azimuth != (-math.pi, math.pi):
            edges += [azimuth - fov.azimuth[0], fov.azimuth[1] - azimuth]
    return min(edges) >= 0, min(abs(edge) for edge in edges)


def views():
    return st.none() | st.builds(
        lambda left, right, low, high: FieldOfView(azimuth=(left, right), elevation=(low, high)),
        st.sampled_from([-math.pi, -2.0, -0.5, 0.1]),
        st.sampled_from([math.pi, 2.0, 0.7, 0.3]),
        st.sampled_from([STRAIGHT_DOWN, -0.6, -0.3]),
        st.sampled_from([math.pi / 2, 0.4, 0.0, -0.1]),
    )


TILT = st.floats(-0.35, 0.35)
MOUNTS = st.builds(
    mount,
    x=st.floats(-0.5, 1.0),
    y=st.floats(-0.5, 0.5),
    height=st.floats(0.4, 2.0),
    roll=TILT,
    pitch=TILT,
    yaw=st.floats(-3.1, 3.1),
)


def planes(tilt_x, tilt_y, height):
    normal = np.array([math.sin(tilt_x), math.sin(tilt_y), 1.0])
    return Plane(*(normal / np.linalg.norm(normal)).tolist(), -height)


PLANES = st.builds(planes, st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.2, 0.1))
LOWEST = st.sampled_from([STRAIGHT_DOWN, -1.0, -0.5, -0.25])


def random_places(count=400):
    return np.random.default_rng(3).uniform([-1, -6], [7, 6], (count, 2))


@settings(RANDOM, max_examples=40)
@given(MOUNTS, PLANES, LOWEST, views())
def test_looked_at_is_what_trigonometry_says(sensor, plane, lowest, fov):
    places = random_places(60)
    found = looked_at(places, plane, sensor, lowest, fov)
    for place, seen in zip(places.tolist(), found.tolist(), strict=True):
        expected, edge = seen_by_trigonometry(place, plane, sensor, lowest, fov)
        assert seen == expected or edge < 1e-9


def assert_domain_is_what_is_looked_at(sensor, plane, lowest, fov, x_min=0.6, r_max=5.0):
    """In front of the origin, where the polar grid is; away from edges."""
    origin = (sensor.translation[0], sensor.translation[1])
    found = domain(x_min, r_max, origin, plane, sensor, lowest, fov)
    assert found.is_valid
    places = random_places()
    places = places[places[:, 0] > origin[0] + 0.01]
    expected = in_box(places, x_min, origin, r_max) & looked_at(places, plane, sensor, lowest, fov)
    inside = shapely.contains_xy(found, places[:, 0], places[:, 1])
    around = [
        in_box(places + step, x_min, origin, r_max) & looked_at(places + step, plane, sensor, lowest, fov)
        for step in 0.05 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [0.7, 0.7], [-0.7, 0.7]])
    ]
    away = np.logical_and.reduce([side == expected for side in around])
    assert away.sum() > 100
    wrong = away & (inside != expected)
    assert not wrong.any(), f"{wrong.sum()} places, e.g. {places[wrong][0]}"


@settings(RANDOM, max_examples=60)
@given(MOUNTS, PLANES, LOWEST)
def test_the_domain_is_the_box_less_the_blind_zone(sensor, plane, lowest):
    assert_domain_is_what_is_looked_at(sensor, plane, lowest, None)


@settings(RANDOM, max_examples=60)
@given(
    st.builds(mount, height=st.floats(0.4, 2.0)),
    LOWEST,
    views(),
)
def test_the_domain_is_within_the_field_of_view_of_a_level_sensor(sensor, lowest, fov):
    assert_domain_is_what_is_looked_at(sensor, GROUND, lowest, fov)


@settings(RANDOM, max_examples=60)
@given(MOUNTS, PLANES, LOWEST, views())
def test_the_domain_is_within_the_field_of_view_of_a_tilted_sensor(sensor, plane, lowest, fov):
    assert_domain_is_what_is_looked_at(sensor, plane, lowest, fov)


@pytest.mark.parametrize("pitch", [0.0, 0.1])
def test_a_field_of_view_in_azimuth_alone(pitch):
    fov = FieldOfView(azimuth=(-0.5, 0.5))
    found = domain(0.6, 5.0, (0.0, 0.0), GROUND, mount(pitch=pitch), STRAIGHT_DOWN, fov)
    assert found.contains(shapely.Point(2.0, 0.3).buffer(0.1))
    assert not found.contains(shapely.Point(2.0, 2.0))


@settings(RANDOM, max_examples=30)
@given(
    st.builds(mount, height=st.floats(0.4, 2.0), roll=st.floats(2.8, 3.4), pitch=TILT, yaw=st.floats(-3, 3)),
    LOWEST,
    views(),
)
def test_the_domain_of_a_sensor_that_hangs_upside_down_is_what_it_looks_at(sensor, lowest, fov):
    assert_domain_is_what_is_looked_at(sensor, GROUND, lowest, fov)


def test_elevations_of_a_sensor_that_hangs_upside_down_are_positive_upwards():
    places = random_places()
    fov = FieldOfView(elevation=(-0.6, -0.2))
    upright = looked_at(places, GROUND, mount(), -0.5, fov)
    hanging = looked_at(places, GROUND, mount(roll=math.pi), -0.5, fov)
    assert (upright == hanging).all()
    assert 0 < upright.sum() < len(places)


def test_azimuths_of_a_sensor_that_hangs_upside_down_go_the_other_way_round():
    left = FieldOfView(azimuth=(0.1, 1.0))
    places = np.array([[1.0, 1.0], [1.0, -1.0]])
    assert looked_at(places, GROUND, mount(), STRAIGHT_DOWN, left).tolist() == [True, False]
    assert looked_at(places, GROUND, mount(roll=math.pi), STRAIGHT_DOWN, left).tolist() == [False, True]


def test_the_domain_of_a_sensor_that_sees_all_is_the_paper_s_box():
    found = domain(0.6, 3.0, (0.0, 0.0), GROUND, mount(), STRAIGHT_DOWN, None)
    segment = 9 * math.acos(0.2) - 0.6 * math.sqrt(9 - 0.36)  # of the disk of radius 3 beyond x = 0.6
    assert found.area == pytest.approx(segment, rel=1e-4)


def test_the_domain_holds_all_that_is_nearer_than_r_max():
    """Its arc is drawn around the circle, so no cell of the last row loses a sliver to it."""
    region = domain(0.0, 5.0, (0.5, 0.0), GROUND, mount(), STRAIGHT_DOWN, None)
    theta = np.linspace(-1.5, 1.5, 5001)
    for r, expected in ((5.0 - 1e-6, True), (5.0 + 1e-3, False)):
        held = shapely.contains_xy(region, 0.5 + r * np.cos(theta), r * np.sin(theta))
        assert (held == expected).all()


def test_a_domain_without_ground_in_view_is_empty():
    fov = FieldOfView(elevation=(-1.5, -1.2))
    found = domain(0.6, 3.0, (0.0, 0.0), GROUND, mount(), STRAIGHT_DOWN, fov)
    assert found.is_empty


# --- shadow ------------------------------------------------------------------------------------------


def shaded_by_rays(place, points, plane, sensor, lowest, highest, reach):
    """Whether a place is in shadow, and whether so near to an edge that it may be told either way."""
    x, y = place[0] - sensor.translation[0], place[1] - sensor.translation[1]
    top = plane.a * sensor.translation[0] + plane.b * sensor.translation[1] + plane.c * sensor.translation[2]
    top += plane.d
    theta, r = math.atan2(y, x), math.hypot(x, y)
    column = math.floor(theta / BIN)
    along = r * math.cos(theta - (column + 0.5) * BIN) / math.cos(BIN / 2)  # edges are chords, not arcs
    shaded, near = False, abs(theta / BIN - round(theta / BIN)) < 1e-6
    for px, py, pz in points:
        height = plane.a * px + plane.b * py + plane.c * pz + plane.d
        if not lowest < height <= highest:
            continue
        dx, dy = px - sensor.translation[0], py - sensor.translation[1]
        start = math.hypot(dx, dy)
        if math.floor(math.atan2(dy, dx) / BIN) != column or not start < reach:
            continue
        end = start * top / (top - height) if height < top else math.inf
        shaded |= start <= along <= end
        near |= abs(along - start) < 1e-6 or abs(along - end) < 1e-6
    return shaded, near or abs(r - reach) < 1e-3


@settings(RANDOM, max_examples=25)
@given(
    MOUNTS,
    PLANES,
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.2, 0.05]),
    st.sampled_from([0.5, 2.0]),
)
def test_shadow_is_what_single_rays_say(sensor, plane, seed, lowest, highest):
    random = np.random.default_rng(seed)
    points = random.uniform([-1, -4, -0.3], [4, 4, 2.6], (300, 3)).astype(np.float32)
    found = shadow(points, plane, sensor, lowest, highest, 5.0)
    assert found.is_valid
    distance, heading = random.uniform(0.2, 5.0, 150), random.uniform(-1.5, 1.5, 150)
    places = sensor.translation[:2] + np.column_stack([np.cos(heading), np.sin(heading)]) * distance[:, None]
    inside = shapely.contains_xy(found, places[:, 0], places[:, 1])
    rows = [[float(value) for value in point] for point in points]
    for place, shaded in zip(places.tolist(), inside.tolist(), strict=True):
        expected, near = shaded_by_rays(place, rows, plane, sensor, lowest, highest, 5.0)
        assert near or shaded == expected, place


def post(x, y, low, high, count=50):
    z = np.linspace(low, high, count)
    return np.column_stack([np.full_like(z, x), np.full_like(z, y), z]).astype(np.float32)


def along(geometry, heading):
    """The parts of a ray from the origin that lie in a geometry: [(from, to), ...]."""
    ray = shapely.LineString([(0, 0), (100 * math.cos(heading), 100 * math.sin(heading))])
    parts = shapely.get_parts(shapely.intersection(ray, geometry))
    return sorted(tuple(sorted(math.hypot(*place) for place in part.coords)) for part in parts)


HALF_BIN = BIN / 2  # the middle of the bin that begins straight ahead


def test_a_low_obstacle_s_shadow_ends_where_the_line_over_it_meets_the_plane_again():
    found = shadow(post(2.0, 1e-6, 0.0, 0.5), GROUND, mount(height=1.0), 0.2, 2.0, 5.0)
    ((start, end),) = along(found, HALF_BIN)
    assert start == pytest.approx(2.0, rel=1e-4)
    assert end == pytest.approx(4.0, rel=1e-4)  # 2.0 m * 1.0 / (1.0 - 0.5)


def test_a_shadow_ends_with_the_reach():
    for height in (0.9, 1.0, 1.5):  # 0.9 would end at 20 m; the others never
        found = shadow(post(2.0, 1e-6, 0.0, height), GROUND, mount(height=1.0), 0.2, 2.0, 5.0)
        ((start, end),) = along(found, HALF_BIN)
        assert (start, end) == (pytest.approx(2.0, rel=1e-4), pytest.approx(5.0, rel=1e-4))
        assert 5.0 / math.cos(HALF_BIN) < end  # so that the domain's arc, drawn around the circle, is covered


def test_a_shadow_is_as_wide_as_the_bins_of_its_obstacle():
    wall = np.vstack([post(2.0, y, 0.0, 1.5) for y in np.linspace(-0.5, 0.5, 400)])
    found = shadow(wall, GROUND, mount(height=1.0), 0.2, 2.0, 5.0)
    x, y = shapely.get_coordinates(found).T
    widest = math.degrees(math.atan(0.25))  # 14.04 degrees: up to the next half degree
    assert math.degrees(max(np.arctan2(y, x))) == pytest.approx(math.ceil(widest * 2) / 2)
    assert math.degrees(min(np.arctan2(y, x))) == pytest.approx(-math.ceil(widest * 2) / 2)


def test_two_low_obstacles_in_line_throw_two_shadows():
    posts = np.vstack([post(1.0, 1e-6, 0.0, 0.25), post(3.0, 1e-6, 0.0, 0.25)])
    found = along(shadow(posts, GROUND, mount(height=1.0), 0.2, 2.0, 5.0), HALF_BIN)
    assert np.array(found) == pytest.approx(np.array([[1.0, 4 / 3], [3.0, 4.0]]), rel=1e-4)


def test_shadows_that_overlap_are_one():
    posts = np.vstack([post(1.0, 1e-6, 0.0, 0.6), post(2.0, 1e-6, 0.0, 0.25)])  # 1 ... 2.5 and 2 ... 2.67
    ((start, end),) = along(shadow(posts, GROUND, mount(height=1.0), 0.2, 2.0, 5.0), HALF_BIN)
    assert (start, end) == (pytest.approx(1.0, rel=1e-4), pytest.approx(8 / 3, rel=1e-4))


def test_of_a_cloud_around_the_robot_each_side_gets_its_own_shadow():
    posts = np.vstack([post(2.0, -1.0, 0.0, 1.5), post(-2.0, 0.5, 0.0, 1.5), post(-2.0, -0.5, 0.0, 1.5)])
    found = shadow(posts, GROUND, mount(height=1.0), 0.2, 2.0, 5.0)
    assert len(shapely.get_parts(found)) == 3
    for x, y in ((2, -1), (-2, 0.5), (-2, -0.5)):
        assert found.contains(shapely.Point(x * 1.5, y * 1.5))


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3), np.float32),
        post(2.0, 0.0, -1.0, 0.19),  # low
        post(2.0, 0.0, 2.01, 3.0),  # above the ceiling: a branch, a bridge
        post(5.01, 0.0, 0.0, 1.5),  # beyond the reach
        post(0.0, 0.0, 0.5, 0.9),  # on the sensor's own axis
    ],
    ids=["nothing", "low", "high", "far", "axis"],
)
def test_what_throws_no_shadow(points):
    found = shadow(points, GROUND, mount(height=1.0), 0.2, 2.0, 5.0)
    assert found.is_empty
    assert found.geom_type == "MultiPolygon"


def test_the_ceiling_itself_throws_a_shadow_the_obstacle_height_does_not():
    low, high = np.float32([[2, 0, 0.25]]), np.float32([[2, 0, 1.75]])
    assert shadow(low, GROUND, mount(height=1.0), 0.25, 1.75, 5.0).is_empty
    assert not shadow(high, GROUND, mount(height=1.0), 0.25, 1.75, 5.0).is_empty


def test_heights_count_from_the_plane_not_from_the_robot():
    below = robot_plane(-0.5)
    assert not shadow(post(2.0, 0.0, -0.5, -0.2), below, mount(height=1.0), 0.2, 2.0, 5.0).is_empty
    assert shadow(post(2.0, 0.0, -0.5, -0.4), below, mount(height=1.0), 0.2, 2.0, 5.0).is_empty


@settings(RANDOM, max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_points_does_not_change_the_shadow(seed):
    random = np.random.default_rng(seed)
    points = random.uniform([-1, -4, 0], [4, 4, 2], (200, 3)).astype(np.float32)
    once = shadow(points, GROUND, mount(), 0.2, 2.0, 5.0)
    again = shadow(random.permutation(points), GROUND, mount(), 0.2, 2.0, 5.0)
    assert once.equals_exact(again)


def test_only_areas_are_left_of_a_geometry():
    square, line = shapely.box(0, 0, 1, 1), shapely.LineString([(2, 0), (3, 0)])
    mixed = shapely.GeometryCollection([square, line, shapely.MultiPolygon([shapely.box(5, 0, 6, 1)])])
    assert areas_only(mixed).equals(shapely.MultiPolygon([square, shapely.box(5, 0, 6, 1)]))
    assert areas_only(shapely.GeometryCollection([square, line])).equals(square)
    for nothing in (line, shapely.Polygon(), shapely.GeometryCollection(), shapely.Point(0, 0)):
        assert areas_only(nothing).is_empty


def test_a_frame_of_a_sensor_below_its_neighbours_is_wholly_in_their_shadow():
    ring = np.vstack([post(1.5 * math.cos(a), 1.5 * math.sin(a), 0, 1.5, 3) for a in np.arange(-2, 2, 0.004)])
    hidden = shadow(ring, GROUND, mount(height=1.0), 0.2, 2.0, 5.0)
    seen = domain(1.6, 5.0, (0.0, 0.0), GROUND, mount(height=1.0), STRAIGHT_DOWN, None)
    assert shapely.difference(seen, hidden).area < 1e-9
