"""The detector against Algorithm 1 spelled out in loops (naive.py): cell for cell, on random clouds."""

import math
from dataclasses import replace

import naive
import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from gapeval.config import BlindBelow, BodyBox, Configuration, Detector, FieldOfView, Robot, Sensor
from gapeval.detection import detect, detect_each
from gapeval.detection.grid import polar_grid, row_edges
from gapeval.detection.plane import PlaneFit, supporting_plane
from gapeval.frame import Frame, Plane, Transform, Viewpoint
from gapeval.share import Share

QUICK = settings(
    max_examples=300,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


def on(plane):
    """A way to do the steps of `detect` in which the supporting plane is this one."""

    class OnPlane(Share):
        def __call__(self, step, *args):
            return PlaneFit(plane) if step is supporting_plane else super().__call__(step, *args)

    return OnPlane()


def between(low, high):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


SIZES = st.one_of(
    st.sampled_from([(17, 17), (9, 9), (5, 5)]), st.tuples(st.integers(2, 24), st.integers(2, 24))
)


@st.composite
def detectors(draw, sizes=SIZES):
    height, width = draw(sizes)
    return Detector(
        i_height=height,
        i_width=width,
        delta_r=draw(st.one_of(st.sampled_from([1.005, 1.05, 1.1, 2.0, 3.0]), between(1.005, 3.0))),
        n_o=draw(st.sampled_from([1, 0, 2, 3])),
        pl_th=draw(between(0.02, 0.3)),
        x_min=draw(st.one_of(st.just(0.0), between(0.05, 1.5))),
        r_max=draw(between(2.0, 6.0)),
        z_min=draw(st.sampled_from([math.inf, 0.3, 0.8])),
        z_max=draw(st.sampled_from([0.35, 1.1, 2.0])),
        origin=draw(st.sampled_from(["sensor", "robot"])),
        edge=draw(st.sampled_from(["data", "zero"])),
        kernel=draw(st.sampled_from(["rect", "cross"])),
    )


@st.composite
def mounts(draw):
    """Where the sensor is; level, leaning in any direction, or hanging upside down."""
    translation = draw(st.tuples(between(-0.5, 0.8), between(-0.4, 0.4), between(0.3, 1.2)))
    if draw(st.booleans()):
        return naive.Mount(translation, (0.0, 0.0, 0.0, 1.0))
    axis = np.array(draw(st.tuples(between(-1, 1), between(-1, 1), between(-1, 1))))
    angle = draw(between(-0.6, 0.6))
    assume(np.linalg.norm(axis) > 0.1)
    x, y, z = (np.sin(angle / 2) * axis / np.linalg.norm(axis)).tolist()
    w = math.cos(angle / 2)
    if draw(st.booleans()):  # turned around its x axis first
        x, y, z, w = w, z, -y, -x
    return naive.Mount(translation, (x, y, z, w))


def planes():
    """Unit normals (a, b, c) up to 20 degrees off the vertical, and d."""

    def plane(azimuth, tilt, d):
        return (
            math.sin(tilt) * math.cos(azimuth),
            math.sin(tilt) * math.sin(azimuth),
            math.cos(tilt),
            d,
        )

    level = between(-0.2, 0.2).map(lambda ground_z: (0.0, 0.0, 1.0, -ground_z))
    return st.one_of(level, st.builds(plane, between(-3, 3), between(0, 0.35), between(-0.2, 0.2)))


@st.composite
def scenes(draw, sizes=SIZES):
    low = draw(st.one_of(st.just(-math.pi / 2), between(-1.2, -0.3)))
    fov = draw(
        st.one_of(
            st.none(),
            st.builds(
                lambda a, b, c, d: FieldOfView(azimuth=(a, b), elevation=(c, d)),
                between(-3.1, -0.2),
                between(0.2, 3.1),
                between(-1.5, -0.5),
                between(-0.3, 1.5),
            ),
        )
    )
    body = draw(st.sampled_from([None, BodyBox(x=(-0.4, 0.5), y=(-0.3, 0.3), z=(-0.2, 0.6))]))
    return naive.Scene(draw(detectors(sizes)), draw(planes()), draw(mounts()), low, fov, body)


def cloud(scene, seed, share_of_cells, obstacles):
    """A point in a share of the cells, in and around the box, but for a few blocks of cells.

    Most are on the plane, some above, some below.
    """
    rng = np.random.default_rng(seed)
    edges = np.array(naive.radii(scene, scene.rows + 2 * scene.params.n_o + 1))
    hit = rng.random((len(edges) - 1, 2 * scene.params.width)) < share_of_cells
    for _ in range(rng.integers(1, 4)):
        top, left = rng.integers(0, hit.shape[0]), rng.integers(-2, scene.params.width)
        deep, wide = rng.integers(1, 2 + np.array(hit.shape) // 2)
        hit[top : top + deep, np.arange(left, left + wide) % hit.shape[1]] = False
    row, column = np.nonzero(hit)
    r = edges[row] + (edges[row + 1] - edges[row]) * rng.uniform(0.05, 0.95, len(row))
    theta = (column + rng.uniform(0.05, 0.95, len(row))) * scene.theta_int - math.pi / 2
    x, y = scene.pole[0] + r * np.cos(theta), scene.pole[1] + r * np.sin(theta)
    a, b, c, d = scene.plane
    kind = rng.choice(3, len(row), p=[0.92 - obstacles, obstacles, 0.08])
    above = np.choose(
        kind, [rng.uniform(-1, 1, len(row)), rng.uniform(1, 20, len(row)), rng.uniform(-9, -1, len(row))]
    )
    z = -(a * x + b * y + d) / c + above * scene.params.pl_th
    points = np.stack([x, y, z], axis=1).astype(np.float32)
    rng.shuffle(points)
    return points[~np.array([naive.is_doubtful(scene, edges, p) for p in points.tolist()], dtype=bool)]


def frame_of(scene, points):
    others = tuple(Viewpoint(transform(mount), lowest) for mount, lowest in scene.others)
    return Frame(0, points, transform(scene.mount), scene.lowest, others=others)


def transform(mount):
    return Transform(np.array(mount.translation), np.array(mount.quaternion))


def configuration_of(scene):
    return Configuration(
        detector=scene.params,
        robot=Robot(ground_z=-scene.plane[3], body=scene.body),
        sensor=Sensor(blind_zone="auto", fov=scene.fov),
    )


def compare(scene, detection, points):
    """Every mark, every region and every outline."""
    expected = naive.detect(scene, points.tolist())
    surface = detection.surface
    assert surface.ground.tolist() == expected.ground
    assert surface.obstacle.tolist() == expected.obstacle
    assert surface.shaded.tolist() == expected.shaded
    assert surface.seen.cells.tolist() == expected.seen
    assert surface.gap.cells.tolist() == expected.gap
    regions = [set(zip(*np.nonzero(gap.cells), strict=True)) for gap in detection.gaps]
    assert regions == expected.regions
    for gap, region in zip(detection.gaps, expected.regions, strict=True):
        outline = shapely.union_all([shapely.Polygon(naive.quadrilateral(scene, cell)) for cell in region])
        assert gap.polygon.symmetric_difference(outline).area < 1e-9


shares = st.sampled_from([0.97, 1.0, 0.9, 0.7, 0.0])
obstacles = st.sampled_from([0.0, 0.01, 0.04])
seeds = st.integers(0, 2**32 - 1)


@QUICK
@given(scenes(), seeds, shares, obstacles)
def test_detector_is_the_naive_one(scene, seed, share_of_cells, obstacle_share):
    assume(not naive.has_doubtful_cells(scene))
    points = cloud(scene, seed, share_of_cells, obstacle_share)
    compare(
        scene,
        detect_each(frame_of(scene, points), [configuration_of(scene)], on(Plane(*scene.plane)))[0],
        points,
    )


@settings(QUICK, max_examples=100)
@given(scenes(), between(-0.2, 0.2), seeds, shares)
def test_detector_on_the_robot_plane_is_the_naive_one(scene, ground_z, seed, share_of_cells):
    scene = replace(scene, plane=(0.0, 0.0, 1.0, -ground_z))
    assume(not naive.has_doubtful_cells(scene))
    points = cloud(scene, seed, share_of_cells, 0.01)
    compare(scene, detect(frame_of(scene, points), configuration_of(scene)), points)


@settings(QUICK, max_examples=40)
@given(scenes(), seeds, shares, st.sampled_from(["data", "zero"]), st.sampled_from(["rect", "cross"]))
def test_detector_at_full_size_is_the_naive_one(scene, seed, share_of_cells, edge, kernel):
    params = scene.params.model_copy(
        update={"i_height": 33, "i_width": 33, "n_o": 1, "edge": edge, "kernel": kernel}
    )
    scene = replace(scene, params=params)
    assume(not naive.has_doubtful_cells(scene))
    points = cloud(scene, seed, share_of_cells, 0.002)
    compare(
        scene,
        detect_each(frame_of(scene, points), [configuration_of(scene)], on(Plane(*scene.plane)))[0],
        points,
    )


@settings(QUICK, max_examples=30)
@given(
    scenes(),
    seeds,
    shares,
    st.sampled_from([(129, 1000.0), (400, 20.0), (1100, 2.0), (1100, 3.0), (104, 1000.0)]),
    st.integers(2, 3),
)
def test_detector_is_the_naive_one_where_the_power_overflows(scene, seed, share_of_cells, size, width):
    """delta_r**(i_height - 1) is beyond float64 (or nearly), so r_d is 0; the outer rows still stand."""
    height, delta_r = size
    params = scene.params.model_copy(update={"i_height": height, "i_width": width, "delta_r": delta_r})
    scene = replace(scene, params=params, fov=None)
    assume(not naive.has_doubtful_cells(scene))
    points = cloud(scene, seed, share_of_cells, 0.01)
    compare(
        scene,
        detect_each(frame_of(scene, points), [configuration_of(scene)], on(Plane(*scene.plane)))[0],
        points,
    )


SMALL = st.tuples(st.integers(2, 11), st.integers(2, 9))


@st.composite
def viewpoints(draw):
    """Of another scan or sensor: in, behind or beside the box, sometimes below the plane."""
    mount = draw(mounts())
    x, y, z = mount.translation
    moved = draw(st.tuples(between(-3, 3), between(-3, 3), st.sampled_from([0.0, 0.3, -1.5])))
    mount = naive.Mount((x + moved[0], y + moved[1], z + moved[2]), mount.quaternion)
    return mount, draw(st.one_of(st.just(-math.pi / 2), between(-1.2, -0.3)))


@settings(QUICK, max_examples=150)
@given(
    scenes(), st.lists(viewpoints(), min_size=1, max_size=3), seeds, shares, st.sampled_from([0.005, 0.02])
)
def test_detector_from_several_viewpoints_is_the_naive_one(
    scene, others, seed, share_of_cells, obstacle_share
):
    scene = replace(scene, others=tuple(others))
    assume(not naive.has_doubtful_cells(scene))
    points = cloud(scene, seed, share_of_cells, obstacle_share)
    (found,) = detect_each(frame_of(scene, points), [configuration_of(scene)], on(Plane(*scene.plane)))
    try:
        compare(scene, found, points)
    except naive.DoubtfulError:
        assume(False)


@QUICK
@given(st.integers(2, 200), st.floats(1.0005, 1000), between(0.5, 100))
def test_radii_are_those_of_the_paper(height, delta_r, r_max):
    """Eq. (5) as printed, in decimals: relative to the row's own width, and R at the outer edge."""
    scene = naive.Scene(
        Detector(i_height=height, delta_r=delta_r, r_max=r_max, x_min=0.0),
        (0.0, 0.0, 1.0, 0.0),
        naive.Mount((0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)),
    )
    rows = scene.rows
    expected = np.array(naive.radii(scene, rows))
    found = row_edges(polar_grid(height, 1, delta_r, r_max, (0.0, 0.0)), rows)
    assert np.allclose(found, expected, rtol=1e-9, atol=1e-300)
    assert found[-1] == pytest.approx(r_max, rel=1e-12)


@pytest.mark.parametrize("blind_zone", ["auto", "none", BlindBelow(below=-0.8)])
def test_blind_zone_is_the_naive_one(blind_zone):
    lowest = {"auto": -0.5, "none": -math.pi / 2}.get(blind_zone if isinstance(blind_zone, str) else "", -0.8)
    scene = naive.Scene(
        Detector(k=4, x_min=0.1),
        (0.0, 0.0, 1.0, 0.0),
        naive.Mount((0.1, 0.05, 0.7), (0.1, 0.0, 0.0, math.sqrt(0.99))),
        lowest,
    )
    frame = Frame(0, np.empty((0, 3), np.float32), frame_of(scene, None).sensor, lowest_elevation=-0.5)
    configuration = Configuration(detector=scene.params, sensor=Sensor(blind_zone=blind_zone))
    compare(scene, detect(frame, configuration), frame.points)
