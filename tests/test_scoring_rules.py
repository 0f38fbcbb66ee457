"""Each sentence of DESIGN.md's section on scoring, on scenes whose figures are worked out by hand."""

import numpy as np
import pytest
import shapely
from scenes import NOTHING, STAMP, box, ignore, label, label_file, outlines, placed, scored

from gapeval.config import Configuration, Detector, Domain, MinVisible, Robot, Scoring
from gapeval.frame import Frame, Plane, Transform
from gapeval.scoring.match import match, score
from gapeval.scoring.metrics import figures
from gapeval.scoring.scene import common_domain, scene, view

DOMAIN = box(0, -10, 20, 10)


def sums(labels, gaps, **world):
    return scored(DOMAIN, labels, gaps, **world).sums


def the_row(labels, gaps, **world):
    (row,) = scored(DOMAIN, labels, gaps, **world).labels
    return row


def chosen(found, names):
    return {name: found[name] for name in names.split()}


# --- hit and coverage --------------------------------------------------------------------------------


def test_a_label_is_hit_by_all_gaps_together_from_half_its_area_on():
    trench = label("t", box(5, 0, 9, 1))  # 4 m2
    found = sums([trench], [box(5, 0, 6, 1), box(8, 0, 9, 1)])  # 1 + 1 of 4 m2
    expected = {"hits": 1, "asked": 1, "covered_area": 2.0, "label_area": 4.0, "tp": 0, "fp": 2, "fn": 1}
    assert chosen(found, " ".join(expected)) == expected
    assert sums([trench], [box(5, 0, 6, 1), box(8.0625, 0, 9, 1)])["hits"] == 0


def test_what_two_gaps_cover_both_is_covered_once():
    row = the_row([label("t", box(5, 0, 9, 1))], [box(5, 0, 7, 1), box(6, 0, 7, 1)])
    assert (row.covered_area, row.hit, row.gaps) == (2.0, True, 2)


def test_hit_coverage_is_a_parameter():
    trench, gap = label("t", box(5, 0, 9, 1)), box(5, 0, 8, 1)
    assert sums([trench], [gap], rules=Scoring(hit_coverage=0.75))["hits"] == 1
    assert sums([trench], [gap], rules=Scoring(hit_coverage=0.78))["hits"] == 0


# --- belongs, splits, merges -------------------------------------------------------------------------


@pytest.mark.parametrize(("shared", "belongs"), [(0.25, 1), (0.1875, 0)])
@pytest.mark.parametrize("far", [7, 25], ids=["label smaller", "gap larger than the domain"])
def test_a_gap_belongs_from_a_share_of_the_smaller_area_on(shared, belongs, far):
    pit = label("p", box(2, 0, 4, 1))  # 2 m2, an eighth of it is 0.25 m2
    found = sums([pit], [box(4 - shared, 0, far, 1)], rules=Scoring(belongs=0.125))
    assert (found["pairs"], found["false_gaps"]) == (belongs, 1 - belongs)


def test_a_small_gap_belongs_by_the_share_of_its_own_area():
    moat = label("m", box(0, 0, 10, 10))
    found = sums([moat], [box(9.75, 0, 11.75, 1)], rules=Scoring(belongs=0.125))  # 0.25 of 2 m2
    assert (found["pairs"], found["hits"], found["false_gaps"]) == (1, 0, 0)


def test_a_tenth_of_the_smaller_area_is_the_default():
    moat = label("m", box(0, 0, 10, 10))
    inside = sums([moat], [box(9.875, 0, 10.875, 1)])  # 0.125 of 1 m2
    outside = sums([moat], [box(9.9375, 0, 10.9375, 1)])  # 0.0625
    assert (inside["pairs"], outside["pairs"]) == (1, 0)


def test_splits_counts_gaps_on_labels_that_were_hit_only():
    hit, missed = label("hit", box(2, 0, 4, 1)), label("missed", box(8, 0, 12, 1))
    found = sums([hit, missed], [box(2, 0, 3, 1), box(3, 0, 4, 1), box(8, 0, 9, 1)])
    assert chosen(found, "hits pairs pairs_on_hits paired_gaps") == {
        "hits": 1,
        "pairs": 3,
        "pairs_on_hits": 2,
        "paired_gaps": 3,
    }
    assert (figures(found)["splits"], figures(found)["merges"]) == (2.0, 1.0)


