"""The detections format: what is written comes back equal; files of other programs; what is refused."""

import io
import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import NOTHING

import gapeval
from gapeval.detections import METHODS, Crossing, DetectedFrame, read_detections, write_detections
from gapeval.errors import DetectionsError
from gapeval.frame import Plane, PoseQuality, Transform, robot_plane

RANDOM = settings(deadline=None, derandomize=True, max_examples=60)
HEADER = {
    "frame_id": "base_link",
    "fixed_frame": "map",
    "log": {"name": "drive.mcap", "sha256": "ab" * 32},
    "configuration": {"id": "0123456789ab", "detector": {"k": 6}},
}
SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}


def refuse(token):
    raise AssertionError(f"{token} is no JSON")


def frame(stamp=1, polygons=(), crossings=None, **known):
    array = np.empty(len(polygons), dtype=object)
    array[:] = list(polygons)
    plane = robot_plane(-0.25)
    usual = {"pose": None, "plane": plane, "gap_plane": plane, "domain": None, "shadow": None}
    usual |= {"origin": (0.0, 0.0), "polygons": array}
    return DetectedFrame(stamp, crossings=crossings or [{} for _ in polygons], **(usual | known))


def written(frames, header=HEADER):
    file = io.StringIO()
    count = write_detections(file, header, frames)
    return file.getvalue(), count


def returned(tmp_path, frames, header=HEADER):
    path = tmp_path / "detections.geojson"
    path.write_text(written(frames, header)[0])
    return read_detections(path)


def assert_equal_geometry(one, other):
    """Equal floats, ring by ring."""
    assert one.geom_type == other.geom_type
    assert shapely.get_coordinates(one).tolist() == shapely.get_coordinates(other).tolist()
    assert shapely.to_wkb(one) == shapely.to_wkb(other)


def crossing(gap, method, number):
    spots = [(number + axis / 3, -number / 7, 0.1) for axis in range(3)]
    return Crossing(
        gap, method, number > 0, "" if number > 0 else "too_long", number / 3, -number, *spots, True
    )


# --- there and back ----------------------------------------------------------------------------------

NUMBERS = st.floats(-1e6, 1e6)
HOLED = shapely.Polygon(
    [(0, 0), (1 / 3, 0), (1 / 3, 1 / 7), (0, 1 / 7)], [[(0.1, 0.05), (0.2, 0.05), (0.2, 0.1), (0.1, 0.05)]]
)
TWO = shapely.MultiPolygon([HOLED, shapely.box(5, 5, 5 + 1e-9, 6)])
POLYGONS = [HOLED, TWO, shapely.box(-1 / 3, 2 / 3, 1e-7, 1e5)]


@settings(RANDOM)
@given(
    st.integers(0, 2**63 - 1),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(*[st.floats(-1, 1)] * 3, st.floats(0.1, 1)),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1), NUMBERS),
    st.tuples(NUMBERS, NUMBERS),
)
def test_numbers_of_a_frame_come_back_equal(tmp_path_factory, stamp, translation, rotation, plane, origin):
    pose = Transform.of(translation, rotation)
    *normal, d = plane
    plane = (*(number / math.hypot(*normal) for number in normal), d)
    given_frame = frame(stamp, pose=pose, plane=Plane(*plane), origin=origin, fallback="patch is tilted")
    path = tmp_path_factory.mktemp("detections") / "d.geojson"
    path.write_text(written([given_frame])[0])
    (found,) = read_detections(path).frames
    assert (found.stamp, found.plane, found.origin) == (stamp, Plane(*plane), origin)
    assert found.pose.translation.tolist() == pose.translation.tolist()
    assert found.pose.quaternion.tolist() == pose.quaternion.tolist()
    assert found.pose.matrix.tolist() == pose.matrix.tolist()
    assert found.fallback == "patch is tilted"


def test_pose_quality_and_weights_come_back_equal(tmp_path):
    """What is not known as null: NaN is no JSON."""
    quality = PoseQuality(0.1, 0.01, math.nan, 1e-9)
    sure = frame(7, POLYGONS[:2], quality=quality, weights=[0.25, None])
    text, _ = written([sure])
    assert json.loads(text, parse_constant=refuse)["frames"][0]["pose_quality"]["pitch"] is None
    first, second = returned(tmp_path, [sure, frame(8)]).frames
    assert repr(first.quality) == repr(quality)
    assert list(first.weights) == [0.25, None]
    assert (second.quality, list(second.weights)) == (None, [])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pose_quality": {"roll": -1}}, "frame 0: pose_quality .* 0 or more"),
        ({"pose_quality": {"gap": "soon"}}, "frame 0: could not convert"),
        ({"pose_quality": {"gap": [1]}}, "frame 0: float"),
        ({"pose_quality": [0, 0]}, "frame 0"),
    ],
)
def test_a_pose_quality_that_is_none_is_refused(tmp_path, change, message):
    document = json.loads(written([frame(1, POLYGONS[:1])])[0])
    document["frames"][0] |= change
    path = tmp_path / "d.geojson"
    path.write_text(json.dumps(document))
    with pytest.raises(DetectionsError, match=message):
        read_detections(path)


