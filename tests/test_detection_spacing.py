"""How far apart echoes lie: rings of known radii, and a naive reference."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval.config import BodyBox, Configuration, Detector, Robot
from gapeval.detection import detect
from gapeval.detection.spacing import bin_match, radial_spacing
from gapeval.frame import Frame, Transform
from gapeval.simulate.rings import ring_growth, ring_radii
from gapeval.simulate.sensors import SENSORS
from gapeval.simulate.simulation import clouds, simulation
from gapeval.simulate.variation import Variation

MOUNT = Transform.of([0.2, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0])
AROUND = np.radians(np.arange(-60, 60.1, 0.25))
BOX = {"x_min": 0.3, "r_max": 3.0}


def configuration(**detector):
    return Configuration(detector=Detector(**(BOX | detector)))


def frame_of(points, mount=MOUNT):
    return Frame(0, np.asarray(points, dtype=np.float32).reshape(-1, 3), mount)


def rings(radii, azimuths=AROUND, z=0.0):
    """Points (N, 3) on rings around the sensor's foot."""
    r, theta = np.meshgrid(radii, azimuths, indexing="ij")
    x, y = MOUNT.translation[0] + r * np.cos(theta), r * np.sin(theta)
    return np.column_stack([x.ravel(), y.ravel(), np.full(r.size, z)])


def row_widths(params, radii):
    """Of rows that lie between the first and the last of these radii in part, by Eq. (3) itself."""
    r_d = params.r_max / (params.delta_r ** (params.height - 1) - 1)
    edges = [r_d * (params.delta_r**row - 1) for row in range(params.height)]
    return np.array([high - low for low, high in pairwise(edges) if radii[0] < high and low < radii[-1]])


# Distances


@given(st.floats(0.03, 0.3))
def test_rings_of_one_spacing(step):
    radii = np.arange(0.8, 2.9, step)
    r, spacing = radial_spacing(frame_of(rings(radii)), configuration())
    assert len(r) == len(AROUND) * (len(radii) - 1)
    np.testing.assert_allclose(spacing, step, atol=1e-6)
    middles = np.sort(r).reshape(len(radii) - 1, len(AROUND))
    np.testing.assert_allclose(
        middles, np.tile((radii[1:] + radii[:-1])[:, None] / 2, len(AROUND)), atol=1e-6
    )


@given(st.floats(1.02, 1.4))
def test_rings_that_grow(growth):
    radii = 0.8 * growth ** np.arange(0, math.log(3 / 0.8) / math.log(growth) - 1e-6)
    if len(radii) < 3:
        return
    r, spacing = radial_spacing(frame_of(rings(radii)), configuration())
    assert len(r) == len(AROUND) * (len(radii) - 1)
    np.testing.assert_allclose(spacing / r, 2 * (growth - 1) / (growth + 1), rtol=1e-4)


def test_a_gap_in_the_data_is_left_out_and_wide_rings_are_not():
    """Also where the gap is in every column at the same radius."""
    radii = np.concatenate([np.arange(0.8, 1.5, 0.05), np.arange(2.0, 2.9, 0.05)])
    _, spacing = radial_spacing(frame_of(rings(radii)), configuration())
    assert len(spacing) == len(AROUND) * (len(radii) - 2)
    np.testing.assert_allclose(spacing, 0.05, atol=1e-6)
    wide = np.concatenate([np.arange(0.8, 1.5, 0.05), np.arange(1.7, 2.9, 0.05)])
    _, spacing = radial_spacing(frame_of(rings(wide)), configuration())
    assert spacing.max() == pytest.approx(0.25, abs=1e-6)


def test_a_gap_at_the_end_of_a_column_is_left_out_too():
    radii = np.concatenate([np.arange(0.8, 1.5, 0.05), [2.6]])
    _, spacing = radial_spacing(frame_of(rings(radii)), configuration())
    np.testing.assert_allclose(spacing, 0.05, atol=1e-6)


