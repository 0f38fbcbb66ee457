"""The supporting plane: the robot's own, or one fitted to the patch in front of it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval import detect
from gapeval.config import BodyBox, Configuration, Detector, Patch, Robot
from gapeval.detection.plane import supporting_plane
from gapeval.frame import Frame, Plane, robot_plane

QUICK = settings(max_examples=60, deadline=None, derandomize=True)
GROUND_Z = -0.07
PATCH = Patch()


def fit(points, patch=PATCH, x_min=0.6):
    return supporting_plane(Frame(0, points.astype(np.float32)), "patch", patch, x_min, GROUND_Z)


def sloped(rng, count=800, pitch=0.0, roll=0.0, offset=0.0, noise=0.0):
    """Points in and around the patch on a plane that leans about the patch's middle, (1.1, 0)."""
    x, y = rng.uniform(0.0, 2.4, count), rng.uniform(-1, 1, count)
    z = GROUND_Z + offset + math.tan(pitch) * (x - 1.1) + math.tan(roll) * y + rng.normal(0, noise, count)
    return np.column_stack([x, y, z])


def normal_of(pitch, roll):
    normal = np.array([-math.tan(pitch), -math.tan(roll), 1.0])
    return normal / np.linalg.norm(normal)


def angle_between(plane, normal):
    return math.acos(min(1.0, float(np.dot([plane.a, plane.b, plane.c], normal))))


def test_plane_of_the_robot_is_level_at_ground_z():
    found = supporting_plane(Frame(0, np.ones((99, 3), np.float32)), "robot", PATCH, 0.6, GROUND_Z)
    assert found.plane == Plane(0.0, 0.0, 1.0, -GROUND_Z)
    assert found.fallback == ""


def test_distance_is_positive_above():
    """Eq. (1)."""
    assert robot_plane(0.5).distance(np.array([3.0, -2.0, 0.75])) == pytest.approx(0.25)
    leaning = Plane(*normal_of(0.1, 0.0), 0.0)
    assert leaning.distance(np.array([1.0, 0.0, math.tan(0.1)])) == pytest.approx(0.0, abs=1e-12)
    assert leaning.distance(np.array([1.0, 0.0, 1.0])) > 0


def test_height_is_that_of_points_on_the_plane():
    plane = Plane(*normal_of(0.2, -0.1), 0.3)
    places = np.array([[0.0, 0.0], [1.0, 2.0], [-3.0, 0.5]])
    on_it = np.column_stack([places, plane.height(places)])
    assert np.allclose(plane.distance(on_it), 0, atol=1e-12)


tilts = st.floats(-0.17, 0.17)  # both at once stay below max_tilt


@QUICK
@given(tilts, tilts, st.floats(-0.28, 0.28), st.integers(0, 1000))
def test_a_sloping_ground_is_found_exactly(pitch, roll, offset, seed):
    points = sloped(np.random.default_rng(seed), pitch=pitch, roll=roll, offset=offset)
    found = fit(points)
    assert found.fallback == ""
    assert angle_between(found.plane, normal_of(pitch, roll)) < 1e-5
    assert np.abs(found.plane.distance(points)).max() < 1e-5
    assert math.hypot(found.plane.a, found.plane.b, found.plane.c) == pytest.approx(1)
    assert found.plane.c > 0


@QUICK
@given(tilts, tilts, st.integers(0, 1000), st.sampled_from([0.25, 0.45, 3.0]))
def test_a_gap_and_outliers_do_not_pull_the_plane(pitch, roll, seed, depth):
    """A gap that takes a third of the patch, its floor seen, and rubble on a tenth of the rest."""
    rng = np.random.default_rng(seed)
    points = sloped(rng, count=2400, pitch=pitch, roll=roll, noise=0.005)
    points[(points[:, 0] > 1.2) & (points[:, 0] < 1.5), 2] -= depth
    rubble = rng.random(len(points)) < 0.1
    points[rubble, 2] += rng.uniform(0.05, 0.4, rubble.sum())
    found = fit(points)
    assert found.fallback == ""
    assert angle_between(found.plane, normal_of(pitch, roll)) < 0.01
    middle = np.array([1.1, 0.0, GROUND_Z])
    assert abs(float(found.plane.distance(middle))) < 0.003


def test_only_the_patch_counts():
    """What lies beside, before and behind the patch may be anything, level ground for one."""
    points = sloped(np.random.default_rng(1), pitch=0.1)
    elsewhere = (points[:, 0] < 0.6) | (points[:, 0] > 1.6) | (np.abs(points[:, 1]) > 0.5)
    points[elsewhere, 2] = GROUND_Z
    assert angle_between(fit(points).plane, normal_of(0.1, 0.0)) < 1e-5
    for larger in (Patch(width=2.0), Patch(depth=3.0)):
        assert angle_between(fit(points, larger).plane, [0, 0, 1]) < 0.01