def test_a_weight_that_is_no_probability_is_refused(tmp_path):
    document = json.loads(written([frame(1, POLYGONS[:1])])[0])
    path = tmp_path / "d.geojson"
    for weight in (1.5, -0.1, "much"):
        document["features"][0]["properties"]["weight"] = weight
        path.write_text(json.dumps(document))
        with pytest.raises(DetectionsError, match="frame 0"):
            read_detections(path)


def test_polygons_with_holes_and_parts_come_back_equal(tmp_path):
    found = returned(tmp_path, [frame(7, POLYGONS, domain=HOLED, shadow=TWO), frame(8, POLYGONS[:1])])
    assert found.repaired == 0
    first, second = found.frames
    for one, other in zip(first.polygons, POLYGONS, strict=True):
        assert_equal_geometry(one, other)
    assert_equal_geometry(second.polygons[0], HOLED)
    assert_equal_geometry(first.domain, HOLED)
    assert_equal_geometry(first.shadow, TWO)
    assert (second.domain, second.shadow) == (None, None)


@settings(RANDOM)
@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=3, max_size=3, unique=True))
def test_any_triangle_comes_back_equal(tmp_path_factory, places):
    triangle = shapely.Polygon(places)
    if not triangle.is_valid:
        return
    path = tmp_path_factory.mktemp("detections") / "d.geojson"
    path.write_text(written([frame(1, [triangle])])[0])
    assert_equal_geometry(read_detections(path).frames[0].polygons[0], triangle)


def test_an_empty_shadow_is_an_empty_shadow_not_an_unknown_one(tmp_path):
    (found,) = returned(tmp_path, [frame(shadow=NOTHING, domain=shapely.Polygon())]).frames
    assert found.shadow.is_empty
    assert found.domain.is_empty


def test_crossings_come_back_equal(tmp_path):
    crossings = [
        {"npca": crossing(0, "npca", 0.1), "pca": crossing(0, "pca", -0.2)},
        {"pca": crossing(1, "pca", 3.0)},
        {},
    ]
    (found,) = returned(tmp_path, [frame(1, POLYGONS, crossings)]).frames
    assert list(found.crossings) == crossings


def test_the_header_comes_back(tmp_path):
    found = returned(tmp_path, [])
    assert (found.robot_frame, found.fixed_frame, found.frames) == ("base_link", "map", ())
    assert (found.log, found.log_sha256) == ("drive.mcap", "ab" * 32)
    assert found.configuration == HEADER["configuration"]
    without = returned(tmp_path, [], HEADER | {"fixed_frame": None})
    assert without.fixed_frame is None


def test_the_file_is_strict_json_as_documented():
    tilted = Plane(0.6, 0.0, 0.8, -0.5)
    crossings = [{method: crossing(0, method, 1.5) for method in METHODS}]
    whole = frame(
        2**62 + 1,
        [HOLED],
        crossings,
        gap_plane=tilted,
        pose=Transform.of([1, 2, 3], [0, 0, 0.6, 0.8]),
        shadow=NOTHING,
        domain=HOLED,
    )
    text, count = written([whole, frame(5)])
    assert count == 1
    document = json.loads(text, parse_constant=refuse)
    assert set(document) == {
        *("type", "frames", "frame_id", "fixed_frame", "log", "configuration", "gapeval", "features")
    }
    assert document["gapeval"] == gapeval.__version__
    assert document["frames"][0]["stamp"] == str(2**62 + 1)
    assert document["frames"][0]["plane"] == [0.0, 0.0, 1.0, 0.25]
    assert document["frames"][0]["pose"] == {"translation": [1, 2, 3], "rotation": [0, 0, 0.6, 0.8]}
    assert document["frames"][0]["shadow"] == {"type": "MultiPolygon", "coordinates": []}
    assert document["frames"][1]["domain"] is None
    (gap,) = document["features"]
    names = ["traversable", "reason", "length", "yaw", "centre", "start", "end", "tie"]
    expected = {"stamp", "gap", "area", "weight"} | {
        f"{method}_{name}" for method in METHODS for name in names
    }
    assert set(gap["properties"]) == expected
    assert (gap["properties"]["stamp"], gap["properties"]["gap"]) == (str(2**62 + 1), 0)
    assert gap["properties"]["area"] == HOLED.area
    ring = gap["geometry"]["coordinates"][0]
    for x, _, z in ring:
        assert 0.6 * x + 0.8 * z - 0.5 == pytest.approx(0, abs=1e-12)  # on the gaps' own plane


