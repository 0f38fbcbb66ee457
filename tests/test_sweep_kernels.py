"""The parts of the bulk evaluation, each against the plain way to say the same."""

import math

import numpy as np
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scenes import outlines
from shapely import affinity

from gapeval.detection.contours import find_contours
from gapeval.detection.grid import polar_grid
from gapeval.detection.surface import Mask
from gapeval.frame import Transform, robot_plane
from gapeval.ragged import distinct, spans
from gapeval.scoring.match import match, match_each
from gapeval.scoring.overlap import area_within, areas_within, pieces
from gapeval.scoring.scene import SLIVER
from gapeval.traversability.axes import area_moments
from gapeval.visibility import AZIMUTH_STEP, shadow

RANDOM = settings(
    max_examples=100, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
seeds = st.integers(0, 2**32 - 1)
SIDE = 6


# --- ragged rows -------------------------------------------------------------------------------------


@RANDOM
@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 5)), max_size=8))
def test_spans_are_the_places_of_each(drawn):
    first, count = np.array(drawn, dtype=np.intp).reshape(-1, 2).T
    where, of = spans(first, count)
    expected = [(begin + step, index) for index, (begin, size) in enumerate(drawn) for step in range(size)]
    assert list(zip(where.tolist(), of.tolist(), strict=True)) == expected