def test_merges_counts_labels_per_gap_that_has_any():
    labels = [label("a", box(2, 0, 4, 1)), label("b", box(5, 0, 7, 1))]
    found = sums(labels, [box(2, 0, 7, 1), box(2, 0, 3, 1), box(15, 0, 16, 1)])
    assert (found["pairs"], found["paired_gaps"]) == (3, 2)
    assert figures(found)["merges"] == 1.5
    assert figures(found)["splits"] == 1.5


# --- matching ----------------------------------------------------------------------------------------


def test_an_iou_of_exactly_the_threshold_matches():
    pit = label("p", box(2, 0, 4, 1))
    at, below = sums([pit], [box(2, 0, 3, 1)]), sums([pit], [box(2, 0, 2.9375, 1)])
    assert chosen(at, "tp fp fn iou_sum") == {"tp": 1, "fp": 0, "fn": 0, "iou_sum": 0.5}
    assert chosen(below, "tp fp fn iou_sum") == {"tp": 0, "fp": 1, "fn": 1, "iou_sum": 0.0}


def test_matching_is_of_the_largest_total_not_of_the_largest_first():
    labels = [label("a", box(0, 0, 4, 1)), label("b", box(4, 0, 8, 1))]
    gaps = [box(1, 0, 6, 1), box(0, 0, 1.5, 1)]  # a: 3/6 or 1.5/4; b: 2/7
    found = sums(labels, gaps, rules=Scoring(iou=0.25))
    assert found["tp"] == 2
    assert found["iou_sum"] == pytest.approx(1.5 / 4 + 2 / 7, abs=1e-12)


def test_one_gap_matches_one_label_only():
    labels = [label("a", box(0, 0, 2, 1)), label("b", box(2, 0, 4, 1))]
    found = sums(labels, [box(0, 0, 4, 1)])
    assert chosen(found, "tp fp fn hits") == {"tp": 1, "fp": 0, "fn": 1, "hits": 2}


def test_a_second_gap_on_a_label_is_a_false_positive_but_no_false_gap():
    pit = label("p", box(0, 0, 2, 2))
    found = sums([pit], [box(0, 0, 2, 2), box(0, 0, 2, 1)])
    assert chosen(found, "tp fp fn false_gaps") == {"tp": 1, "fp": 1, "fn": 0, "false_gaps": 0}


@pytest.mark.parametrize(
    ("iou", "names", "expected"),
    [
        ([[0.5, 0.5]], ["b", "a"], [(0, 1)]),
        ([[0.5, 0.5]], ["9", "10"], [(0, 1)]),  # ids are text
        ([[0.5], [0.5]], ["a"], [(0, 0)]),
        ([[0.5, 0.5], [0.5, 0.5]], ["b", "a"], [(0, 1), (1, 0)]),
        ([[0.0, 0.6], [0.6, 0.6]], ["b", "a"], [(0, 1), (1, 0)]),
        ([[0.6, 0.6], [0.6, 0.0]], ["a", "b"], [(0, 1), (1, 0)]),  # two matches are better than one
        ([[0.5, 0.7], [0.7, 0.6]], ["a", "b"], [(0, 1), (1, 0)]),
        ([[0.49, 0.0], [0.0, 0.8]], ["a", "b"], [(1, 1)]),
        ([[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]], ["c", "b", "a"], [(0, 2), (1, 1)]),
        ([], ["a", "b"], []),
    ],
)
def test_ties_go_by_label_id_then_by_gap(iou, names, expected):
    assert match(np.array(iou, dtype=float).reshape(-1, len(names)), names, 0.5) == expected


def test_no_overlap_is_no_match_even_without_a_threshold():
    assert match(np.zeros((1, 1)), ["a"], 1e-300) == []


# --- false gaps and ignore ---------------------------------------------------------------------------


def test_false_gaps_belong_to_no_label():
    pit = label("p", box(0, 0, 10, 1))
    far, touching, on = box(15, 5, 16, 6), box(9.95, 0, 15, 1), box(0, 0, 10, 1)
    found = sums([pit], [far, touching, on])
    assert (found["false_gaps"], found["fp"], found["tp"]) == (2, 2, 1)
    assert figures(found)["fp_per_frame"] == 2.0


@pytest.mark.parametrize(("edge", "ignored"), [(6.0, 0), (6.0625, 1)])
def test_a_gap_is_ignored_with_more_than_half_of_it_in_an_ignore_polygon(edge, ignored):
    found = sums([ignore("i", box(0, 0, edge, 5))], [box(5, 0, 7, 1)])
    assert (found["ignored"], found["false_gaps"], found["fp"]) == (ignored, 1 - ignored, 1 - ignored)


