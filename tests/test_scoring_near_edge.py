"""When the near edge of a label is seen, against one line and one intersection for each ray."""

import math
import statistics

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from scenes import NOTHING, box, label, outlines, placed, scored
from test_scoring_reference import RANDOM, shapes

from gapeval.scoring.near_edge import entries
from gapeval.scoring.scene import width

DOMAIN = box(0, -10, 20, 10)
FAR = 100.0
STEP = math.radians(0.5)


def line(ray, origin):
    angle = (ray + 0.5) * STEP
    return shapely.LineString(
        [origin, (origin[0] + FAR * math.cos(angle), origin[1] + FAR * math.sin(angle))]
    )


def first_entry(ray, polygon, origin):
    """None where the ray does not meet it."""
    met = line(ray, origin) & polygon
    return None if met.is_empty else shapely.distance(shapely.Point(origin), met)


def naive(visible, gaps, origin):
    """Of a visible label and the visible parts of the gaps that belong to it: how late it is seen on each ray
    that meets both, and the numbers of rays that meet the label, and no gap."""
    late, rays = [], 0
    for ray in range(720):
        begins = first_entry(ray, visible, origin)
        if begins is None:
            continue
        rays += 1
        found = [entry for gap in gaps if (entry := first_entry(ray, gap, origin)) is not None]
        if found:
            late.append(min(found) - begins)
    return late, rays, rays - len(late)


def only(labels, gaps, **options):
    (row,) = scored(DOMAIN, labels, gaps, **options).labels
    return row


def sector(near, far, low=-0.1, high=0.1):
    """Part of a ring around the origin, whose sides are as good as round."""
    angle = np.linspace(low, high, 4001)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    return shapely.Polygon(np.vstack([near * rim, far * rim[::-1]]))


@RANDOM
@given(
    shapes(), st.lists(shapes(), max_size=4), shapes(), st.sampled_from([(0.0, 0.0), (-4.0, 0.5), (0.3, 5.0)])
)
def test_near_edges_equal_the_naive_reference(shape, gaps, shadow, origin):
    domain = box(-3.1, -2.3, 3.7, 2.9)
    sight = domain - shadow
    row = scored(domain, [label("g", shape)], gaps, shadow, origin=origin).labels[0]
    if row.hit is None:
        assert row.near_edge_rays is row.near_edge_median is None
        return
    visible = shape & sight
    parts = [gap & sight for gap in gaps]
    belonging = [
        part
        for part in parts
        if (shared := (part & visible).area) > 1e-9 and shared >= 0.1 * min(part.area, visible.area)
    ]
    assert row.gaps == len(belonging)
    foot = shapely.Point(origin)
    # Of an edge under the sensor rounding decides.
    assume(all(shapely.distance(foot, of.boundary) > 1e-6 for of in (visible, *belonging)))
    late, rays, missed = naive(visible, belonging, origin)
    assert (row.near_edge_rays, row.near_edge_missed) == (rays, missed)
    if late:
        assert row.near_edge_median == pytest.approx(statistics.median(late), abs=1e-9)
        assert row.near_edge_max == pytest.approx(max(late), abs=1e-9)
    else:
        assert row.near_edge_median is row.near_edge_max is None


@RANDOM
@given(shapes())
def test_a_gap_that_equals_the_label_is_seen_in_time(shape):
    row = scored(box(-9, -9, 9, 9), [label("g", shape)], [shape], origin=(-5.0, 0.0)).labels[0]
    assert row.near_edge_median == pytest.approx(0.0, abs=1e-12)
    assert row.near_edge_max == pytest.approx(0.0, abs=1e-12)
    assert row.near_edge_missed == 0 < row.near_edge_rays


@pytest.mark.parametrize("late", [-0.75, -0.1, 0.0, 0.25, 1.5])
def test_a_gap_that_begins_later_is_late_by_as_much(late):
    row = only([label("g", sector(4, 7))], [sector(4 + late, 7)])
    assert row.near_edge_median == pytest.approx(late, abs=1e-6)
    assert row.near_edge_max == pytest.approx(late, abs=1e-6)
    assert (row.near_edge_rays, row.near_edge_missed) == (22, 0)


def test_the_median_and_the_largest_are_over_rays_that_meet_a_gap():
    """Half of the label's rays meet a gap, most of them in time, a quarter 2 m late."""
    gaps = [sector(4, 7, -0.2, -0.1), sector(6, 7, -0.1, 0.0)]
    row = only(
        [label("g", sector(4, 7, -0.2, 0.2))], [gaps[0], sector(4, 7, -0.1, -0.05), sector(6, 7, -0.05, 0)]
    )
    assert row.near_edge_median == pytest.approx(0.0, abs=1e-6)
    assert row.near_edge_max == pytest.approx(2.0, abs=1e-6)
    assert row.near_edge_missed == 23
    assert row.near_edge_rays == 46


