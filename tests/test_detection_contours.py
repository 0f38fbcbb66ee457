"""Outlines, labels and point clouds of regions: whatever the image, a polygon is the union of its cells."""

import naive
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from gapeval.config import Detector
from gapeval.detection.contours import find_contours
from gapeval.detection.grid import cell_polygons, cells, corners, midpoints, polar_grid, row_edges
from gapeval.detection.surface import Mask

QUICK = settings(max_examples=400, deadline=None, derandomize=True)


def grid_of(rows, width, delta_r=1.2, r_max=3.0, origin=(0.25, -0.1)):
    return polar_grid(rows + 1, width, delta_r, r_max, origin)


def gaps_in(picture, **options):
    """The gaps of an image drawn with # for gap, nearest row first."""
    mask = np.array([[character == "#" for character in row] for row in picture.split()])
    return find_contours([(grid_of(*mask.shape, **options), Mask(mask))])[0], mask


def quadrilaterals(grid, mask):
    """The cells of a mask as polygons, formed from the paper's equations alone."""
    scene = naive.Scene(
        Detector(
            i_height=grid.height,
            i_width=grid.width,
            delta_r=grid.delta_r,
            r_max=grid.r_max,
            x_min=0.0,
        ),
        (0.0, 0.0, 1.0, 0.0),
        naive.Mount((*grid.origin, 1.0), (0.0, 0.0, 0.0, 1.0)),
    )
    return [shapely.Polygon(naive.quadrilateral(scene, cell)) for cell in zip(*np.nonzero(mask), strict=True)]


def is_sound(gaps, mask):
    """Everything that holds for any image; returns the gaps so that tests can go on with them."""
    regions = naive.regions(mask.tolist())
    assert len(gaps) == len(regions)
    assert gaps.labels.shape == mask.shape
    for index, (gap, region) in enumerate(zip(gaps, regions, strict=True)):
        assert gap.index == index
        assert set(zip(*np.nonzero(gap.cells), strict=True)) == region
        assert np.array_equal(gap.cells, gaps.labels == index + 1)
        assert gap.polygon is gaps.polygons[index]
        is_union_of_its_cells(gap)
    assert np.array_equal(gaps.labels > 0, mask)
    for i, j in zip(*np.triu_indices(len(gaps), 1), strict=True):
        assert gaps.polygons[i].intersection(gaps.polygons[j]).area < 1e-9
    return gaps


def is_union_of_its_cells(gap):
    own = quadrilaterals(gap.grid, gap.cells)
    assert gap.polygon.geom_type in ("Polygon", "MultiPolygon")
    assert not gap.polygon.is_empty
    assert gap.polygon.is_valid
    assert gap.polygon.area == pytest.approx(sum(cell.area for cell in own), abs=1e-9)
    assert gap.polygon.symmetric_difference(shapely.union_all(own)).area < 1e-9


def masks():
    shape = st.tuples(st.integers(1, 9), st.integers(2, 9))
    noise = arrays(np.bool_, shape, elements=st.booleans())
    dense = st.tuples(shape, st.integers(0, 2**32 - 1), st.sampled_from([0.2, 0.5, 0.75, 0.9])).map(
        lambda drawn: np.random.default_rng(drawn[1]).random(drawn[0]) < drawn[2]
    )
    return st.one_of(noise, dense)


@QUICK
@given(masks(), st.sampled_from([1.005, 1.2, 2.0]), st.sampled_from([(0.0, 0.0), (0.25, -0.1)]))
def test_any_image(mask, delta_r, origin):
    grid = grid_of(*mask.shape, delta_r=delta_r, origin=origin)
    is_sound(find_contours([(grid, Mask(mask))])[0], mask)


@settings(QUICK, max_examples=20)
@given(st.integers(0, 1000), st.sampled_from([0.4, 0.8]))
def test_any_large_image(seed, density):
    mask = np.random.default_rng(seed).random((32, 33)) < density
    is_sound(find_contours([(grid_of(32, 33), Mask(mask))])[0], mask)


PICTURES = {
    "nothing": "... ... ...",
    "one cell": "... .#. ...",
    "all": "### ### ###",
    "one row of one gap": "##",
    "one row": "##.#",
    "one column": ".# .# .. .#",
    "at the pole": "#.#.# ..... .....",
    "around the pole": "#.# ### ...",
    "at the rim": "..... ..... #.#.#",
    "at the sides": "#...# #...# #...#",
    "a frame": "##### #...# #...# #####",
    "two holes": "##### #.#.# #####",
    "holes that touch at a corner": "##### #.### ##.## #####",
    "hole at the outline's corner": "##### #.### .#### #####",
    "island in a hole": "##### #...# #.#.# #...# #####",
    "island that touches the hole's rim": "##### ##..# #.#.# #...# #####",
    "corner touch": "#.. .#. ..#",
    "checkerboard": "#.#.# .#.#. #.#.#",
    "ring pinched at one corner": "..... .##.. .#.#. .###. .....",
    "ring pinched at two corners": "..... ..#.. .#.#. ..#.. .....",
    "spiral": "###### .....# ####.# #..#.# #....# ######",
}


@pytest.mark.parametrize("picture", PICTURES.values(), ids=PICTURES.keys())
@pytest.mark.parametrize("origin", [(0.0, 0.0), (0.25, -0.1)])
def test_picture(picture, origin):
    is_sound(*gaps_in(picture, origin=origin))