def test_of_a_gap_across_the_border_of_the_domain_the_part_inside_decides_about_ignoring():
    ignored = ignore("i", box(16, 0, 19, 1))  # 3 of the 4 m2 in the domain, 3 of the 14 m2 in all
    assert sums([ignored], [box(16, 0, 30, 1)])["ignored"] == 1


def test_a_matched_gap_is_never_ignored():
    found = sums([label("p", box(2, 0, 4, 1)), ignore("i", box(0, -5, 9, 5))], [box(2, 0, 4, 1)])
    assert chosen(found, "tp fp ignored hits") == {"tp": 1, "fp": 0, "ignored": 0, "hits": 1}


def test_an_unmatched_gap_is_ignored_also_if_it_belongs_to_a_label():
    # "Only unmatched detections are ignorable: more than half in an `ignore` polygon."
    gap = box(3, 0, 13, 1)  # 1 m2 on the pit: half of the pit, so it belongs, but an IoU of 1/11
    found = sums([label("p", box(2, 0, 4, 1)), ignore("i", box(4, 0, 14, 1))], [gap])
    assert chosen(found, "pairs tp ignored fp") == {"pairs": 1, "tp": 0, "ignored": 1, "fp": 0}


def test_over_area_is_outside_every_label_of_any_kind_and_within_the_domain():
    hidden = label("h", box(18, 0, 40, 1))  # mostly outside the domain: not asked for, yet a label
    labels = [label("p", box(0, 0, 2, 1)), ignore("i", box(5, 0, 6, 1)), hidden]
    rules = Scoring(min_visible=MinVisible(share=0.5, area=5))
    found = sums(labels, [box(1, 0, 7, 1), box(6.5, 0, 30, 1)], rules=rules)
    # Of x = 1 ... 20 without labels: 2 ... 5 and 6 ... 18.
    assert found["over_area_sum"] == pytest.approx(3 + 12)
    assert found["asked"] == 1


# --- domain and shadow -------------------------------------------------------------------------------


def test_only_what_lies_in_the_domain_counts():
    pit = label("p", box(18, 0, 22, 1))  # half of it inside
    row = the_row([pit], [box(18, 0, 30, 1)])
    assert (row.visible_area, row.covered_area, row.iou, row.state) == (2.0, 2.0, 1.0, "partly")
    found = sums([pit], [box(21, 0, 30, 1)])
    assert chosen(found, "not_counted fp false_gaps hits") == {
        "not_counted": 1,
        "fp": 0,
        "false_gaps": 0,
        "hits": 0,
    }


def test_only_what_is_out_of_shadow_counts():
    pit, shadow = label("p", box(4, 0, 8, 1)), box(6, -1, 20, 2)
    row = the_row([pit], [box(4, 0, 20, 1)], shadow=shadow)
    assert (row.visible_area, row.covered_area, row.iou, row.state) == (2.0, 2.0, 1.0, "partly")
    assert sums([pit], [box(4, 0, 20, 1)], shadow=shadow)["over_area_sum"] == 0.0


def test_a_gap_wholly_in_shadow_is_false_if_it_touches_no_label():
    found = sums([label("p", box(2, 0, 4, 1))], [box(7, 0, 9, 1)], shadow=box(6, -1, 20, 2))
    assert chosen(found, "false_gaps fp not_counted over_area_sum") == {
        "false_gaps": 1,
        "fp": 1,
        "not_counted": 0,
        "over_area_sum": 0.0,
    }


def test_a_gap_in_shadow_that_reaches_out_of_the_domain_is_false_too():
    assert sums([], [box(18, 0, 30, 1)], shadow=box(15, -1, 20, 2))["false_gaps"] == 1


@pytest.mark.parametrize("pit", [box(4, 0, 12, 1), box(7, 0, 12, 1)], ids=["asked", "shadowed"])
def test_a_gap_wholly_in_shadow_does_not_count_if_it_touches_a_label(pit):
    found = sums([label("p", pit)], [box(8, 0, 9, 1)], shadow=box(6, -1, 20, 2))
    assert chosen(found, "false_gaps fp not_counted") == {"false_gaps": 0, "fp": 0, "not_counted": 1}


