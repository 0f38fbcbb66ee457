"""The label format: what is refused, feature by feature, and the way of a label onto the robot's plane."""

import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval.errors import LabelError
from gapeval.frame import Plane, Transform, robot_plane
from gapeval.labels import Label, check_labels, crossing_yaw, on_plane, place, read_labels, require_frames

RANDOM = settings(deadline=None, derandomize=True)
SQUARE = [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]
AWAY = [[[9, 9], [10, 9], [10, 10], [9, 10], [9, 9]]]
BOW_TIE = [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]


def polygon(coordinates):
    return {"type": "Polygon", "coordinates": coordinates}


def feature(name="a", coordinates=SQUARE, **properties):
    return {"type": "Feature", "properties": {"id": name} | properties, "geometry": polygon(coordinates)}


GOOD = feature("good", AWAY)


def write(tmp_path, *features, **top):
    path = tmp_path / "labels.geojson"
    document = {"type": "FeatureCollection", "frame_id": "map", "features": list(features)} | top
    path.write_text(json.dumps(document))
    return path


def problems(tmp_path, *features, **top):
    """The problems of these features after a good one."""
    return [str(found) for found in check_labels(write(tmp_path, GOOD, *features, **top))[1]]


def shifted(x):
    return [[[px + x, py] for px, py in ring] for ring in SQUARE]


# --- what is read ------------------------------------------------------------------------------------


def test_the_documented_example(tmp_path):
    ring = [[4.0, -3.0, 0.0], [4.6, -3.0, 0.0], [4.6, 2.6, 0.0], [4.0, 2.6, 0.0], [4.0, -3.0, 0.0]]
    path = write(tmp_path, feature("trench", [ring], kind="gap"))
    labels = read_labels(path)
    (trench,) = labels.labels
    assert (trench.id, trench.kind, trench.frame_id) == ("trench", "gap", "map")
    assert (trench.start, trench.end, trench.traversable, trench.length) == (None, None, None, None)
    assert trench.parts[0][0].tolist() == ring
    assert (labels.path, labels.stamps) == (path, None)


def test_labels_are_the_same_that_say_the_same(tmp_path):
    ring = [[4.0, -3.0, 0.0], [4.6, -3.0, 0.0], [4.6, 2.6, 0.0], [4.0, -3.0, 0.0]]
    path = write(tmp_path, feature("trench", [ring]))
    document = json.loads(path.read_bytes())
    before = read_labels(path).sha256
    path.write_text(json.dumps(dict(reversed(document.items())), indent=4).replace("\n", "\r\n") + "\n")
    assert read_labels(path).sha256 == before
    document["features"][0]["geometry"]["coordinates"][0][1][0] += 1e-9
    path.write_text(json.dumps(document))
    assert read_labels(path).sha256 != before


def test_every_property_is_read_and_unknown_ones_do_no_harm(tmp_path):
    known = {"start": "10", "end": 20, "traversable": False, "length": 2, "crossing_yaw": -0.5, "by": "Ann"}
    (found,) = read_labels(write(tmp_path, feature("a", kind="ignore", frame_id="/odom", **known))).labels
    assert (found.kind, found.frame_id, found.start, found.end) == ("ignore", "odom", 10, 20)
    assert (found.traversable, found.length, found.crossing_yaw) == (False, 2.0, -0.5)


def test_a_label_is_a_gap_unless_it_says_otherwise_and_ids_may_be_numbers(tmp_path):
    (found,) = read_labels(write(tmp_path, feature(7))).labels
    assert (found.id, found.kind) == ("7", "gap")


def test_holes_and_multipolygons(tmp_path):
    hole = [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.25]]
    shape = feature()
    shape["geometry"] = {"type": "MultiPolygon", "coordinates": [[SQUARE[0], hole], AWAY]}
    (found,) = read_labels(write(tmp_path, shape)).labels
    assert [len(rings) for rings in found.parts] == [2, 1]
    found = place(found, Transform.identity(), robot_plane(0), "base_link")
    assert found.area == pytest.approx(1 - 0.125 + 1)


@pytest.mark.parametrize("features", [[], [feature("i", kind="ignore")]], ids=["none", "ignore only"])
def test_a_file_without_any_gap_label(tmp_path, features):
    labels, found = check_labels(write(tmp_path, *features))
    assert (len(labels.labels), found) == (len(features), [])