def test_what_lies_beyond_the_limits_does_not_count():
    """A tunnel's roof, or the floor of a deep hole, though it holds most of the points."""
    rng = np.random.default_rng(1)
    for height in (2.5, -1.0):
        other = sloped(rng, count=2400, offset=height)
        found = fit(np.vstack([sloped(rng, pitch=0.1), other]))
        assert found.fallback == ""
        assert angle_between(found.plane, normal_of(0.1, 0.0)) < 1e-5


def test_the_patch_begins_at_x_min():
    rng = np.random.default_rng(2)
    points = sloped(rng, pitch=0.1)
    points[points[:, 0] < 1.0, 2] = GROUND_Z
    assert angle_between(fit(points, x_min=1.01).plane, normal_of(0.1, 0.0)) < 1e-5
    assert angle_between(fit(points, x_min=0.1, patch=Patch(depth=0.8)).plane, [0, 0, 1]) < 1e-5


@QUICK
@given(st.integers(0, 1000))
def test_order_of_points_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    points = sloped(rng, pitch=0.05, roll=-0.1, noise=0.02)
    assert fit(points) == fit(rng.permutation(points))


FALLBACKS = {
    "patch has too few points": ({"count": 40}, Patch(min_points=50)),
    "patch is tilted too much": ({"pitch": 0.28}, Patch(max_tilt=0.26)),
    "patch is too far above or below the ground": ({"offset": 0.32}, Patch(max_offset=0.3)),
}
GOOD = {
    "patch has too few points": ({"count": 40}, Patch(min_points=4)),
    "patch is tilted too much": ({"pitch": 0.24}, Patch(max_tilt=0.26)),
    "patch is too far above or below the ground": ({"offset": 0.28}, Patch(max_offset=0.3)),
}


@pytest.mark.parametrize("reason", FALLBACKS)
@pytest.mark.parametrize("sign", [1, -1])
def test_beyond_each_limit_the_robots_plane_is_used(reason, sign):
    how, patch = FALLBACKS[reason]
    how = how if "count" in how else {name: sign * value for name, value in how.items()}
    found = fit(sloped(np.random.default_rng(0), **how), patch)
    assert found.fallback == reason
    assert found.plane == robot_plane(GROUND_Z)


@pytest.mark.parametrize("reason", GOOD)
@pytest.mark.parametrize("sign", [1, -1])
def test_within_each_limit_the_patch_is_used(reason, sign):
    how, patch = GOOD[reason]
    how = how if "count" in how else {name: sign * value for name, value in how.items()}
    found = fit(sloped(np.random.default_rng(0), **how), patch)
    assert found.fallback == ""
    assert found.plane != robot_plane(GROUND_Z)


def test_tilt_is_that_of_both_directions_together():
    """0.2 rad in pitch and in roll is more than 0.26 rad."""
    points = sloped(np.random.default_rng(0), pitch=0.2, roll=0.2)
    assert fit(points).fallback == "patch is tilted too much"


def test_no_points_at_all():
    assert fit(np.empty((0, 3))).fallback == "patch has too few points"


def test_detection_hands_on_plane_and_reason():
    configuration = Configuration(detector=Detector(plane="patch"), robot=Robot(ground_z=GROUND_Z))
    points = sloped(np.random.default_rng(0), pitch=0.1).astype(np.float32)
    found = detect(Frame(0, points), configuration)
    assert found.fallback == ""
    assert angle_between(found.plane, normal_of(0.1, 0.0)) < 1e-5
    found = detect(Frame(0, points[:20]), configuration)
    assert found.fallback == "patch has too few points"
    assert found.plane == robot_plane(GROUND_Z)


def test_points_of_the_robots_body_do_not_carry_the_plane():
    """Decision 3: they are dropped. An arm held over the patch is no ground, however many points it has."""
    rng = np.random.default_rng(0)
    ground = sloped(rng, pitch=0.1)
    arm = np.column_stack(
        [rng.uniform(0.6, 1.2, 3000), rng.uniform(-0.2, 0.2, 3000), np.full(3000, GROUND_Z + 0.2)]
    )
    robot = Robot(ground_z=GROUND_Z, body=BodyBox(x=(-0.5, 1.3), y=(-0.3, 0.3), z=(GROUND_Z + 0.15, 0.6)))
    configuration = Configuration(detector=Detector(plane="patch"), robot=robot)
    found = detect(Frame(0, np.vstack([ground, arm]).astype(np.float32)), configuration)
    assert angle_between(found.plane, normal_of(0.1, 0.0)) < 1e-5