def test_a_gap_in_shadow_can_be_ignored():
    found = sums([ignore("i", box(7, 0, 9, 1))], [box(7, 0, 9, 1)], shadow=box(6, -1, 20, 2))
    assert (found["ignored"], found["false_gaps"]) == (1, 0)


def test_a_gap_that_touches_only_labels_that_are_not_asked_for_counts_neither_way():
    shadowed = label("s", box(5, 0, 15, 1))  # 0.25 of 10 m2 in sight
    shadow, gap = box(5.25, -1, 20, 2), box(4, 0, 6, 1)
    found = sums([shadowed], [gap], shadow=shadow)
    assert chosen(found, "asked not_counted fp false_gaps") == {
        "asked": 0,
        "not_counted": 1,
        "fp": 0,
        "false_gaps": 0,
    }
    both = sums([shadowed, label("p", box(0, 0, 4.05, 0.9))], [gap], shadow=shadow)
    assert (both["asked"], both["pairs"], both["not_counted"], both["false_gaps"]) == (1, 0, 0, 1)


def test_a_world_wholly_in_shadow():
    found = sums([label("p", box(2, 0, 4, 1))], [box(2, 0, 4, 1), box(8, 0, 9, 1)], shadow=DOMAIN)
    expected = {"asked": 0, "empty_frames": 1, "not_counted": 1, "false_gaps": 1, "fp": 1, "label_area": 0.0}
    assert chosen(found, " ".join(expected)) == expected


# --- which labels are asked for ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("minimum", "asked"),
    [
        (MinVisible(share=0.5, area=100), True),  # exactly half of it
        (MinVisible(share=0.53, area=100), False),
        (MinVisible(share=0.53, area=2), True),  # exactly 2 m2: whichever is less
        (MinVisible(share=0.53, area=2.1), False),
        (MinVisible(share=0, area=2.1), True),
    ],
)
def test_a_label_is_asked_for_by_share_or_by_area(minimum, asked):
    pit = label("p", box(18, 0, 22, 1))  # 2 of 4 m2 in the domain
    (found,) = placed(DOMAIN, [pit], rules=Scoring(min_visible=minimum)).labels
    assert found.asked == asked


def test_what_is_nowhere_visible_is_not_asked_for():
    rules = Scoring(min_visible=MinVisible(share=0, area=0))
    (found,) = placed(DOMAIN, [label("p", box(20, 0, 22, 1))], rules=rules).labels
    assert (found.asked, found.state) == (False, "out_of_view")


@pytest.mark.parametrize(
    ("pit", "shadow", "state"),
    [
        (box(2, 0, 4, 1), NOTHING, "visible"),
        (box(10.0625, 0, 20.0625, 1), NOTHING, "visible"),  # 99.4 %
        (box(10.25, 0, 20.25, 1), NOTHING, "partly"),  # 97.5 %
        (box(2, 0, 4, 1), box(0, -5, 20, 5), "shadowed"),
        (box(2, 0, 4, 1), box(2.25, -5, 20, 5), "shadowed"),
        (box(30, 0, 32, 1), NOTHING, "out_of_view"),
        (box(19.9, 0, 32, 1), NOTHING, "out_of_view"),  # 0.1 m2 of it in the domain
        (box(19.9, 0, 32, 1), box(0, -5, 20, 5), "out_of_view"),
    ],
)
def test_states(pit, shadow, state):
    row = the_row([label("p", pit)], [box(2, 0, 4, 1)], shadow=shadow)
    assert row.state == state
    if state in ("shadowed", "out_of_view"):
        assert (row.covered_area, row.iou, row.hit, row.gaps) == (None, None, None, None)


def test_range_is_from_the_sensors_foot_to_the_nearest_visible_point():
    pit = label("p", box(5, 2, 9, 6))
    assert the_row([pit], [], origin=(2.0, -2.0)).range == 5.0  # to (5, 2)
    behind = the_row([pit], [], shadow=box(0, -9, 6, 9), origin=(-2.0, -4.0))
    assert behind.range == 10.0  # to (6, 2)
    hidden = the_row([pit], [], shadow=DOMAIN, origin=(2.0, -2.0))
    assert hidden.range == 5.0  # to its nearest point, where none is visible