BIG = 2**60 + 1  # floats hold 2**60 and 2**60 + 256


@pytest.mark.parametrize("text", [True, False])
def test_stamps_beyond_2_to_the_53_are_exact_as_strings_and_as_numbers(tmp_path, text):
    first, last = (str(BIG), str(BIG + 2)) if text else (BIG, BIG + 2)
    labels = read_labels(write(tmp_path, feature(start=first, end=last), stamps=[first, last]))
    (found,) = labels.labels
    assert (found.start, found.end) == (BIG, BIG + 2)
    assert labels.stamps == {BIG, BIG + 2}
    assert [labels.cover(BIG + step) for step in (-1, 0, 1, 2)] == [False, True, False, True]


def test_start_and_end_are_inclusive(tmp_path):
    (found,) = read_labels(write(tmp_path, feature(start=BIG, end=BIG + 1))).labels
    assert [found.holds_at(BIG + step) for step in (-1, 0, 1, 2)] == [False, True, True, False]


def test_without_stamps_all_frames_were_labelled_with_an_empty_list_none(tmp_path):
    assert read_labels(write(tmp_path, GOOD)).cover(1)
    assert not read_labels(write(tmp_path, GOOD, stamps=[])).cover(1)


# --- what is refused ---------------------------------------------------------------------------------

NAN, INF = math.nan, math.inf


def ring_with(vertex):
    return [[[0, 0, 0], [1, 0, 0], vertex, [0, 1, 0], [0, 0, 0]]]


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ({"geometry": polygon(SQUARE)}, "properties"),
        ({"properties": {}, "geometry": polygon(SQUARE)}, "no `id`"),
        ({"properties": {"id": None}, "geometry": polygon(SQUARE)}, "no `id`"),
        ({"properties": {"id": ""}, "geometry": polygon(SQUARE)}, "no `id`"),
        ({"properties": {"id": True}, "geometry": polygon(SQUARE)}, "no `id`"),
        (5, "properties"),
        ({"properties": {"id": "a"}}, "geometry is missing"),
        ({"properties": {"id": "a"}, "geometry": None}, "geometry is missing"),
        ({"properties": {"id": "a"}, "geometry": {"type": "Point", "coordinates": [0, 0]}}, "Point"),
        ({"properties": {"id": "a"}, "geometry": {"type": "MultiPolygon", "coordinates": []}}, "coordinates"),
        (feature("good"), "the id good is used before"),
        (feature(coordinates=[]), "a polygon without rings"),
        (feature(coordinates=[[]]), "a ring without positions"),
        (feature(coordinates=[SQUARE[0][:-1]]), "an open ring"),
        (feature(coordinates=[[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1]]]), "an open ring"),
        (feature(coordinates=[[[0, 0], [1, 0], [0, 0]]]), "a ring of 3 positions"),
        (feature(coordinates=BOW_TIE), "not a valid polygon: Self-intersection"),
        (feature(coordinates=[SQUARE[0], AWAY[0]]), "not a valid polygon: Hole lies outside"),
        (feature(coordinates=[[[0, 0], [1, 0], [2, 0], [0, 0]]]), "not a valid polygon"),
        (feature(coordinates=ring_with([NAN, 1, 0])), "not finite"),
        (feature(coordinates=ring_with([1, INF, 0])), "not finite"),
        (feature(coordinates=ring_with([1, 1, -INF])), "not finite"),
        (feature(coordinates=ring_with([1])), "x, y and perhaps z"),
        (feature(coordinates=ring_with([1, 1, 0, 0])), "x, y and perhaps z"),
        (feature(coordinates=ring_with(["one", 1, 0])), "no numbers"),
        (feature(coordinates=ring_with(None)), "x, y and perhaps z"),
        (feature(kind="hole"), "kind is 'hole'; use `gap` or `ignore`"),
        (feature(start="soon"), "start is 'soon'; expected nanoseconds"),
        (feature(end=1.5), "end is 1.5; expected nanoseconds"),
        (feature(start=INF), "expected nanoseconds"),
        (feature(start=[]), "expected nanoseconds"),
        (feature(start=5, end=4), "start 5 is later than end 4"),
        (feature(traversable="yes"), "traversable is 'yes'"),
        (feature(length="long"), "length is 'long'"),
        (feature(length=NAN), "length is nan"),
        (feature(crossing_yaw=True), "crossing_yaw is True"),
    ],
)
def test_a_bad_feature_is_refused_by_place_and_reason(tmp_path, bad, reason):
    (found,) = problems(tmp_path, bad)
    assert found.startswith("feature 1")
    assert reason in found
    assert "\n" not in found
    with pytest.raises(LabelError) as caught:
        read_labels(write(tmp_path, GOOD, bad))
    assert str(caught.value) == f"{tmp_path / 'labels.geojson'}: {found}"


