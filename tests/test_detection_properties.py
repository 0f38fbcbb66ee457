"""What must not change the result, or change it in a known way: order, margin, sharing, mirrors, turns."""

import math

import naive
import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely import affinity

from gapeval import assess, detect
from gapeval.config import BodyBox, Configuration, CrossingRules, Detector, FieldOfView, Robot, Sensor
from gapeval.detection import detect_each
from gapeval.detection.contours import Gaps
from gapeval.detection.surface import Mask
from gapeval.frame import Frame, Transform
from gapeval.share import Share
from gapeval.traversability import assess_each
from gapeval.traversability.axes import contour_axes, convex_hulls, interior_axes
from gapeval.traversability.crossings import poses

QUICK = settings(max_examples=40, deadline=None, derandomize=True)
MOUNT = naive.Mount((0.2, 0.0, 0.6), (0.0, math.sin(0.05), 0.0, math.cos(0.05)))  # on the x axis, pitched


def ground_with_holes(rng, count=4000, reach=4.0):
    """Points on z = 0 all around, but for one to four rectangles (some with a floor); with a few posts."""
    xy = rng.uniform(-reach, reach, (count, 2))
    z = rng.normal(0, 0.02, count)
    for _ in range(rng.integers(1, 5)):
        low = rng.uniform([0.3, -2.5], [2.5, 2.0])
        inside = ((xy >= low) & (xy <= low + rng.uniform(0.15, 1.2, 2))).all(axis=1)
        z[inside] -= 0.7 if rng.random() < 0.5 else 5.0
    posts = rng.random(count) < 0.002 * rng.integers(0, 2)
    z[posts] += 0.5
    return np.column_stack([xy, z]).astype(np.float32)


def frame_of(points, mount=MOUNT):
    return Frame(7, points, Transform.of(mount.translation, mount.quaternion), lowest_elevation=-1.2)


@st.composite
def configurations(draw):
    """Any configuration, but one that a sweep might hold several of: few values of everything."""

    def some(*values):
        return draw(st.sampled_from(values))

    return Configuration(
        detector=Detector(
            k=some(5, 4, 3),
            delta_r=some(1.1, 1.05, 1.5, 2.0),
            n_o=some(1, 0, 2),
            pl_th=some(0.1, 0.05, 0.2),
            x_min=some(0.6, 0.0),
            r_max=some(3.0, 2.0),
            z_min=some(math.inf, 0.5),
            z_max=some(2.0, 0.4),
            origin=some("sensor", "robot"),
            plane=some("robot", "patch"),
            edge=some("data", "zero"),
            kernel=some("rect", "cross"),
        ),
        crossing=CrossingRules(
            d_r=some(None, 1.0),
            eta=some(None, 0.5),
            standoff=some(None, 0.1),
            clearance=some(None, 0.05),
            uniform=some("area", "kdtree"),
            rules=some("all", "paper"),
        ),
        robot=Robot(body=BodyBox(x=(-0.4, 0.8), y=(-0.3, 0.3), z=(-0.2, 0.6))),
        sensor=Sensor(blind_zone=some("auto", "none"), fov=some(None, FieldOfView(azimuth=(-1.2, 1.2)))),
    )


def result(frame, configuration):
    """All of a detection and its crossings, to the last bit."""
    (alone,) = results(frame, [configuration])
    return alone


def results(frame, configurations):
    """The same for many configurations, evaluated together."""
    share = Share()
    detections = detect_each(frame, configurations, share)
    asked = [(found, c.robot, c.crossing) for found, c in zip(detections, configurations, strict=True)]
    crossings = assess_each(asked, share)
    return [to_the_last_bit(found, crossings.of(index)) for index, found in enumerate(detections)]


def to_the_last_bit(detection, crossings):
    surface = detection.surface
    marks = [surface.ground, surface.obstacle, surface.shaded, surface.seen.cells, surface.gap.cells]
    return (
        detection.stamp,
        detection.plane,
        detection.fallback,
        [(mark.shape, mark.tobytes()) for mark in marks],
        detection.gaps.labels.tobytes(),
        [shapely.to_wkb(polygon) for polygon in detection.gaps.polygons],
        [repr(crossing) for crossing in crossings],
    )