def test_frames_are_read_in_the_order_of_stamps_and_gaps_by_index(tmp_path):
    document = json.loads(written([frame(9, POLYGONS), frame(3)])[0])
    document["features"].reverse()
    path = tmp_path / "d.geojson"
    path.write_text(json.dumps(document))
    found = read_detections(path).frames
    assert [one.stamp for one in found] == [3, 9]
    for one, other in zip(found[1].polygons, POLYGONS, strict=True):
        assert_equal_geometry(one, other)


# --- files of other programs -------------------------------------------------------------------------


def foreign(tmp_path, **changes):
    path = tmp_path / "theirs.geojson"
    feature = {"type": "Feature", "properties": {"stamp": "1"}, "geometry": SQUARE}
    document = {"type": "FeatureCollection", "frame_id": "base_link", "frames": [{"stamp": "1"}]}
    path.write_text(json.dumps(document | {"features": [feature]} | changes))
    return path


def with_geometry(*geometries):
    return [{"properties": {"stamp": "1"}, "geometry": geometry} for geometry in geometries]


def test_the_least_that_a_file_must_say(tmp_path):
    found = read_detections(foreign(tmp_path))
    (one,) = found.frames
    assert (found.log, found.log_sha256, found.configuration, found.fixed_frame) == ("theirs", "", None, None)
    assert (one.pose, one.domain, one.shadow, one.origin) == (None, None, None, (0.0, 0.0))
    assert (one.plane.distance(np.array([0.0, 0.0, 2.0])), one.plane.c) == (2.0, 1.0)
    assert list(one.crossings) == [{}]
    assert one.polygons[0].area == 1.0


def test_a_file_without_features_has_no_gaps(tmp_path):
    path = tmp_path / "d.geojson"
    path.write_text('{"type": "FeatureCollection", "frame_id": "base_link", "frames": [{"stamp": 4}]}')
    (one,) = read_detections(path).frames
    assert (one.stamp, len(one.polygons)) == (4, 0)


def test_a_leading_slash_of_a_frame_is_no_part_of_its_name(tmp_path):
    found = read_detections(foreign(tmp_path, frame_id="/base_link", fixed_frame="/map"))
    assert (found.robot_frame, found.fixed_frame) == ("base_link", "map")


def test_a_rotation_is_normalised(tmp_path):
    pose = {"translation": [0, 0, 0], "rotation": [0, 0, 3, 4]}
    (one,) = read_detections(foreign(tmp_path, frames=[{"stamp": 1, "pose": pose}])).frames
    assert one.pose.quaternion.tolist() == pytest.approx([0, 0, 0.6, 0.8])


@pytest.mark.parametrize("plane", [[0, 0, 2, -1], [0, 0, -1, 0.5], [0, 0, -4.0, 2]])
def test_a_plane_is_brought_to_unit_length_and_upright(tmp_path, plane):
    (one,) = read_detections(foreign(tmp_path, frames=[{"stamp": 1, "plane": plane}])).frames
    assert one.plane == Plane(0.0, 0.0, 1.0, -0.5)


def test_vertices_may_have_a_z(tmp_path):
    raised = {"type": "Polygon", "coordinates": [[[0, 0, 5], [2, 0, 5], [2, 1, 5], [0, 0, 5]]]}
    (one,) = read_detections(foreign(tmp_path, features=with_geometry(raised))).frames
    assert not one.polygons[0].has_z
    assert one.polygons[0].area == 1.0


def test_a_crossing_of_which_not_enough_is_said_is_left_out(tmp_path):
    known = {"npca_traversable": True, "npca_length": 2, "npca_yaw": 0.5, "pca_traversable": False}
    features = [{"properties": {"stamp": 1} | known, "geometry": SQUARE}]
    (one,) = read_detections(foreign(tmp_path, features=features)).frames
    (found,) = one.crossings
    assert list(found) == ["npca"]
    assert (found["npca"].traversable, found["npca"].length, found["npca"].yaw) == (True, 2.0, 0.5)