@pytest.mark.parametrize(
    "bad",
    [
        feature(start=True),
        feature(coordinates=ring_with([1, 1, NAN])),
        feature(coordinates=ring_with(["1", "1", "0"])),
        feature(coordinates=[["000", "100", "110", "000"]]),
    ],
    ids=["stamp that is no number", "z that is no number", "numbers as text", "vertices as text"],
)
def test_what_json_says_is_no_number_is_refused(tmp_path, bad):
    assert len(problems(tmp_path, bad)) == 1


def test_a_feature_is_named_by_its_id(tmp_path):
    found = problems(tmp_path, feature("trench", BOW_TIE), feature("pit", kind="x"))
    assert [text.partition(":")[0] for text in found] == ["feature 1 (trench)", "feature 2 (pit)"]


def test_no_frame(tmp_path):
    (found,) = problems(tmp_path, frame_id=None)
    assert found == 'feature 0 (good): no frame: add "frame_id": "map" (or another) at the top of the file'


@pytest.mark.parametrize("stamps", ["all", {"1": 2}, ["soon"], [1.5], [None], [True]])
def test_bad_stamps(tmp_path, stamps):
    (found,) = problems(tmp_path, stamps=stamps)
    assert found.startswith("file: `stamps`")


def test_the_first_problem_is_told_with_the_number_of_others(tmp_path):
    path = write(tmp_path, feature("a", BOW_TIE), feature("b", kind="x"), GOOD, stamps=5)
    with pytest.raises(LabelError) as caught:
        read_labels(path)
    assert str(caught.value).startswith(f"{path}: feature 0 (a): not a valid polygon")
    assert str(caught.value).endswith("(and 2 more; see `gapeval labels check`)")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not JSON"),
        (b"{", "not JSON"),
        (b"\xff\x00", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b"5", "FeatureCollection"),
        (b'{"type": "Feature"}', "FeatureCollection"),
        (b'{"type": "FeatureCollection"}', "`features`, a list"),
        (b'{"type": "FeatureCollection", "features": {}}', "`features`, a list"),
    ],
)
def test_a_file_that_is_no_feature_collection(tmp_path, content, reason):
    path = tmp_path / "labels.geojson"
    path.write_bytes(content)
    with pytest.raises(LabelError) as caught:
        read_labels(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(LabelError) as caught:
        read_labels(tmp_path / "none.geojson")
    assert str(caught.value) == f"{tmp_path / 'none.geojson'}: cannot be read: No such file or directory"


# --- overlaps ----------------------------------------------------------------------------------------


def test_gap_labels_that_overlap_are_refused(tmp_path):
    (found,) = problems(tmp_path, feature("a"), feature("b", shifted(0.75)))
    assert found == "label b: overlaps label a by 0.25 m2; gap labels may not"


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ({}, {"kind": "ignore"}),
        ({"kind": "ignore"}, {"kind": "ignore"}),
        ({"end": 9}, {"start": 10}),
        ({"start": 10, "end": 12}, {"start": 5, "end": 9}),
        ({"frame_id": "map"}, {"frame_id": "base_link"}),
    ],
    ids=["ignore", "both ignore", "later", "earlier", "other frame"],
)
def test_labels_that_may_overlap(tmp_path, a, b):
    assert problems(tmp_path, feature("a", **a), feature("b", shifted(0.75), **b)) == []