def test_holes_are_holes():
    gaps, _ = gaps_in(PICTURES["two holes"])
    assert [len(gap.polygon.interiors) for gap in gaps] == [2]


def test_island_in_a_hole_is_a_gap_of_its_own_and_comes_later():
    gaps, _ = gaps_in(PICTURES["island in a hole"])
    assert [int(gap.cells.sum()) for gap in gaps] == [16, 1]
    assert len(gaps[0].polygon.interiors) == 1


def test_cells_that_touch_at_a_corner_are_one_gap_of_several_polygons():
    gaps, _ = gaps_in(PICTURES["corner touch"])
    assert [gap.polygon.geom_type for gap in gaps] == ["MultiPolygon"]
    assert len(gaps[0].polygon.geoms) == 3


def test_gaps_are_numbered_row_by_row_from_the_pole():
    gaps, _ = gaps_in(".....# ..#... .....# #.....")
    assert [int(np.argwhere(gap.cells)[0][1]) for gap in gaps] == [5, 2, 5, 0]
    nearest = [shapely.Point(0.25, -0.1).distance(gap.polygon) for gap in gaps]
    assert nearest == sorted(nearest)


def test_gaps_are_a_sequence():
    gaps, _ = gaps_in(PICTURES["at the sides"])
    assert [gap.index for gap in gaps[::-1]] == [1, 0]
    assert gaps[-1].index == 1
    with pytest.raises(IndexError):
        gaps[2]


@settings(QUICK, max_examples=60)
@given(masks())
def test_point_cloud_of_the_interior_is_all_midpoints(mask):
    gaps = find_contours([(grid_of(*mask.shape), Mask(mask))])[0]
    for gap, region in zip(gaps, naive.regions(mask.tolist()), strict=True):
        assert sorted(map(tuple, gap.point_cloud(interior=True))) == sorted(middles(gap.grid, region))


@settings(QUICK, max_examples=60)
@given(masks())
def test_point_cloud_of_the_contour_is_the_cells_with_a_neighbour_outside(mask):
    """Suzuki's border: gap cells with a 4-neighbour that is none; the image's edge is none either."""
    gaps = find_contours([(grid_of(*mask.shape), Mask(mask))])[0]
    for gap, region in zip(gaps, naive.regions(mask.tolist()), strict=True):
        border = {(r, c) for r, c in region if not {(r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)} <= region}
        assert sorted(map(tuple, gap.point_cloud(interior=False))) == sorted(middles(gap.grid, border))


def middles(grid, region):
    places = midpoints(grid)
    return [tuple(places[cell]) for cell in region]


@QUICK
@given(
    st.integers(2, 30),
    st.integers(2, 30),
    st.floats(1.005, 3),
    st.sampled_from([(0.0, 0.0), (0.25, -0.1)]),
)
def test_midpoints_fall_in_their_cells(height, width, delta_r, origin):
    """Eqs. (2)-(4) and their inversion are one another's inverse."""
    grid = polar_grid(height, width, delta_r, 3.0, origin)
    places = midpoints(grid) - np.array(origin)
    row, column = cells(grid, places[..., 0].ravel(), places[..., 1].ravel())
    expected_row, expected_column = np.indices((grid.rows, width)).reshape(2, -1)
    # Nearer to an origin other than 0 than this, a place cannot be told from its neighbour.
    apart = np.hypot(*places.reshape(-1, 2).T) > 1e-9
    assert np.array_equal(row[apart], expected_row[apart])
    assert np.array_equal(column[apart], expected_column[apart])


def test_midpoints_are_halfway_between_edges():
    grid = grid_of(4, 6, delta_r=1.5)
    edges = row_edges(grid, grid.rows)
    r = np.hypot(*(midpoints(grid) - np.array(grid.origin)).transpose(2, 0, 1))
    assert np.allclose(r, ((edges[1:] + edges[:-1]) / 2)[:, None])


def test_columns_run_from_right_to_left():
    """Eq. (2) with theta from -pi/2: column 0 is to the robot's right, where y is negative."""
    grid = grid_of(3, 5, origin=(0.0, 0.0))
    y = midpoints(grid)[2, :, 1]
    assert (np.diff(y) > 0).all()
    assert (midpoints(grid)[..., 0] > 0).all()
    assert np.allclose(corners(grid)[-1, [0, -1]], [[0, -3], [0, 3]])


def test_a_single_column_is_refused():
    """Its cells would be the half disk between two chords of 180 degrees: flat, without any area."""
    with pytest.raises(ValidationError, match="i_width"):
        Detector(i_width=1)


def test_columns_go_on_behind():
    grid = grid_of(3, 5, origin=(0.0, 0.0))
    _, column = cells(grid, np.array([-0.01, -1.0, -0.01]), np.array([1.0, 0.001, -1.0]))
    assert column.tolist() == [5, 7, 9]


def test_cell_polygons_are_the_quadrilaterals():
    grid = grid_of(4, 5)
    mask = np.zeros((4, 5), dtype=np.bool_)
    mask[[0, 2, 3], [4, 1, 1]] = True
    for found, expected in zip(
        cell_polygons(grid, *np.nonzero(mask)), quadrilaterals(grid, mask), strict=True
    ):
        assert found.symmetric_difference(expected).area < 1e-12
        assert found.is_valid