def test_only_the_ground_in_the_box_counts():
    radii = np.arange(0.5, 2.0, 0.1)
    ground = rings(radii)
    others = np.concatenate(
        [
            rings(radii + 0.03, z=0.15),  # above the plane
            rings(radii + 0.03, z=-0.15),  # below it
            rings(radii + 0.04, AROUND + math.pi),  # behind
            rings(np.arange(3.01, 4, 0.1)),  # beyond
            rings(np.arange(0.02, 0.1, 0.02)),  # before x_min
        ]
    )
    alone, together = (
        radial_spacing(frame_of(points), configuration()) for points in (ground, np.vstack([ground, others]))
    )
    for one, other in zip(alone, together, strict=True):
        assert one.tobytes() == other.tobytes()
    front = configuration(x_min=1.0)
    assert radial_spacing(frame_of(ground), front)[0].min() > 0.8
    body = Configuration(
        detector=Detector(**BOX), robot=Robot(body=BodyBox(x=(-1, 1.25), y=(-3, 3), z=(-1, 1)))
    )
    assert radial_spacing(frame_of(ground), body)[0].min() > 1.05


def test_the_order_of_points_does_not_matter():
    points = rings(np.arange(0.8, 2.9, 0.07))
    shuffled = np.random.default_rng(0).permutation(points)
    for one, other in zip(
        radial_spacing(frame_of(points), configuration()),
        radial_spacing(frame_of(shuffled), configuration()),
        strict=True,
    ):
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize("points", [[], [[1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [1.2, 0.0, 0.0]]])
def test_too_few_echoes_have_no_spacing(points):
    """Of two echoes nobody knows whether there is a gap between them."""
    r, spacing = radial_spacing(frame_of(points), configuration())
    assert len(r) == len(spacing) == 0
    assert math.isnan(bin_match(frame_of(points), configuration()).ratio)


def naive(azimuth, r):
    """Column by column, distance by distance; sectors of 0.5 degrees."""
    found = []
    sectors = {}
    for angle, radius in zip(azimuth, r, strict=True):
        sectors.setdefault(math.floor(math.degrees(angle) * 2), []).append(radius)
    for radii in sectors.values():
        radii.sort()
        gaps = [b - a for a, b in pairwise(radii)]
        for i, gap in enumerate(gaps):
            beside = sorted(gaps[max(0, i - 5) : i] + gaps[i + 1 : i + 6])
            total, usual = 0.0, None
            for value in beside:
                total += value
                if usual is None and total >= sum(beside) / 2:
                    usual = value
            if usual is not None and gap <= 5 * usual:
                found.append(((radii[i] + radii[i + 1]) / 2, gap))
    return sorted(found)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 400))
def test_scattered_echoes_by_a_naive_reference(seed, count):
    random = np.random.default_rng(seed)
    azimuth = random.uniform(-0.05, 0.05, count)
    r = random.uniform(0.6, 2.9, count) ** random.integers(1, 3)
    points = np.column_stack([0.2 + r * np.cos(azimuth), r * np.sin(azimuth), np.zeros(count)])
    frame = frame_of(points)
    away = frame.points.astype(np.float64) - MOUNT.translation
    r = np.hypot(away[:, 0], away[:, 1])
    inside = (frame.points[:, 0] >= 0.3) & (r < 3)
    expected = naive(np.arctan2(away[inside, 1], away[inside, 0]), r[inside])
    found = sorted(zip(*radial_spacing(frame, configuration()), strict=True))
    np.testing.assert_allclose(
        np.array(found).reshape(-1, 2), np.array(expected).reshape(-1, 2), rtol=1e-9, atol=1e-12
    )


# The match of rows


@pytest.mark.parametrize("delta_r", [1.05, 1.1, 1.5, 2.0])
@pytest.mark.parametrize("k", [5, 6])
def test_the_ratio_is_that_of_row_and_ring(k, delta_r):
    radii = np.arange(0.8, 2.95, 0.05)
    chosen = configuration(k=k, delta_r=delta_r)
    expected = np.median(row_widths(chosen.detector, radii) / 0.05)
    assert bin_match(frame_of(rings(radii)), chosen).ratio == pytest.approx(expected, rel=1e-4)