@pytest.mark.parametrize(
    ("a", "b"),
    [({"end": 9}, {"start": 9}), ({"start": 3, "end": 9}, {}), ({"end": 9}, {"end": 3}), ({"start": 1}, {})],
)
def test_labels_with_a_stamp_in_common_may_not_overlap(tmp_path, a, b):
    assert len(problems(tmp_path, feature("a", **a), feature("b", shifted(0.75), **b))) == 1


def test_neighbours_do_not_overlap(tmp_path):
    assert problems(tmp_path, feature("a"), feature("b", shifted(1.0))) == []


# --- frames ------------------------------------------------------------------------------------------


def test_labels_are_in_the_fixed_or_in_the_robot_frame(tmp_path):
    moving = feature("b", AWAY, frame_id="base_link", start=1, end=2)
    labels = read_labels(write(tmp_path, feature("a"), moving))
    require_frames(labels, "base_link", "map")
    with pytest.raises(LabelError, match="label a is in the frame 'map', but the log is read in 'odom'"):
        require_frames(labels, "base_link", "odom")
    with pytest.raises(LabelError, match="label a is in the frame 'map'"):
        require_frames(labels, "base_link", None)


@pytest.mark.parametrize("times", [{}, {"start": 1}, {"end": 1}])
def test_labels_in_the_robot_frame_need_times(tmp_path, times):
    labels = read_labels(write(tmp_path, feature("a", frame_id="base_link", **times)))
    with pytest.raises(LabelError, match="label a moves with the robot frame 'base_link'; give it `start`"):
        require_frames(labels, "base_link", "map")


# --- onto the plane ----------------------------------------------------------------------------------


def vectors(most):
    return st.tuples(*[st.floats(-most, most)] * 3)


POSES = st.builds(
    lambda translation, axis, w: Transform.of(translation, [*axis, w]),
    vectors(20),
    st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-3, 3)),
    st.floats(0.3, 1),
)
PLANES = st.builds(
    lambda a, b, d: Plane(*(np.array([a, b, 1.0]) / math.hypot(a, b, 1.0)).tolist(), d),
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
    st.floats(-2, 2),
)


def rotated_back(quaternion, vector):
    """A vector of the fixed frame in the robot frame: conj(q) v q by Hamilton's products, in scalars."""

    def times(p, q):
        (a, b, c, d), (e, f, g, h) = p, q
        return (
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        )

    x, y, z, w = quaternion
    return times(times((w, -x, -y, -z), (0.0, *vector)), (w, x, y, z))[1:]


def projected_by_hand(vertex, pose, plane):
    """A vertex (x, y, z or NaN) of the fixed frame on the plane, robot frame."""
    x, y, z = vertex
    flat = math.isnan(z)
    offset = [x - pose.translation[0], y - pose.translation[1], (0.0 if flat else z) - pose.translation[2]]
    p = rotated_back(pose.quaternion.tolist(), offset)
    normal = (plane.a, plane.b, plane.c)
    fall = rotated_back(pose.quaternion.tolist(), (0.0, 0.0, 1.0)) if flat else normal
    above = sum(n * value for n, value in zip(normal, p, strict=True)) + plane.d
    step = above / sum(n * value for n, value in zip(normal, fall, strict=True))
    landed = [value - step * along for value, along in zip(p, fall, strict=True)]
    assert sum(n * value for n, value in zip(normal, landed, strict=True)) == pytest.approx(
        -plane.d, abs=1e-9
    )
    return landed[:2]


@settings(RANDOM, max_examples=80)
@given(POSES, PLANES, st.lists(vectors(10), min_size=4, max_size=6), st.lists(st.booleans(), min_size=6))
def test_projection_is_what_scalars_say(pose, plane, vertices, flat):
    array = np.array(vertices)
    array[[index for index in range(len(array)) if flat[index]], 2] = math.nan
    found = on_plane(array, pose, plane)
    for vertex, landed in zip(array.tolist(), found.tolist(), strict=True):
        assert landed == pytest.approx(projected_by_hand(vertex, pose, plane), abs=1e-9)


def tilted(angle):
    """The plane z = x tan(angle)."""
    return Plane(-math.sin(angle), 0.0, math.cos(angle), 0.0)