seeds = st.integers(0, 2**32 - 1)


@QUICK
@given(seeds, configurations())
def test_order_of_points_does_not_matter(seed, configuration):
    rng = np.random.default_rng(seed)
    points = ground_with_holes(rng)
    expected = result(frame_of(points), configuration)
    assert result(frame_of(rng.permutation(points)), configuration) == expected
    assert result(frame_of(points[::-1]), configuration) == expected


@QUICK
@given(seeds, configurations())
def test_points_twice_are_points_once(seed, configuration):
    configuration = configuration.model_copy(
        update={"detector": configuration.detector.model_copy(update={"plane": "robot"})}
    )
    points = ground_with_holes(np.random.default_rng(seed), count=1500)
    expected = result(frame_of(points), configuration)
    assert result(frame_of(np.vstack([points, points])), configuration) == expected


@settings(QUICK, max_examples=40)
@given(seeds, st.lists(configurations(), min_size=2, max_size=12))
def test_sharing_steps_changes_nothing(seed, found):
    """A sweep evaluates many configurations together; each gets what it gets alone."""
    frame = frame_of(ground_with_holes(np.random.default_rng(seed)))
    assert results(frame, found) == [result(frame, configuration) for configuration in found]


def neighbours():
    """Pairs of configurations that differ in one parameter only, of every parameter that detection knows."""
    base = {"k": 5, "x_min": 0.3, "n_o": 1, "delta_r": 1.1}
    others = {
        "k": 4,
        "i_height": 20,
        "i_width": 20,
        "delta_r": 1.3,
        "n_o": 2,
        "pl_th": 0.03,
        "x_min": 0.8,
        "r_max": 2.2,
        "z_min": 0.02,
        "z_max": 0.02,
        "origin": "robot",
        "plane": "patch",
        "patch": {"depth": 0.5},
        "edge": "zero",
        "kernel": "cross",
    }
    for name, value in others.items():
        start = base | ({"plane": "patch"} if name == "patch" else {})
        yield pytest.param(start, start | {name: value}, id=name)


@pytest.mark.parametrize(("one", "other"), list(neighbours()))
def test_sharing_confuses_no_parameter(one, other):
    """Two configurations that differ in one parameter share no step that depends on it."""
    frame = frame_of(ground_with_holes(np.random.default_rng(3)))
    found = [Configuration(detector=Detector(**values)) for values in (one, other, one)]
    expected = [result(frame, configuration) for configuration in found]
    assert results(frame, found) == expected
    assert expected[0] != expected[1]  # so that confusing them would show


def test_share_keeps_steps_and_arguments_apart():
    share, done = Share(), []

    def one(x, y=0):
        done.append((x, y))
        return x + y

    def other(x, y=0):
        return -one(x, y)

    assert [share(one, 1), share(other, 1), share(one, 1), share(other, 1)] == [1, -1, 1, -1]
    assert [share(one, 1, y=2), share(one, 2, 1), share(one, 2, y=1), share(one, 1, y=2)] == [3, 3, 3, 3]
    assert done == [(1, 0), (1, 0), (1, 2), (2, 1), (2, 1)]
    assert {name: len(times) for name, times in share.spent.items()} == {"one": 4, "other": 1}


def test_masks_are_equal_by_their_cells():
    """A sweep looks contours up by them."""
    cells = np.eye(3, dtype=np.bool_)
    assert Mask(cells) == Mask(cells.copy())
    assert hash(Mask(cells)) == hash(Mask(cells.copy()))
    assert Mask(cells) != Mask(cells[::-1])
    assert Mask(cells[:1]) != Mask(cells[:1].T)
    assert Mask(cells) != cells


