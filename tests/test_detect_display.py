"""detect --mcap: read back by mcap and rosbags, held against the GeoJSON of the same run."""

import itertools
import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import shapely
from command import gapeval
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from small_logs import drive, feature, labels, trench_ring

from gapeval.config import BodyBox, Configuration, Detector, LogSection, Robot
from gapeval.detection import detect
from gapeval.detection.classes import BELOW, CLASS_NAMES, GROUND, OBSTACLE, OUTSIDE, point_classes
from gapeval.errors import GapevalError
from gapeval.frame import Frame, Transform
from gapeval.logs.read import read_frames, read_recording
from gapeval.logs.write.display import Markers, display
from gapeval.results.to_markers import edges, triangles

OPTIONS = ("-p", "pl_th=0.2", "-p", "n_o=0", "-p", "r_max=4")
TOPICS = {
    "/gapeval/gaps": "visualization_msgs/msg/MarkerArray",
    "/gapeval/points": "sensor_msgs/msg/PointCloud2",
}
TOPICS |= dict.fromkeys(("/gapeval/crossings", "/gapeval/labels"), "visualization_msgs/msg/MarkerArray")


class Made:
    """A log, its detections and what is shown of them."""

    def __init__(self, folder: Path) -> None:
        self.log = drive(folder / "drive.mcap", 3)
        drawn = [
            feature(trench_ring()),
            feature([[2.5, -5, 0.3], [3, -5, 0.3], [3, -4, 0.3], [2.5, -5, 0.3]], id="far"),
            feature([[3.0, 0.0], [3.2, 0.0], [3.2, 0.2], [3.0, 0.0]], id="not now", start="1", end="2"),
        ]
        self.labels = labels(folder / "labels.geojson", drawn)
        self.geojson, self.mcap = folder / "d.geojson", folder / "d.mcap"
        done = gapeval(
            "detect", self.log, "-o", self.geojson, "--mcap", self.mcap, "--labels", self.labels, *OPTIONS
        )
        assert done.status == 0, done.err
        self.said = done.err
        self.document = json.loads(self.geojson.read_text())
        self.shown = {}
        with AnyReader([self.mcap]) as reader:
            for connection, stamp, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                self.shown.setdefault(connection.topic, {})[stamp] = message

    def gaps(self, stamp):
        return [one for one in self.document["features"] if one["properties"]["stamp"] == str(stamp)]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return Made(tmp_path_factory.mktemp("display"))


def of_kind(message, group):
    return {marker.id: marker for marker in message.markers if marker.ns == group}


def places(points):
    return np.array([(point.x, point.y, point.z) for point in points]).reshape(-1, 3)