def test_a_vertex_with_z_goes_along_the_planes_normal_one_without_along_the_frames_z():
    vertices = np.array([[2.0, 1.0, 0.0], [2.0, 1.0, math.nan]])
    found = on_plane(vertices, Transform.identity(), tilted(0.1))
    assert found[0].tolist() == pytest.approx([2.0 * math.cos(0.1) ** 2, 1.0])
    assert found[1].tolist() == pytest.approx([2.0, 1.0])


def test_without_z_a_robot_that_pitches_sees_a_label_along_the_fixed_frames_z():
    pitch = Transform.of([0, 0, 1], [0, math.sin(0.1), 0, math.cos(0.1)])  # nose down by 0.2 rad, 1 m up
    found = on_plane(np.array([[2.0, 0.5, math.nan]]), pitch, robot_plane(-1.0))
    # The plane is 1 m below the robot, along its own z; above fixed (2, 0.5) it has r along the robot's x.
    r = (2.0 + math.sin(0.2)) / math.cos(0.2)
    assert found[0].tolist() == pytest.approx([r, 0.5])


def given_label(**known):
    ring = np.array([[2, 0, 0], [4, 0, 0], [4, 1, 0], [2, 1, 0], [2, 0, 0]], dtype=float)
    return Label("a", "gap", "map", ((ring,),), **known)


def test_a_label_in_the_fixed_frame_comes_by_the_pose():
    pose = Transform.of([2, 0, 0], [0, 0, math.sqrt(0.5), math.sqrt(0.5)])  # to the left
    found = place(given_label(), pose, robot_plane(0.0), "base_link")
    assert found.bounds == pytest.approx((0.0, -2.0, 1.0, 0.0))


def test_a_label_in_the_robot_frame_needs_no_pose():
    pose = Transform.of([2, 0, 0], [0, 0, 1, 0])
    for known in (None, pose):
        found = place(given_label(start=1, end=2), known, robot_plane(0.0), "map")
        assert found.bounds == (2.0, 0.0, 4.0, 1.0)


def test_a_label_in_the_fixed_frame_needs_a_pose():
    with pytest.raises(LabelError, match="label a is in 'map', but the frame has no pose in it"):
        place(given_label(), None, robot_plane(0.0), "base_link")


def test_a_label_that_the_plane_turns_into_no_polygon_is_refused():
    ring = np.array([[2, 0, 0], [4, 0, 0], [4, 1, 50], [2, 1, 0], [2, 0, 0]], dtype=float)
    twisted = Label("a", "gap", "map", ((ring,),))
    assert place(twisted, Transform.identity(), robot_plane(0.0), "base_link").area == 2.0
    with pytest.raises(LabelError, match="label a: not a valid polygon when seen in the robot's plane"):
        place(twisted, Transform.identity(), tilted(-0.6), "base_link")


def test_holes_are_placed_too(tmp_path):
    hole = [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75], [0.25, 0.25]]
    (found,) = read_labels(write(tmp_path, feature(coordinates=[SQUARE[0], hole]))).labels
    pose = Transform.of([0.5, 0.5, 0.3], [0, 0, 0.6, 0.8])
    placed = place(found, pose, robot_plane(-0.3), "base_link")
    assert placed.area == pytest.approx(0.75)
    assert not placed.contains(shapely.Point(0, 0))


# --- crossing_yaw ------------------------------------------------------------------------------------


@settings(RANDOM, max_examples=50)
@given(st.floats(-3, 3), st.floats(-3, 3))
def test_crossing_yaw_turns_against_the_robots_heading(yaw, heading):
    pose = Transform.of([5, 6, 7], [0, 0, math.sin(heading / 2), math.cos(heading / 2)])
    found = crossing_yaw(given_label(crossing_yaw=yaw), pose, "base_link")
    assert math.cos(found) == pytest.approx(math.cos(yaw - heading), abs=1e-9)
    assert math.sin(found) == pytest.approx(math.sin(yaw - heading), abs=1e-9)


def test_crossing_yaw_in_the_robot_frame_or_without_a_pose_stays():
    pose = Transform.of([0, 0, 0], [0, 0, 0.6, 0.8])
    assert crossing_yaw(given_label(crossing_yaw=0.5), pose, "map") == 0.5
    assert crossing_yaw(given_label(crossing_yaw=0.5), None, "base_link") == 0.5
    assert crossing_yaw(given_label(), pose, "base_link") is None