def without_doubt(points, detector):
    """The points whose cells, and whose mirror images' cells, no rounding decides."""
    scene = naive.Scene(detector, (0.0, 0.0, 1.0, 0.0), MOUNT)
    edges = naive.radii(scene, scene.rows + 2 * detector.n_o + 1)
    return points[[not naive.is_doubtful(scene, edges, p) for p in points.tolist()]]


@settings(QUICK, max_examples=30)
@given(seeds, st.sampled_from([(3, 1.3), (4, 1.1), (5, 1.1)]), st.sampled_from(["all", "paper"]))
def test_mirrored_points_give_mirrored_gaps_and_crossings(seed, size, rules):
    """Left and right are alike for a sensor on the x axis (and an odd number of columns)."""
    k, delta_r = size
    detector = Detector(k=k, delta_r=delta_r, x_min=0.3)
    points = without_doubt(ground_with_holes(np.random.default_rng(seed)), detector)
    rules = CrossingRules(d_r=1.5, rules=rules)
    configuration = Configuration(detector=detector)
    here = detect(frame_of(points), configuration)
    there = detect(frame_of(points * np.float32([1, -1, 1])), configuration)
    for name in ("ground", "obstacle", "shaded", "unknown"):
        assert np.array_equal(getattr(here.surface, name), getattr(there.surface, name)[:, ::-1])
    pairs = mirrored_pairs(here.gaps, there.gaps)
    crossings = assess(here, None, rules), assess(there, None, rules)
    for i, j in enumerate(pairs):
        reflected = affinity.scale(there.gaps[j].polygon, 1, -1, origin=(0, 0))
        assert here.gaps[i].polygon.symmetric_difference(reflected).area < 1e-9
        for method in (0, 1):
            are_mirrored(crossings[0][2 * i + method], crossings[1][2 * j + method])


def mirrored_pairs(here, there):
    """Of each gap here, the index of the gap there with the same cells seen from the other side."""
    cells = [gap.cells[:, ::-1].tobytes() for gap in there]
    assert len(cells) == len(here)
    return [cells.index(gap.cells.tobytes()) for gap in here]


def are_mirrored(one, other):
    assert (one.reason, one.traversable, one.tie) == (other.reason, other.traversable, other.tie)
    assert one.length == pytest.approx(other.length, abs=1e-9)
    reflected = [np.array(place) * [1, -1, 1] for place in (other.centre, other.start, other.end)]
    assert np.allclose(one.centre, reflected[0], atol=1e-7)
    if has_equal_ends(one):
        return
    assert np.allclose([one.start, one.end], reflected[1:], atol=1e-6)
    assert math.remainder(one.yaw + other.yaw, 2 * math.pi) == pytest.approx(0, abs=1e-6)


def has_equal_ends(crossing):
    """Whether START and END are equally near, so that rounding decides which is which."""
    return abs(math.hypot(*crossing.start) - math.hypot(*crossing.end)) < 1e-9


@QUICK
@given(seeds, st.floats(-math.pi, math.pi), st.floats(-1, 1), st.floats(-1, 1))
def test_gaps_that_turn_turn_their_axes(seed, angle, x, y):
    """Around the robot, START and END turn along; moved elsewhere, only the axes themselves come along."""
    frame = frame_of(ground_with_holes(np.random.default_rng(seed)))
    gaps = detect(frame, Configuration(detector=Detector(k=5, x_min=0.3))).gaps
    assume(len(gaps) > 0)
    turned = moved(gaps, lambda p: affinity.rotate(p, angle, origin=(0, 0), use_radians=True))
    shifted = moved(gaps, lambda p: affinity.translate(p, x, y))
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    for axes_of in (contour_axes, lambda gaps, hulls: interior_axes(gaps, hulls, "area")):
        before, after = (axes_of(g, convex_hulls(g)) for g in (gaps, turned))
        elsewhere = axes_of(shifted, convex_hulls(shifted))
        assert np.allclose(after.centre, before.centre @ turn.T, atol=1e-9)
        assert np.allclose(elsewhere.centre, before.centre + np.array([x, y]), atol=1e-9)
        assert np.allclose(after.length, before.length, atol=1e-6)
        assert np.array_equal(after.tie, before.tie)
        assert are_axial(after.e_opt, before.e_opt @ turn.T)
        assert are_axial(elsewhere.e_opt[~before.tie], before.e_opt[~before.tie])
        ends, ends_after = (np.array(poses(axes, Robot(), CrossingRules())) for axes in (before, after))
        sure = np.ptp(np.hypot(*np.moveaxis(ends, -1, 0)), axis=0) > 1e-9  # which end is START
        assert np.allclose(ends_after[:, sure], ends[:, sure] @ turn.T, atol=1e-6)