def rings_of(geometry):
    polygons = [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    return [ring for polygon in polygons for ring in polygon]


def sides(rings):
    """Each edge, in whichever direction."""
    return Counter(frozenset(map(tuple, pair)) for ring in rings for pair in itertools.pairwise(ring))


def is_green(marker):
    return marker.color.g > marker.color.r


# --- the file ----------------------------------------------------------------------------------------


def test_the_file_is_what_players_and_viewers_expect(made):
    with made.mcap.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert (reader.get_header().profile, reader.get_header().library) == ("ros2", "gapeval detect")
        summary = reader.get_summary()
        assert {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()} == TOPICS
        for channel in summary.channels.values():
            assert (channel.message_encoding, channel.metadata) == ("cdr", {"offered_qos_profiles": ""})
            assert summary.schemas[channel.schema_id].encoding == "ros2msg"
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        messages = list(reader.iter_messages())
    stamps = [int(frame["stamp"]) for frame in made.document["frames"]]
    assert Counter(message.log_time for _, _, message in messages) == dict.fromkeys(stamps, 4)
    assert all(message.publish_time == message.log_time for _, _, message in messages)


def test_everything_is_stamped_as_its_frame(made):
    for topic, by_stamp in made.shown.items():
        for stamp, message in by_stamp.items():
            parts = [message] if topic == "/gapeval/points" else message.markers
            for part in parts:
                assert part.header.stamp.sec * 10**9 + part.header.stamp.nanosec == stamp
                assert part.header.frame_id == ("map" if part_is_label(topic, part) else "base_link")


def part_is_label(topic, part):
    return topic == "/gapeval/labels" and part.action == 0


def test_what_was_shown_before_goes(made):
    for topic in TOPICS.keys() - {"/gapeval/points"}:
        for message in made.shown[topic].values():
            assert [marker.action for marker in message.markers].index(3) == 0
            assert {marker.action for marker in message.markers[1:]} <= {0}


def test_the_same_log_gives_the_same_bytes(made, tmp_path):
    again = tmp_path / "again.mcap"
    assert gapeval("detect", made.log, "--mcap", again, "--labels", made.labels, *OPTIONS).status == 0
    assert again.read_bytes() == made.mcap.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == ["again.mcap"]


def test_info_reads_it(made):
    found = gapeval("info", made.mcap)
    assert "/gapeval/points" in found.out
    assert "frame base_link" in found.out


# --- gaps and crossings ------------------------------------------------------------------------------


def test_outlines_and_areas_are_those_of_the_detections(made):
    assert made.document["features"]
    for stamp, message in made.shown["/gapeval/gaps"].items():
        outlines, areas, texts = (of_kind(message, group) for group in ("outline", "area", "text"))
        gaps = made.gaps(stamp)
        assert outlines.keys() == areas.keys() == texts.keys() == set(range(len(gaps)))
        for gap in gaps:
            number, rings = gap["properties"]["gap"], rings_of(gap["geometry"])
            lines = places(outlines[number].points)
            assert (outlines[number].type, areas[number].type, texts[number].type) == (5, 11, 9)
            assert sides(lines.reshape(-1, 2, 3).tolist()) == sides(rings)
            polygon = shapely.force_2d(shapely.geometry.shape(gap["geometry"]))
            corners = places(areas[number].points)
            made_up = shapely.union_all(shapely.polygons(corners[:, :2].reshape(-1, 3, 2)))
            assert made_up.symmetric_difference(polygon).area < 1e-6
            assert np.allclose(corners[:, 2], rings[0][0][2], atol=1e-12)  # the plane of the robot is level
            assert f"{gap['properties']['area']:.2f} m2" in texts[number].text
            spot = texts[number].pose.position
            assert polygon.contains(shapely.Point(spot.x, spot.y))
            assert is_green(outlines[number]) == gap["properties"]["npca_traversable"]
            assert 0 < areas[number].color.a < outlines[number].color.a == 1


def test_crossings_lead_from_start_to_end(made):
    verdicts = set()
    for stamp, message in made.shown["/gapeval/crossings"].items():
        for method in ("npca", "pca"):
            arrows = of_kind(message, method)
            assert len(arrows) == len(made.gaps(stamp))
            for gap in made.gaps(stamp):
                known, arrow = gap["properties"], arrows[gap["properties"]["gap"]]
                assert arrow.type == 0
                ends = [known[f"{method}_start"], known[f"{method}_end"]]
                assert places(arrow.points).tolist() == ends
                assert is_green(arrow) == known[f"{method}_traversable"]
                verdicts.add(known[f"{method}_traversable"])
    assert False in verdicts


def test_labels_are_drawn_where_they_are_and_coloured_by_what_became_of_them(made):
    """In their own frame; without z, on the ground. Not now: those that do not hold."""
    for message in made.shown["/gapeval/labels"].values():
        outlines = of_kind(message, "outline")
        texts = of_kind(message, "text")
        assert [texts[number].text for number in sorted(texts)] == ["trench", "far"]
        assert sides(places(outlines[0].points).reshape(-1, 2, 3).tolist()) == sides([trench_ring()])
        assert places(outlines[1].points)[:, 2].tolist() == [0.3] * 6
        assert outlines[1].color.r == outlines[1].color.g == outlines[1].color.b  # never asked for
        assert is_green(outlines[0])  # hit


def test_a_label_without_height_lies_on_the_ground(tmp_path):
    log = drive(tmp_path / "drive.mcap", 1)
    ring = [vertex[:2] for vertex in trench_ring()]
    drawn = labels(tmp_path / "labels.geojson", [feature(ring)])
    made = tmp_path / "d.mcap"
    options = (*OPTIONS, "-p", "robot.ground_z=-0.25")
    assert gapeval("detect", log, "--mcap", made, "--labels", drawn, *options).status == 0
    with AnyReader([made]) as reader:
        (message,) = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == "/gapeval/labels"
        ]
    heights = places(of_kind(message, "outline")[0].points)[:, 2]
    assert heights == pytest.approx([-0.25] * 8, abs=1e-9)