def test_a_label_counts_only_at_its_stamps():
    before, after = {"start": None, "end": STAMP - 1}, {"start": STAMP + 1, "end": None}
    labels = [label("before", box(0, 0, 1, 1), **before), label("after", box(2, 0, 3, 1), **after)]
    assert placed(DOMAIN, labels).labels == ()
    now = [label("at", box(0, 0, 1, 1)), label("open", box(2, 0, 3, 1), start=None, end=None)]
    assert [found.label.id for found in placed(DOMAIN, now).labels] == ["at", "open"]


def test_a_label_with_a_length_says_so_in_its_row():
    assert the_row([label("p", box(0, 0, 1, 1), length=0.75)], []).length == 0.75


# --- nothing there -----------------------------------------------------------------------------------


def test_a_frame_that_was_not_labelled_counts_gaps_only():
    found = score(None, outlines([box(0, 0, 1, 1), box(2, 0, 3, 1)]), [{}, {}], Scoring())
    assert found.labels == ()
    assert {name: value for name, value in found.sums.items() if value} == {"frames": 1, "gaps": 2}
    assert "scored_frames" not in found.sums


def test_stamps_say_which_frames_were_labelled():
    labels = label_file(stamps=frozenset({STAMP}))
    assert labels.cover(STAMP)
    assert not labels.cover(STAMP + 1)
    assert label_file().cover(STAMP + 1)


def test_no_label_and_no_gap():
    found = sums([], [])
    assert {name: value for name, value in found.items() if value} == {
        "frames": 1,
        "scored_frames": 1,
        "empty_frames": 1,
    }
    defined = {name: value for name, value in figures(found).items() if value is not None}
    assert defined == {"over_area": 0.0, "fp_per_frame": 0.0, "shadow_gaps": 0.0}


def test_labels_without_gaps():
    found = figures(sums([label("p", box(0, 0, 2, 1))], []))
    defined = {name: value for name, value in found.items() if value is not None}
    zero = dict.fromkeys(("hit_rate", "coverage", "over_area", "fp_per_frame", "recall", "f1", "rq", "pq"), 0)
    zero |= dict.fromkeys(("over_coverage", "shadow_gaps"), 0)
    assert defined == zero | {"near_edge_missed": 1, "under_coverage": 1}


def test_gaps_without_labels():
    found = figures(sums([], [box(0, 0, 2, 1), box(5, 0, 6, 1)]))
    defined = {name: value for name, value in found.items() if value is not None}
    assert defined == {
        "over_area": 3.0,
        "fp_per_frame": 2.0,
        "precision": 0.0,
        "f1": 0.0,
        "rq": 0.0,
        "pq": 0.0,
        "shadow_gaps": 0.0,
    }


# --- the view of a frame -----------------------------------------------------------------------------


def configuration(**detector):
    return Configuration(detector=Detector(**detector))


def test_one_domain_for_a_sweep_is_the_largest_box_in_the_grid():
    found = [configuration(x_min=0.6, r_max=3), configuration(x_min=1, r_max=10)]
    assert common_domain(found, Scoring()) == (Domain(x_min=0.6, r_max=10), "sensor")
    given = Scoring(domain=Domain(x_min=2, r_max=4))
    assert common_domain(found, given) == (Domain(x_min=2, r_max=4), "sensor")


def test_the_domain_is_around_the_robot_only_if_every_configuration_is():
    both = [configuration(origin="robot"), configuration(origin="sensor")]
    assert common_domain(both, Scoring())[1] == "sensor"
    assert common_domain(both[:1], Scoring())[1] == "robot"


def post(x, y, low, high):
    z = np.linspace(low, high, 200)
    return np.column_stack([np.full_like(z, x), np.full_like(z, y), z]).astype(np.float32)


def frame(points, height=1.0, x=0.0, lowest=-np.pi / 2):
    mount = Transform.of([x, 0, height], [0, 0, 0, 1])
    return Frame(STAMP, points, mount, lowest, Transform.identity())


def test_the_view_lies_in_the_plane_at_ground_z_whatever_the_detectors_plane():
    config = Configuration(detector=Detector(plane="patch"), robot=Robot(ground_z=-0.25))
    points = post(2.0, 0.0, -0.25, 0.0)  # 0.25 m above the ground: a shadow
    seen = view(frame(points), Domain(x_min=0.5, r_max=5), "sensor", config, Scoring())
    assert seen.plane == Plane(0.0, 0.0, 1.0, 0.25)
    assert not seen.shadow.is_empty
    higher = Configuration(robot=Robot(ground_z=-0.15))  # 0.15 m above it: none
    assert view(frame(points), Domain(x_min=0.5, r_max=5), "sensor", higher, Scoring()).shadow.is_empty