def test_invalid_polygons_are_repaired_and_counted(tmp_path):
    bow_tie = {"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]}
    found = read_detections(foreign(tmp_path, features=with_geometry(bow_tie, SQUARE, bow_tie)))
    assert found.repaired == 2
    assert [polygon.area for polygon in found.frames[0].polygons] == [0.5, 1.0, 0.5]
    assert shapely.is_valid(found.frames[0].polygons).all()


@pytest.mark.parametrize("key", ["domain", "shadow"])
def test_an_invalid_domain_or_shadow_is_mended_or_refused(tmp_path, key):
    bow_tie = {"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]}
    path = foreign(tmp_path, frames=[{"stamp": 1, key: bow_tie}])
    try:
        found = getattr(read_detections(path).frames[0], key)
    except DetectionsError:
        return
    assert found.is_valid


# --- what is refused ---------------------------------------------------------------------------------


def frames_with(**known):
    return {"frames": [{"stamp": "1"} | known]}


def features_with(geometry=SQUARE, **properties):
    return {"features": [{"properties": {"stamp": "1"} | properties, "geometry": geometry}]}


CROSSED = {"npca_traversable": True, "npca_length": 1, "npca_yaw": 0}
NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"type": "Feature"}, "FeatureCollection"),
        ({"frames": None}, "no `frames`"),
        ({"frames": {"1": {}}}, "no `frames`"),
        ({"frames": [5]}, "frame 0"),
        ({"frames": [{}]}, "frame 0: no 'stamp'"),
        ({"frames": [{"stamp": "2"}]}, "gaps at stamp 1, which is not among its `frames`"),
        ({"frame_id": None}, "no `frame_id`"),
        ({"features": None}, "features"),
        ({"features": [None]}, "feature 0"),
        ({"features": [{}]}, "feature 0: no 'properties'"),
        ({"features": [{"properties": {}}]}, "feature 0: no 'stamp'"),
        ({"features": [{"properties": {"stamp": "1"}}]}, "no 'geometry'"),
        (frames_with(stamp="soon"), "frame 0"),
        (frames_with(stamp=None), "frame 0"),
        (frames_with(stamp=INF), "frame 0"),
        (frames_with(plane=[0, 0, 1]), "frame 0"),
        (frames_with(plane=[0, 0, 0, 0]), "frame 0"),
        (frames_with(plane=[0, 0, NAN, 0]), "frame 0"),
        (frames_with(plane="flat"), "frame 0"),
        (frames_with(pose=[1, 2, 3]), "frame 0"),
        (frames_with(pose={"translation": [0, 0, 0]}), "frame 0: no 'rotation'"),
        (frames_with(pose={"translation": [0, 0], "rotation": [0, 0, 0, 1]}), "frame 0"),
        (
            frames_with(pose={"translation": [0, 0, 0], "rotation": [0, 0, 0, 0]}),
            "quaternion other than zero",
        ),
        (frames_with(pose={"translation": [0, 0, NAN], "rotation": [0, 0, 0, 1]}), "finite"),
        (frames_with(sensor=[1]), "frame 0"),
        (frames_with(sensor=[1, NAN]), "frame 0"),
        (frames_with(domain=5), "frame 0"),
        (frames_with(domain={"type": "Point", "coordinates": [0, 0]}), "expected Polygon or MultiPolygon"),
        (features_with(None), "frame 0"),
        (features_with({"type": "Point", "coordinates": [0, 0]}), "expected Polygon or MultiPolygon"),
        (features_with({"type": "Polygon"}), "no 'coordinates'"),
        (features_with({"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}), "frame 0"),
        (features_with({"type": "Polygon", "coordinates": [[[0, 0], [1], [1, 1], [0, 0]]]}), "frame 0"),
        (features_with({"type": "Polygon", "coordinates": [[[0, 0], [NAN, 0], [1, 1], [0, 0]]]}), "finite"),
        (
            features_with({"type": "Polygon", "coordinates": [[["a", 0], [1, 0], [1, 1], ["a", 0]]]}),
            "frame 0",
        ),
        (features_with(**CROSSED | {"npca_length": "long"}), "frame 0"),
        (features_with(**CROSSED | {"npca_start": [1, 2]}), "frame 0"),
    ],
)
def test_what_is_refused_is_refused_in_one_line(tmp_path, changes, place):
    path = foreign(tmp_path, **changes)
    with pytest.raises(DetectionsError) as caught:
        read_detections(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert place in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\x00", b"[" * 100_000, b"[]", b"5"])
def test_what_is_no_geojson_is_refused(tmp_path, content):
    path = tmp_path / "d.geojson"
    path.write_bytes(content)
    with pytest.raises(DetectionsError) as caught:
        read_detections(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "GeoJSON" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(DetectionsError) as caught:
        read_detections(tmp_path / "none.geojson")
    assert str(caught.value) == f"{tmp_path / 'none.geojson'}: cannot be read: No such file or directory"


def test_a_frame_may_be_there_once_only(tmp_path):
    path = foreign(tmp_path, frames=[{"stamp": "1"}, {"stamp": 1}])
    with pytest.raises(DetectionsError, match="frame 1"):
        read_detections(path)


def test_the_ten_numbers_of_a_crossing():
    good, bad = crossing(0, "npca", 1.0), crossing(0, "npca", -1.0)
    assert good.t_j == (1.0, *good.centre, *good.start, *good.end)
    assert bad.t_j == (0.0,) * 10