# --- fills -------------------------------------------------------------------------------------------


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(0, 6))
def test_triangles_cover_the_polygon_and_not_its_holes(seed, parts, holes):
    rng = np.random.default_rng(seed)

    def blob():
        angle = np.sort(rng.uniform(0, 2 * math.pi, rng.integers(3, 30)))
        r = rng.uniform(0.2, 1.5, len(angle))
        shape = np.column_stack([r * np.cos(angle), r * np.sin(angle)]) + rng.uniform(-2, 2, 2)
        return shapely.Polygon(shape).buffer(0)

    polygon = shapely.union_all([blob() for _ in range(parts)])
    polygon = polygon.difference(shapely.union_all([blob().buffer(-0.1) for _ in range(holes)]))
    assume(polygon.area > 1e-3)
    corners = triangles(polygon).reshape(-1, 3, 2)
    areas = shapely.area(shapely.polygons(corners))
    assert areas.sum() == pytest.approx(polygon.area, abs=1e-6)
    assert shapely.union_all(shapely.polygons(corners)).symmetric_difference(polygon).area < 1e-6
    along, aside = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    assert (along[:, 0] * aside[:, 1] - along[:, 1] * aside[:, 0] >= 0).all()  # their fronts are up
    length = np.hypot(*(edges(polygon)[1::2] - edges(polygon)[::2]).T).sum()
    assert length == pytest.approx(polygon.length, rel=1e-9)


# --- points ------------------------------------------------------------------------------------------


def test_all_points_are_there_with_their_class(made):
    recording = read_recording(made.log, LogSection())
    for frame in read_frames(recording, 0, 3):
        message = made.shown["/gapeval/points"][frame.stamp]
        assert [(field.name, field.offset, field.datatype) for field in message.fields] == [
            *(("x", 0, 7), ("y", 4, 7), ("z", 8, 7)),
            *(("rgb", 12, 6), ("class", 16, 2)),
        ]
        kind = [("xyz", "<f4", 3), ("rgb", "<u4"), ("class", "u1")]
        rows = np.frombuffer(message.data.tobytes(), kind)
        assert np.array_equal(rows["xyz"], frame.points)
        config = Configuration(detector=Detector(pl_th=0.2, n_o=0, r_max=4))
        assert rows["class"].tolist() == naive_classes(frame, config)
        assert {GROUND, OBSTACLE, OUTSIDE} == set(rows["class"].tolist())
        assert len(set(zip(rows["rgb"].tolist(), rows["class"].tolist(), strict=True))) == 3  # a colour each