def test_obstacle_height_and_ceiling_are_parameters_of_scoring():
    config, reach = Configuration(), Domain(x_min=0.5, r_max=5)
    low, high = frame(post(2.0, 0.0, 0.0, 0.3)), frame(post(2.0, 0.0, 2.5, 3.0))
    assert view(low, reach, "sensor", config, Scoring(obstacle_height=0.35)).shadow.is_empty
    assert not view(low, reach, "sensor", config, Scoring()).shadow.is_empty
    assert view(high, reach, "sensor", config, Scoring()).shadow.is_empty
    assert not view(high, reach, "sensor", config, Scoring(ceiling=2.6)).shadow.is_empty


@pytest.mark.parametrize("change", [{"pl_th": 0.01}, {"r_max": 40}, {"z_max": 0.1}, {"k": 3}])
def test_no_swept_parameter_changes_the_view(change):
    shown = frame(post(2.0, 0.5, 0.0, 1.5), lowest=-0.8)
    usual = view(shown, Domain(x_min=0.5, r_max=5), "sensor", Configuration(), Scoring())
    other = view(shown, Domain(x_min=0.5, r_max=5), "sensor", configuration(**change), Scoring())
    assert other.visible.equals_exact(usual.visible)


def test_the_robots_own_body_throws_no_shadow():
    body = {"x": (1.0, 3.0), "y": (-1.0, 1.0), "z": (-1.0, 3.0)}
    config = Configuration(robot={"body": body})
    shown = frame(post(2.0, 0.0, 0.0, 1.5))
    assert view(shown, Domain(x_min=0.5, r_max=5), "sensor", config, Scoring()).shadow.is_empty


def test_the_blind_zone_is_outside_the_domain():
    shown = frame(post(2.0, 0.0, 0.0, 0.0), height=1.0, lowest=-np.pi / 4)  # sees nothing within 1 m
    seen = view(shown, Domain(x_min=0.0, r_max=5), "sensor", Configuration(), Scoring())
    assert seen.domain.area == pytest.approx(np.pi / 2 * (25 - 1), rel=1e-3)
    assert not seen.domain.contains(shapely.Point(0.9, 0))
    paper = Configuration(sensor={"blind_zone": "none"})
    whole = view(shown, Domain(x_min=0.0, r_max=5), "sensor", paper, Scoring())
    assert whole.domain.area == pytest.approx(np.pi / 2 * 25, rel=1e-3)


def test_around_the_robot_a_shadow_reaches_to_the_end_of_the_domain_too():
    shown = frame(post(0.0, 0.0, 0.0, 5.0) + np.float32([-1.0, 0, 0]), x=-2.0)
    seen = view(shown, Domain(x_min=0.0, r_max=5), "robot", Configuration(), Scoring(ceiling=9))
    assert seen.origin == (-2.0, 0.0)
    assert not seen.visible.contains(shapely.Point(4.99, 0.0).buffer(1e-3))
    assert seen.domain.contains(shapely.Point(4.99, 0.0))


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_hairlines_between_the_bins_of_a_shadow_show_nothing(seed):
    rough = np.random.default_rng(seed).uniform(2.0, 2.05, 900)
    wall = np.vstack([post(x, y, 0.0, 1.5) for x, y in zip(rough, np.linspace(-1.5, 1.5, 900), strict=True)])
    rules = Scoring(min_visible=MinVisible(share=0, area=0))
    seen = view(frame(wall), Domain(x_min=0.5, r_max=5), "sensor", Configuration(), rules)
    (found,) = placed(seen.domain, [label("p", box(3.03, -0.71, 4.1, 0.83))], seen.shadow, rules).labels
    assert (found.state, found.asked) == ("shadowed", False)
    assert found.range == pytest.approx(3.03, abs=1e-12)


def test_labels_are_placed_by_the_pose():
    pit = label("p", box(12, 0, 14, 1), start=None, end=None)
    pit = type(pit)("p", "gap", "map", pit.parts)
    pose = Transform.of([10.0, 0.0, 0.0], [0, 0, 0, 1])
    seen = view(frame(post(9, 9, 0, 0)), Domain(x_min=0.5, r_max=8), "sensor", Configuration(), Scoring())
    (found,) = scene(STAMP, pose, seen, label_file(pit), "base_link", Scoring()).labels
    assert found.whole.bounds == (2.0, 0.0, 4.0, 1.0)