def moved(gaps, how):
    polygons = np.array([how(polygon) for polygon in gaps.polygons], dtype=object)
    return Gaps(gaps.grid, polygons, gaps.image, gaps.seeds)


def are_axial(ones, others):
    """Whether directions (N, 2) are the same up to their sign."""
    return np.allclose(np.abs((ones * others).sum(axis=1)), 1, atol=1e-9)


@settings(QUICK, max_examples=20)
@given(seeds, st.integers(-6, 6))
def test_a_robot_that_turns_by_columns_sees_the_same_gaps(seed, columns):
    """Robot and points turned against each other by whole columns: the image is shifted, nothing else."""
    configuration = Configuration(detector=Detector(k=5, x_min=0.0), sensor=Sensor(blind_zone="none"))
    mount = naive.Mount((0.0, 0.0, 0.6), (0.0, 0.0, 0.0, 1.0))
    angle = columns * math.pi / 33
    points = all_around_but_for_a_hole(np.random.default_rng(seed), apart_from_columns=math.pi / 33)
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )
    here = detect(frame_of(points, mount), configuration)
    there = detect(frame_of((points.astype(np.float64) @ turn.T).astype(np.float32), mount), configuration)
    inner = np.s_[:, 8:-8]
    assert np.array_equal(
        np.roll(here.surface.gap.cells, columns, axis=1)[inner], there.surface.gap.cells[inner]
    )
    rules = CrossingRules(d_r=1.0, rules="paper")
    crossings = [by_length(assess(detection, None, rules)) for detection in (here, there)]
    assert crossings[0]
    for one, other in zip(*crossings, strict=True):
        assert (one.method, one.reason) == (other.method, other.reason)
        assert one.length == pytest.approx(other.length, abs=1e-9)
        if has_equal_ends(one):
            continue
        assert math.remainder(other.yaw - one.yaw - angle, 2 * math.pi) == pytest.approx(0, abs=1e-6)
        for a, b in zip(
            (one.centre, one.start, one.end), (other.centre, other.start, other.end), strict=True
        ):
            assert np.allclose(b, np.array(a) @ turn.T, atol=1e-6)


def all_around_but_for_a_hole(rng, apart_from_columns):
    """Dense ground, with one L-shaped hole ahead; each point well inside its column and its row."""
    r = 3 * (1.1 ** rng.integers(0, 34, 40000) * 1.05 - 1) / (1.1**32 - 1)
    theta = (rng.integers(0, 66, 40000) + rng.uniform(0.1, 0.9, 40000)) * apart_from_columns
    start, stop = rng.uniform(0.7, 0.9), rng.uniform(1.3, 1.7)
    wide = rng.uniform(0.3, 0.5)
    hole = (r > start) & (r < stop) & (np.abs(theta - np.pi / 2) < wide)
    hole |= (r > start) & (r < stop + 0.3) & (np.abs(theta - np.pi / 2 - 0.75 * wide) < 0.25 * wide)
    r, theta = r[~hole], theta[~hole] - np.pi / 2
    return np.column_stack([r * np.cos(theta), r * np.sin(theta), np.zeros(len(r))]).astype(np.float32)


def by_length(crossings):
    return sorted(crossings, key=lambda crossing: (crossing.method, round(crossing.length, 6)))