def test_of_several_gaps_the_first_counts():
    row = only([label("g", sector(4, 8))], [sector(6, 8), sector(5, 7)])
    assert row.near_edge_max == pytest.approx(1.0, abs=1e-6)


def test_what_does_not_belong_to_the_label_does_not_count():
    row = only([label("g", sector(4, 8))], [sector(5, 8), sector(2, 3)])
    assert row.near_edge_median == pytest.approx(1.0, abs=1e-6)


def test_what_cannot_be_seen_does_not_count():
    """Neither of the label nor of the gap."""
    shadow = sector(3, 5, -0.3, 0.3)
    row = only([label("g", sector(4, 8))], [sector(3.5, 8)], shadow=shadow)
    assert row.near_edge_median == pytest.approx(0.0, abs=1e-6)


def test_a_label_without_a_gap_is_missed_on_all_rays():
    row = only([label("g", sector(4, 8))], [])
    assert (row.near_edge_median, row.near_edge_rays, row.near_edge_missed) == (None, 22, 22)


def test_who_stands_in_a_label_is_at_its_edge_already():
    row = scored(box(-5, -5, 5, 5), [label("g", box(-1, -1, 1, 1))], [box(0.5, -1, 1, 1)]).labels[0]
    assert row.near_edge_rays == 720
    assert row.range == 0
    assert row.bearing is None
    assert 0.5 <= row.near_edge_median <= row.near_edge_max <= math.hypot(0.5, 1)


def test_sums_are_of_labels_that_were_met():
    labels = [
        label("a", sector(4, 7)),
        label("b", sector(4, 7, 0.5, 0.7)),
        label("c", sector(4, 7, -0.7, -0.5)),
    ]
    found = scored(DOMAIN, labels, [sector(5, 7), sector(4, 7, 0.5, 0.7)]).sums
    assert (found["edges"], found["edge_rays_missed"]) == (2, 23)
    assert found["edge_median_sum"] == pytest.approx(1.0, abs=1e-6)
    assert found["edge_max_sum"] == pytest.approx(1.0, abs=1e-6)


@RANDOM
@given(
    st.lists(
        st.tuples(st.integers(0, 719), st.integers(1, 9)), min_size=3, max_size=9, unique_by=lambda v: v[0]
    )
)
def test_a_ray_through_a_vertex_enters_as_often_as_it_leaves(vertices):
    """From within a hole, all of whose vertices lie on rays: every ray meets its side."""
    order = sorted(vertices)
    angles = [(ray + 0.5) * STEP for ray, _ in order]
    widest = max(np.diff([*angles, angles[0] + 2 * math.pi]))
    if widest >= math.pi - 0.01:
        return
    star = shapely.Polygon(
        [(r * math.cos(a), r * math.sin(a)) for a, (_, r) in zip(angles, order, strict=True)]
    )
    around = shapely.box(-20, -20, 20, 20) - star
    found = entries(outlines([around]), (0.0, 0.0))[0]
    assert np.isfinite(found).all()
    for ray, r in order:
        assert found[ray] == pytest.approx(r, abs=1e-9)


def test_nothing_is_met_where_nothing_is():
    assert entries(outlines([]), (0.0, 0.0)).shape == (0, 720)
    assert np.isinf(entries(outlines([NOTHING]), (0.0, 0.0))).all()


# --- what else is known of a label -------------------------------------------------------------------


def test_the_bearing_is_that_of_the_nearest_visible_point():
    row = only([label("g", box(3, 3, 6, 4))], [])
    assert (row.range, row.bearing) == (pytest.approx(math.hypot(3, 3)), pytest.approx(math.pi / 4))
    shadow = box(0, -10, 5, 10)
    row = only([label("g", box(3, -4, 8, -3))], [], shadow=shadow)
    assert row.bearing == pytest.approx(math.atan2(-3, 5))
    assert row.area == 5.0
    row = only([label("g", box(3, -4, 8, -3))], [], origin=(3.5, -10.0))
    assert row.bearing == pytest.approx(math.pi / 2)


def test_the_width_is_the_labels_length_or_the_least_of_its_hull():
    assert width(label("g", box(2, 1, 2.6, 5), length=0.75)) == 0.75
    assert width(label("g", box(2, 1, 2.6, 5))) == 0.6
    turned = shapely.affinity.rotate(box(2, 1, 2.6, 5), 33)
    assert width(label("g", turned)) == 0.6
    assert width(label("g", shapely.Polygon([(0, 0), (4, 0), (0, 3)]))) == pytest.approx(2.4)
    in_two = shapely.MultiPolygon([box(0, 0, 1, 1), box(3, 0, 4, 1)])
    assert width(label("g", in_two)) == 1.0
    assert placed(DOMAIN, [label("g", box(2, 1, 2.6, 5))]).asked[0].area == pytest.approx(2.4)