def naive_ratio(params, r, spacing):
    """Row by row: the distance at half of the length that distances have in the row."""
    r_d = params.r_max / (params.delta_r ** (params.height - 1) - 1)
    edges = [r_d * (params.delta_r**row - 1) for row in range(params.height)]
    ratios = []
    for low, high in pairwise(edges):
        parts = [
            (distance, min(middle + distance / 2, high) - max(middle - distance / 2, low))
            for middle, distance in zip(r, spacing, strict=True)
        ]
        parts = sorted((distance, length) for distance, length in parts if length > 0)
        total, so_far = sum(length for _, length in parts), 0.0
        for distance, length in parts:
            so_far += length
            if so_far >= total * (1 - 1e-9) / 2:
                ratios.append((high - low) / distance)
                break
    return np.median(ratios) if ratios else math.nan


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 200), st.sampled_from([1.05, 1.3, 2.0]))
def test_the_ratio_of_scattered_echoes_by_a_naive_reference(seed, count, delta_r):
    random = np.random.default_rng(seed)
    azimuth, r = random.uniform(-0.05, 0.05, count), random.uniform(0.6, 2.9, count)
    frame = frame_of(np.column_stack([0.2 + r * np.cos(azimuth), r * np.sin(azimuth), np.zeros(count)]))
    chosen = configuration(k=5, delta_r=delta_r)
    expected = naive_ratio(chosen.detector, *radial_spacing(frame, chosen))
    assert bin_match(frame, chosen).ratio == pytest.approx(expected, rel=1e-6, nan_ok=True)


def test_echoes_of_several_columns_in_a_sector_do_not_change_the_ratio():
    """Where a sensor has no columns of one azimuth, a ring has a few echoes in each sector, with noise."""
    radii, random = np.arange(0.8, 2.95, 0.1), np.random.default_rng(3)
    azimuths = random.uniform(-1, 1, 690)  # three in a sector on average
    r, theta = np.meshgrid(radii, azimuths, indexing="ij")
    r, theta = r + random.normal(0, 0.004, r.shape), theta + random.uniform(-2e-3, 2e-3, r.shape)
    scattered = np.column_stack(
        [(0.2 + r * np.cos(theta)).ravel(), (r * np.sin(theta)).ravel(), np.zeros(r.size)]
    )
    expected = bin_match(frame_of(rings(radii)), configuration(k=6)).ratio
    assert bin_match(frame_of(scattered), configuration(k=6)).ratio == pytest.approx(expected, rel=0.2)


def test_filled_is_the_share_of_cells_with_an_echo():
    """Rings 0.2 m apart: a row is filled, from side to side, if there is a ring in it."""
    radii = np.arange(0.61, 2.95, 0.2)
    everywhere = np.radians(np.arange(-89.9, 90, 0.25))
    frame, chosen = frame_of(rings(radii, everywhere)), configuration(k=6, delta_r=1.1)
    params = chosen.detector
    r_d = params.r_max / (1.1**64 - 1)
    edges = np.array([r_d * (1.1**row - 1) for row in range(65)])
    held = np.histogram(radii, edges)[0] > 0
    seen = detect(frame, chosen).surface.seen.cells
    expected = seen[held].sum() / seen.sum()
    assert 0.2 < expected < 0.9
    found = bin_match(frame, chosen).filled
    assert found == pytest.approx(expected, abs=0.01)  # of cells before x_min that the box cuts
    full = bin_match(frame_of(rings(np.arange(0.05, 3, 0.01), everywhere)), configuration(k=5)).filled
    assert full == 1.0