def naive_classes(frame, configuration):
    """For the robot's own plane, point by point."""
    params, robot, found = configuration.detector, configuration.robot, []
    origin = frame.sensor.translation[:2] if params.origin == "sensor" else (0.0, 0.0)
    for x, y, z in frame.points.astype(float).tolist():
        t = z - robot.ground_z
        kind = OBSTACLE if t > params.pl_th else BELOW if t < -params.pl_th else GROUND
        outside = x < params.x_min or math.dist((x, y), origin) >= params.r_max
        outside |= z < -params.z_min or z > params.z_max
        if robot.body is not None:
            sides = zip((x, y, z), (robot.body.x, robot.body.y, robot.body.z), strict=True)
            outside |= all(low <= value <= high for value, (low, high) in sides)
        found.append(OUTSIDE if outside else kind)
    return found


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["sensor", "robot"]),
    st.booleans(),
    st.sampled_from([0.4, math.inf]),
)
def test_classes_are_the_naive_ones(seed, origin, with_body, z_min):
    points = np.random.default_rng(seed).uniform((-4, -4, -1), (4, 4, 3), (300, 3)).astype(np.float32)
    body = BodyBox(x=(-1, 1.5), y=(-0.8, 0.8), z=(-1, 1)) if with_body else None
    config = Configuration(
        detector=Detector(k=3, origin=origin, z_min=z_min, pl_th=0.3), robot=Robot(ground_z=-0.125, body=body)
    )
    frame = Frame(0, points, Transform.of([0.3, 0.1, 0.5], [0, 0, 0, 1]))
    found = point_classes(frame, detect(frame, config), config)
    assert found.tolist() == naive_classes(frame, config)
    assert found.dtype == np.uint8
    assert len(CLASS_NAMES) == 4


# --- what goes wrong ---------------------------------------------------------------------------------


@pytest.mark.parametrize("taken", ["drive.mcap", "labels.geojson", "simulated.mcap", "folder"])
def test_nothing_else_is_replaced(tmp_path, taken):
    log = drive(tmp_path / "drive.mcap", 1)
    labels(tmp_path / "labels.geojson")
    (tmp_path / "folder").mkdir()
    assert (
        gapeval("simulate", "plain", "--sensor", "vlp16", "--frames", 1, "-o", tmp_path / "made").status == 0
    )
    (tmp_path / "made" / "plain.mcap").rename(tmp_path / "simulated.mcap")
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    done = gapeval("detect", log, "--mcap", tmp_path / taken)
    assert done.status == 1
    assert f"{taken}: " in done.last_line
    assert "name a" in done.last_line
    assert before == {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}


def test_its_own_product_is_replaced(tmp_path):
    log, out = drive(tmp_path / "drive.mcap", 2), tmp_path / "new" / "d.mcap"
    assert gapeval("detect", log, "--mcap", out).status == 0
    first = out.read_bytes()
    assert gapeval("detect", log, "--mcap", out, *OPTIONS).status == 0
    assert out.read_bytes() != first


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ((), "nothing to write; name -o FILE, --mcap FILE, or both"),
        (("-o", "a", "--mcap", "a"), "one is named twice"),
        (("-o", "a", "--labels", "l"), "--labels are drawn in --picture FILE or --mcap FILE"),
    ],
)
def test_options_that_do_not_go_together(tmp_path, options, line):
    done = gapeval("detect", tmp_path / "drive.mcap", *options)
    assert (done.status, line in done.last_line) == (2, True)


def begin(path):
    with display(path) as show:
        show(Markers(5, "/gapeval/gaps", "base_link", []))
        raise KeyError("half")


def test_half_a_file_is_none(tmp_path):
    path = tmp_path / "d.mcap"
    with pytest.raises(KeyError, match="half"):
        begin(path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(GapevalError, match="cannot be written"), display(tmp_path / "no" / "d.mcap"):
        pass


def test_frames_without_gaps_clear_what_was_shown(tmp_path):
    log, out = drive(tmp_path / "drive.mcap", 1), tmp_path / "d.mcap"
    assert gapeval("detect", log, "--mcap", out, "-p", "n_o=20").status == 0
    with AnyReader([out]) as reader:
        sizes = {
            connection.topic: len(reader.deserialize(raw, connection.msgtype).markers)
            for connection, _, raw in reader.messages()
            if connection.topic != "/gapeval/points"
        }
    assert sizes == {"/gapeval/gaps": 1, "/gapeval/crossings": 1}