@RANDOM
@given(st.lists(st.lists(st.integers(0, 6), max_size=6), max_size=6))
def test_distinct_knows_objects_by_identity(rows):
    things = [shapely.Point(index // 2, 0) for index in range(7)]  # 0 and 1 are equal, but not the same
    found, which = distinct([outlines([things[index] for index in row]) for row in rows])
    assert len(found) == len({index for row in rows for index in row})
    assert len(which) == len(rows)
    for row, places in zip(rows, which, strict=True):
        assert len(row) == len(places)
        assert all(found[place] is things[index] for index, place in zip(row, places, strict=True))


# --- areas -------------------------------------------------------------------------------------------


def of_cells(cells):
    """The (Multi)Polygon of unit cells; cells that touch at a corner are parts that do."""
    return shapely.union_all([shapely.box(x, y, x + 1, y + 1) for x, y in np.argwhere(cells).tolist()])


def some_cells(rng):
    cells = rng.random((SIDE, SIDE)) < rng.choice([0.1, 0.5, 0.8, 1.0])
    if rng.random() < 0.3:
        low, high = np.sort(rng.integers(0, SIDE + 1, (2, 2)), axis=0)
        cells[:] = False
        cells[low[0] : high[0], low[1] : high[1]] = True
    return cells


@RANDOM
@given(seeds)
def test_the_area_within_a_region_of_cells_is_a_count(seed):
    """Every edge lies on the grid: shapes touch, share edges, pinch and have holes wherever they can."""
    rng = np.random.default_rng(seed)
    inside, shapes = some_cells(rng), [some_cells(rng) for _ in range(12)]
    found = area_within(outlines([of_cells(cells) for cells in shapes]), of_cells(inside))
    assert found.tolist() == [(cells & inside).sum() for cells in shapes]


def nasty(rng):
    """A shape on the grid, turned, shifted by next to nothing, thin, or with ragged edges."""
    shape = of_cells(some_cells(rng))
    kind = rng.integers(6)
    if kind == 0:
        return affinity.rotate(shape, rng.uniform(0, 360), origin=(SIDE / 2, SIDE / 2))
    if kind == 1:
        return affinity.translate(shape, *rng.choice([1e-13, -1e-13, 1e-10, 1e-7, -1e-7], 2))
    if kind == 2:
        return affinity.scale(shape, rng.choice([1e-8, 1e-4]), 1.0, origin=tuple(rng.uniform(0, SIDE, 2)))
    if kind == 3:
        return shape.buffer(rng.uniform(-0.3, 0.3))
    if kind == 4:
        theta = np.sort(rng.uniform(0, 2 * np.pi, 40))
        r = rng.uniform(0.5, SIDE / 2, 40)
        star = shapely.Polygon(np.column_stack([r * np.cos(theta), r * np.sin(theta)]) + SIDE / 2)
        return shapely.make_valid(star, method="structure", keep_collapsed=False)
    return shape


@settings(RANDOM, max_examples=300)
@given(seeds)
def test_the_area_within_a_region_is_that_of_the_intersection(seed):
    rng = np.random.default_rng(seed)
    region, shapes = nasty(rng), outlines([nasty(rng) for _ in range(8)])
    expected = shapely.area(shapely.intersection(shapes, region))
    np.testing.assert_allclose(area_within(shapes, region), expected, rtol=1e-9, atol=SLIVER / 10)
    several = areas_within(shapes, [region, shapely.MultiPolygon(), region])
    assert several.shape == (8, 3)
    assert not several[:, 1].any()
    np.testing.assert_array_equal(several[:, 0], several[:, 2])
    np.testing.assert_allclose(
        several[:, 0], np.where(expected < SLIVER, 0, expected), rtol=1e-9, atol=SLIVER
    )


def test_nothing_has_no_area_within_anything():
    nothing = outlines([shapely.MultiPolygon(), shapely.Polygon()])
    assert area_within(nothing, shapely.box(0, 0, 1, 1)).tolist() == [0.0, 0.0]
    for empty in (shapely.MultiPolygon(), shapely.Polygon(), shapely.GeometryCollection()):
        assert area_within(outlines([shapely.box(0, 0, 1, 1)]), empty).tolist() == [0.0]
    assert area_within(outlines([]), shapely.box(0, 0, 1, 1)).shape == (0,)
    assert areas_within(outlines([]), []).shape == (0, 0)
    assert areas_within(nothing, []).shape == (2, 0)


@RANDOM
@given(seeds)
def test_pieces_cover_the_same_ground_and_none_of_it_twice(seed):
    rng = np.random.default_rng(seed)
    count = [some_cells(rng) for _ in range(rng.integers(0, 4))]
    polygons = outlines([of_cells(cells) for cells in count])
    found = pieces(polygons)
    covered = np.any(count, axis=0) if count else np.zeros((SIDE, SIDE), dtype=np.bool_)
    assert shapely.area(found).sum() == covered.sum()
    assert shapely.union_all(found).symmetric_difference(of_cells(covered)).area == 0
    overlapping = np.sum(count, axis=0).max(initial=0) > 1
    assert (found is polygons) == (not overlapping)


# --- matching ----------------------------------------------------------------------------------------


@settings(RANDOM, max_examples=300)
@given(
    seeds,
    st.lists(st.integers(0, 4), max_size=5),
    st.integers(0, 4),
    st.sampled_from([0.2, 0.5, 1e-9]),
    st.sampled_from([0.3, 0.7]),
)
@example(1, [], 2, 0.5, 0.5)
@example(1, [0, 0], 2, 0.5, 0.5)
def test_matching_many_sets_is_matching_each(seed, sizes, labels, threshold, density):
    rng = np.random.default_rng(seed)
    # Few values: ties, and some at exactly the threshold.
    iou = rng.choice([0.2, 0.5, 0.6, 0.9], (sum(sizes), labels)) * (
        rng.random((sum(sizes), labels)) < density
    )
    owner = np.repeat(np.arange(len(sizes)), sizes)
    names = [f"label {index}" for index in rng.permutation(labels)]
    expected = []
    for index in range(len(sizes)):
        own = np.flatnonzero(owner == index)
        expected += [(own[gap], label) for gap, label in match(iou[own], names, threshold)]
    found = match_each(iou, owner, names, threshold)
    assert found.dtype == np.intp
    assert found.shape == (len(expected), 2)
    assert list(map(tuple, found.tolist())) == expected


# --- shadow ------------------------------------------------------------------------------------------


@RANDOM
@given(seeds, st.integers(0, 60), st.sampled_from([3.0, 20.0, 120.0]), st.sampled_from([0.05, 0.2]))
def test_a_shadow_is_the_union_of_the_quadrilaterals_behind_points(seed, count, spread, lowest):
    rng = np.random.default_rng(seed)
    height, reach = 1.0, 6.0
    foot = np.array([0.2, -0.1])
    azimuth = np.deg2rad(rng.choice([0.0, 90.0, 180.0, -120.0]) + rng.uniform(-spread, spread, count))
    r = rng.choice([rng.uniform(0.5, 7.0), rng.uniform(0.5, 7.0)], count) + rng.uniform(0, 0.4, count)
    z = rng.choice([0.1, 0.15, 0.3, 0.9, 1.5, 2.5], count)
    xy = foot + r[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    points = np.column_stack([xy, z]).astype(np.float32)
    mount = Transform.of((*foot, height), (0, 0, 0, 1))
    found = shadow(points, robot_plane(0.0), mount, lowest, 2.0, reach)

    quads = []
    for x, y, up in points.astype(np.float64):
        east, north = x - foot[0], y - foot[1]
        start = math.hypot(east, north)
        if not (lowest < up <= 2.0 and start < reach):
            continue
        end = min(start * height / (height - up) if up < height else math.inf, reach / math.cos(AZIMUTH_STEP))
        side = math.floor(math.atan2(north, east) / AZIMUTH_STEP)
        left, right = side * AZIMUTH_STEP, (side + 1) * AZIMUTH_STEP
        ring = [(start, left), (end, left), (end, right), (start, right)]
        quads.append(
            shapely.Polygon([(foot[0] + s * math.cos(a), foot[1] + s * math.sin(a)) for s, a in ring])
        )
    assert found.is_valid
    assert found.symmetric_difference(shapely.union_all(quads)).area < 1e-9


# --- contours ----------------------------------------------------------------------------------------


def regions(rng, rows, width):
    """An image that has regions at all borders, holes and pinches, or none at all."""
    cells = rng.random((rows, width)) < rng.choice([0.0, 0.3, 0.6, 0.9, 1.0], p=[0.1, 0.35, 0.35, 0.15, 0.05])
    if rng.random() < 0.3:
        cells[-1] = True
    if rng.random() < 0.3:
        cells[0] = True
    return cells


@settings(RANDOM, max_examples=150)
@given(
    seeds,
    st.integers(1, 7),
    st.integers(2, 9),
    st.integers(1, 6),
    st.sampled_from([(0.0, 0.0), (0.25, -0.1)]),
)
def test_contours_of_many_images_are_those_of_each(seed, rows, width, count, origin):
    rng = np.random.default_rng(seed)
    one = polar_grid(rows + 1, width, 1.2, 3.0, origin)
    other = polar_grid(rows + 1, width, 1.3, 3.0, origin)
    images = [regions(rng, rows, width) for _ in range(count)]
    for index in range(1, count):
        if rng.random() < 0.4:  # a part of the image before
            images[index] = images[index - 1].copy()
            images[index][:, : rng.integers(width + 1)] = False
    asked = [(one if rng.random() < 0.7 else other, Mask(cells)) for cells in images]
    together = find_contours(asked)
    shared = {}
    for (grid, mask), found in zip(asked, together, strict=True):
        (alone,) = find_contours([(grid, mask)])
        assert found.grid == grid
        assert found.labels.dtype == alone.labels.dtype
        np.testing.assert_array_equal(found.labels, alone.labels)
        assert [p.wkb for p in found.polygons] == [p.wkb for p in alone.polygons]
        for index, polygon in enumerate(found.polygons):
            key = (grid, (found.labels == index + 1).tobytes())
            assert shared.setdefault(key, polygon) is polygon, "equal regions are one polygon"
    assert len({id(polygon) for polygon in shared.values()}) == len(shared), "and others are not"


@RANDOM
@given(seeds, st.sampled_from([(0.0, 0.0), (0.25, -0.1)]))
def test_the_moments_of_pinched_regions_and_those_at_the_pole_are_those_of_their_cells(seed, origin):
    """Rings that come to a corner twice, or to the pole, where a row's corners all are one place."""
    rng = np.random.default_rng(seed)
    grid = polar_grid(6, 7, 1.3, 3.0, origin)
    cells = rng.random((5, 7)) < rng.choice([0.4, 0.6, 0.8])
    cells[0, rng.integers(7)] = True
    (gaps,) = find_contours([(grid, Mask(cells))])
    centre, covariance = area_moments(gaps.polygons)
    for index, gap in enumerate(gaps):
        quads = quadrilaterals(grid, gap.cells)
        areas = shapely.area(quads)
        np.testing.assert_allclose(gap.polygon.area, areas.sum(), rtol=1e-9)
        own_centre, own_covariance = area_moments(quads)
        middle = areas @ own_centre / areas.sum()
        apart = own_centre - middle
        spread = own_covariance + apart[:, :, None] * apart[:, None, :]
        np.testing.assert_allclose(centre[index], middle, atol=1e-9)
        np.testing.assert_allclose(covariance[index], np.tensordot(areas, spread, 1) / areas.sum(), atol=1e-9)


def quadrilaterals(grid, cells):
    """One polygon for each cell; those at the pole are triangles."""
    r = np.exp(grid.log_r_d) * (grid.delta_r ** np.arange(grid.rows + 1) - 1)
    theta = np.arange(grid.width + 1) * np.pi / grid.width - np.pi / 2
    x, y = origin = grid.origin
    found = []
    for row, column in np.argwhere(cells).tolist():
        ring = [(row, column), (row + 1, column), (row + 1, column + 1), (row, column + 1)]
        places = [(x + r[i] * math.cos(theta[j]), y + r[i] * math.sin(theta[j])) for i, j in ring]
        found.append(shapely.Polygon([origin, *places[1:3]] if row == 0 else places))
    return outlines(found)