def test_cells_behind_an_obstacle_do_not_count():
    everywhere = np.radians(np.arange(-89.9, 90, 0.25))
    ground = rings(np.arange(0.05, 3, 0.01), everywhere)
    post = rings([1.0], np.radians(np.arange(-20, 20, 0.5)), z=0.8)
    hidden = (np.hypot(ground[:, 0] - 0.2, ground[:, 1]) > 1.0) & (
        np.abs(np.arctan2(ground[:, 1], ground[:, 0] - 0.2)) < math.radians(20.1)
    )
    match = bin_match(frame_of(np.vstack([ground[~hidden], post])), configuration(k=5))
    assert match.filled > 0.995
    assert bin_match(frame_of(ground[~hidden]), configuration(k=5)).filled < 0.95


def test_a_frame_without_echoes_matches_nothing():
    match = bin_match(frame_of([]), configuration())
    assert match.filled == 0.0
    assert math.isnan(match.ratio)
    nothing_seen = Frame(0, np.empty((0, 3), np.float32), MOUNT, lowest_elevation=-0.1)
    assert math.isnan(bin_match(nothing_seen, configuration()).filled)


# Sensors


def cast_radii(sensor):
    """Where the rays that lead straight ahead meet the ground, ray by ray."""
    middle = sensor.pattern.columns // 2
    rays = sensor.pattern.directions(0.0)[:, middle] @ sensor.mount.matrix.T
    assert np.abs(rays[:, 1]).max() < 1e-12
    height = sensor.mount.translation[2] - sensor.robot.ground_z
    return np.sort([-x / z * height for x, _, z in rays if z < 0])


SPINNING = [name for name in SENSORS if name != "lms151"]


@pytest.mark.parametrize("name", SPINNING)
def test_rings_are_where_rays_meet_the_ground(name):
    sensor = SENSORS[name]
    cast = cast_radii(sensor)
    inside = cast[(cast + 0.3 >= 0.6) & (cast < 3.0)]
    np.testing.assert_allclose(ring_radii(sensor, 0.6, 3.0), inside, rtol=1e-9)
    ratios = sorted((c - b) / (b - a) for a, b, c in zip(inside, inside[1:], inside[2:], strict=False))
    n = len(ratios)
    expected = (ratios[(n - 1) // 2] + ratios[n // 2]) / 2
    assert ring_growth(sensor, 0.6, 3.0) == pytest.approx(expected, rel=1e-9)


def test_the_growth_of_the_sensors_rings():
    growth = {name: round(ring_growth(SENSORS[name], 0.6, 3.0), 2) for name in SPINNING}
    assert growth == {"vlp16": 1.2, "hdl32e": 1.13, "os1-64": 1.05, "os1-128": 1.03}


def test_no_rings_no_growth():
    assert ring_radii(SENSORS["lms151"], 0.6, 3.0) is None
    assert ring_growth(SENSORS["lms151"], 0.6, 3.0) is None
    assert ring_growth(SENSORS["vlp16"], 2.5, 3.0) is None  # one ring


@pytest.mark.parametrize("name", SPINNING)
@pytest.mark.parametrize("density", [0.5, 2.0])
def test_echoes_on_flat_ground_are_as_far_apart_as_rings(name, density):
    """Whatever the number of columns, of which several share a sector of 0.5 degrees."""
    made = simulation("plain", name, 1, 0, Variation(roughness=0.0, density=density))
    sensor = made.sensor
    (points,) = clouds(made)
    frame = frame_of(sensor.mount.apply(points.astype(np.float64)), sensor.mount)
    chosen = Configuration(detector=Detector(), robot=sensor.robot)
    r, spacing = radial_spacing(frame, chosen)
    radii = ring_radii(sensor, 0.9, 2.6)
    for low, high in pairwise(radii):
        near = np.abs(r - (low + high) / 2) < (high - low) / 2
        assert np.median(spacing[near]) == pytest.approx(high - low, rel=0.25)
    middle = (radii[1:] + radii[:-1]) / 2
    expected = np.median(
        [np.median(spacing[np.abs(r - m) < 0.1]) / d for m, d in zip(middle, np.diff(radii), strict=True)]
    )
    assert expected == pytest.approx(1.0, abs=0.08)
