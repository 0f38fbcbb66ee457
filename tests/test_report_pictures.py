"""gapeval detect --picture and --stages: what is drawn is what was found."""

from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest
import shapely
from command import gapeval
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from small_logs import cloud, drive, drive_with, feature, labels, stamps, trench_ring

from gapeval.config import Configuration, LogSection
from gapeval.detection.grid import midpoints, row_edges
from gapeval.labels import read_labels
from gapeval.logs.read import read_recording
from gapeval.report.pictures import Findings, draw_frame, draw_stages, findings, png
from gapeval.report.pictures.colours import FILLS, gap_colours
from gapeval.report.pictures.crossings import WORDED
from gapeval.report.pictures.file import PNG
from gapeval.report.pictures.found import GAP, OBSTACLE, OPENED, SHADED, UNSEEN
from gapeval.report.pictures.from_above import outline
from gapeval.report.pictures.stages import contour_lines
from gapeval.report.pictures.words import CROWD
from gapeval.results.to_detections import one_frame

FINE = {"detector": {"delta_r": 1.05, "r_max": 4.0}, "crossing": {"d_r": 1.0}}
CROWDED = {"detector": {"delta_r": 1.03, "r_max": 4.0, "n_o": 0, "k": 7}}


def found_in(log: Path, values: object = FINE, number: int = 0, drawn: Path | None = None) -> Findings:
    recording = read_recording(log, LogSection())
    configuration = Configuration.model_validate(values)
    frame = one_frame(recording, number)
    known = read_labels(drawn) if drawn else None
    return findings(log.name, number, frame, configuration, known, recording.robot_frame)


def walled(path: Path) -> Path:
    """The drive's first cloud, with a wall that hides what is behind it, and a pit 0.4 m deep."""
    points = cloud(0)
    x, y, z = points.T
    hidden = (x > 1.5) & (y > 1.2 * x / 1.5) & (y < 2.0 * x / 1.5)
    wall = np.array(
        [(1.5, side, up) for side in np.arange(1.2, 2.0, 0.02) for up in np.arange(-1.0, 0.0, 0.1)]
    )
    points[(np.abs(x - 1.2) < 0.2) & (y < -1.0) & (y > -1.6) & (z < 0), 2] -= 0.4
    return drive_with(path, [(stamps(1)[0], np.vstack([points[~hidden], wall]).astype(np.float32))])


def artist(figure: Figure, gid: str):  # type: ignore[no-untyped-def]
    (one,) = figure.findobj(lambda each: each.get_gid() == gid)
    return one


def ground(figure: Figure) -> Axes:
    return figure.axes[0]


def words(figure: Figure) -> list[Annotation]:
    return [text for text in ground(figure).texts if isinstance(text, Annotation)]


def turned(polygon: shapely.Geometry) -> set[tuple[float, float]]:
    """The vertices of a polygon as the picture has them: y to the left, x upwards."""
    return {(y, x) for x, y in shapely.get_coordinates(polygon).tolist()}


def vertices(patch) -> set[tuple[float, float]]:  # type: ignore[no-untyped-def]
    return {(y, x) for y, x in patch.get_path().vertices.tolist()}


# Through the command line.


def test_both_pictures_are_written_beside_the_detections(tmp_path: Path) -> None:
    log, drawn = drive(tmp_path / "drive.mcap", 3), labels(tmp_path / "labels.geojson")
    options = ("-p", "delta_r=1.05")
    assert gapeval("detect", log, "-o", tmp_path / "plain.geojson", *options).status == 0
    asked = ("--picture", tmp_path / "out/frame.png", "--stages", tmp_path / "out/stages.png")
    done = gapeval("detect", log, "-o", tmp_path / "a.geojson", *options, *asked, "--labels", drawn)
    assert done.status == 0, done.err
    assert done.err.splitlines()[-2:] == [
        f"wrote {tmp_path / 'out' / name}.png" for name in ("frame", "stages")
    ]
    assert (tmp_path / "a.geojson").read_bytes() == (tmp_path / "plain.geojson").read_bytes()
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["frame.png", "stages.png"]
    for name in ("frame", "stages"):
        assert (tmp_path / f"out/{name}.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
        height, width, _ = cv2.imread(str(tmp_path / f"out/{name}.png")).shape
        assert 1000 < width < 2500
        assert 700 < height < 2000


def test_the_same_frame_gives_the_same_bytes_and_another_frame_others(tmp_path: Path) -> None:
    log = drive(tmp_path / "drive.mcap", 3)
    content = {}
    for name, options in {"default": (), "first": ("--frame", 0), "last": ("--frame", 2)}.items():
        path = tmp_path / "frame.png"  # written over: it is a picture
        assert gapeval("detect", log, "-o", tmp_path / "a.geojson", "--picture", path, *options).status == 0
        content[name] = path.read_bytes()
    assert content["default"] == content["first"]
    assert content["first"] != content["last"]
    assert b"Software" not in content["first"]


def test_the_users_matplotlibrc_changes_nothing(tmp_path: Path) -> None:
    found = found_in(drive(tmp_path / "drive.mcap", 1))
    usual = [png(draw(found)) for draw in (draw_frame, draw_stages)]
    with matplotlib.rc_context(
        {"font.size": 22, "axes.grid": True, "image.origin": "upper", "lines.marker": "x"}
    ):
        assert [png(draw(found)) for draw in (draw_frame, draw_stages)] == usual
        assert matplotlib.rcParams["font.size"] == 22


@pytest.mark.parametrize(
    ("options", "status", "line"),
    [
        (
            ("--picture", "out/frame.png", "--frame", 3),
            2,
            "no frame 3: the log has 3; choose --frame from 0 to 2",
        ),
        (("--picture", "out/frame.png", "--frame", -1), 2, "--frame"),
        (("--frame", 1), 2, "--frame is the frame to draw; name --picture FILE or --stages FILE"),
        (("--labels", "labels.geojson"), 2, "--labels are drawn in --picture FILE"),
        (("--stages", "out/s.png", "--labels", "labels.geojson"), 2, "--labels are drawn in --picture FILE"),
        (("--picture", "out/one.png", "--stages", "out/one.png"), 2, "one is named twice"),
        (("--picture", "out/found.geojson"), 2, "one is named twice"),
        (("--picture", "drive.mcap"), 1, "drive.mcap: exists and is no PNG picture; name another file"),
        (("--stages", "labels.geojson"), 1, "labels.geojson: exists and is no PNG picture"),
        (("--stages", "folder"), 1, "folder: is a folder; name a file"),
        (("--picture", "drive.mcap/frame.png"), 1, "drive.mcap: cannot write here"),
        (("--picture", "out/frame.png", "--labels", "mars.geojson"), 1, "'mars'"),
        (("--picture", "out/frame.png", "--labels", "no.geojson"), 1, "no.geojson: cannot be read"),
    ],
)
def test_errors(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[object, ...],
    status: int,
    line: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    drive(Path("drive.mcap"), 3)
    labels(Path("labels.geojson"))
    labels(Path("mars.geojson"), frame_id="mars")
    Path("folder").mkdir()
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    done = gapeval("detect", "drive.mcap", "-o", "out/found.geojson", *options)
    assert (done.status, line in done.last_line) == (status, True), done.err
    assert "bug of ours" not in done.err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before
    assert not Path("out").exists() or list(Path("out").iterdir()) == []


def test_a_missing_log_is_not_looked_for_before_the_picture_is_checked(tmp_path: Path) -> None:
    taken = labels(tmp_path / "labels.geojson")
    done = gapeval("detect", tmp_path / "no.bag", "-o", tmp_path / "a.geojson", "--picture", taken)
    assert (done.status, f"{taken}: exists and is no PNG picture" in done.last_line) == (1, True)


def test_a_frame_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    good = np.random.default_rng(1).normal(size=(500, 3)).astype(np.float32)
    clouds = [(stamp, good if index != 1 else good * np.nan) for index, stamp in enumerate(stamps(3))]
    log = drive_with(tmp_path / "drive.mcap", clouds)
    picture = tmp_path / "frame.png"
    done = gapeval("detect", log, "-o", tmp_path / "a.geojson", "--picture", picture, "--frame", 1)
    assert done.status == 1
    assert done.last_line.startswith(f"gapeval: {log}: frame 1 (stamp {stamps(3)[1]}): no finite point")
    assert [path.name for path in tmp_path.iterdir()] == ["drive.mcap"]
    assert (
        gapeval("detect", log, "-o", tmp_path / "a.geojson", "--picture", picture, "--frame", 2).status == 0
    )


def test_frames_are_counted_in_the_order_of_stamps(tmp_path: Path) -> None:
    recording = read_recording(drive(tmp_path / "drive.mcap", 4), LogSection())
    assert [one_frame(recording, number).stamp for number in range(4)] == stamps(4)


# What is drawn.


def test_gaps_and_labels_lie_where_they_were_found(tmp_path: Path) -> None:
    elsewhere = [[x, y + 2, z] for x, y, z in trench_ring()]
    drawn = labels(
        tmp_path / "labels.geojson",
        [
            feature(trench_ring()),
            feature(elsewhere, id="never mind", kind="ignore"),
            feature([[x, y - 2, z] for x, y, z in trench_ring()], id="later", start=str(stamps(4)[3])),
        ],
    )
    found = found_in(drive(tmp_path / "drive.mcap", 4), number=2, drawn=drawn)
    figure = draw_frame(found)
    assert len(found.detection.gaps) >= 3
    for gap in found.detection.gaps:
        assert vertices(artist(figure, f"gap {gap.index}")) == turned(gap.polygon)
    # The robot stands at x = 0.1 m of the map.
    trench = np.array(sorted({(y, x - 0.1) for x, y, _ in trench_ring()}))
    assert np.array(sorted(vertices(artist(figure, "label trench")))) == pytest.approx(trench)
    assert artist(figure, "label trench").get_linestyle() == "-"
    assert artist(figure, "label never mind").get_linestyle() != "-"
    assert figure.findobj(lambda each: each.get_gid() == "label later") == []


def test_a_hole_in_a_gap_stays_empty(tmp_path: Path) -> None:
    """Winding decides what is filled: the hole must turn against the outline, whatever came in."""
    ring = shapely.box(0, 0, 3, 3).exterior
    for hole in (shapely.box(1, 1, 2, 2).exterior, shapely.box(1, 1, 2, 2).exterior.reverse()):
        path = outline(shapely.Polygon(ring, [hole]))
        areas = [shapely.LinearRing(part).is_ccw for part in path.to_polygons()]
        assert sorted(areas) == [False, True]


def test_points_are_drawn_by_their_class(tmp_path: Path) -> None:
    found = found_in(walled(tmp_path / "drive.mcap"))
    figure = draw_frame(found)
    points, pl_th = found.frame.points.astype(float), found.configuration.detector.pl_th
    (left, right), (low, high) = ground(figure).get_xlim(), ground(figure).get_ylim()
    points = points[(points[:, 2] <= 2.0) & (points[:, 1] >= right) & (points[:, 1] <= left)]
    points = points[(points[:, 0] >= low) & (points[:, 0] <= high)]
    masks = {
        "on_plane": np.abs(points[:, 2]) <= pl_th,
        "above": points[:, 2] > pl_th,
        "below": points[:, 2] < -pl_th,
    }
    assert masks["on_plane"].sum() > 10_000
    assert masks["above"].sum() > 300
    assert masks["below"].sum() > 50
    for name, mask in masks.items():
        y, x = artist(figure, name).get_data()
        assert np.array_equal(np.column_stack([x, y]), points[mask, :2])


def test_cells_are_filled_by_what_is_known_of_them(tmp_path: Path) -> None:
    found = found_in(walled(tmp_path / "drive.mcap"))
    figure = draw_frame(found)
    image = artist(figure, "cells")
    pixels = image.get_array()
    left, right, low, high = image.get_extent()
    surface = found.detection.surface
    kinds = {
        "obstacle": OBSTACLE,
        "shaded": SHADED,
        "unseen": UNSEEN,
    }
    fills = {name: to_rgb(FILLS[kind]) for name, kind in kinds.items()}
    seen = dict.fromkeys(fills, 0)
    places, heights = midpoints(surface.grid), np.diff(row_edges(surface.grid, surface.grid.rows))
    for row, column in np.ndindex(surface.ground.shape):
        if heights[row] < 0.05:
            continue
        x, y = places[row, column]
        pixel = pixels[
            int((x - low) / (high - low) * len(pixels)), int((y - left) / (right - left) * pixels.shape[1])
        ]
        known = "unseen" if not surface.seen.cells[row, column] else ""
        known = known or ("obstacle" if surface.obstacle[row, column] else "")
        hidden = surface.shaded[row, column] and not surface.ground[row, column]
        known = known or ("shaded" if hidden else "")
        assert tuple(pixel) == fills.get(known, (1.0, 1.0, 1.0)), (row, column)
        if known:
            seen[known] += 1
    assert min(seen.values()) > 0


@pytest.mark.parametrize("traversable", [True, False])
def test_crossings_lead_from_start_to_end(tmp_path: Path, traversable: bool) -> None:
    values = FINE if traversable else {"detector": FINE["detector"]}  # d_r: half of the robot's length
    found = found_in(drive(tmp_path / "drive.mcap", 1), values)
    figure = draw_frame(found)
    trench = next(gap.index for gap in found.detection.gaps if gap.polygon.contains(shapely.Point(2.3, 0)))
    crossing = found.crossings[trench]
    assert (crossing.method, crossing.gap, crossing.traversable) == ("npca", trench, traversable)
    arrow = artist(figure, f"crossing {trench}")
    path = arrow.get_path().vertices
    start, end = np.array(crossing.start[1::-1]), np.array(crossing.end[1::-1])
    assert path[0] == pytest.approx(start, abs=1e-6)
    assert np.hypot(*(path - end).T).min() < 0.05
    assert to_rgb(arrow.get_edgecolor()) == to_rgb("#08802f" if traversable else "#d1112b")
    at = {
        text.get_text(): [other.xy for other in words(figure) if other.get_text() == text.get_text()]
        for text in words(figure)
    }
    assert tuple(start) in at["START"]
    assert tuple(end) in at["END"]
    assert tuple(crossing.centre[1::-1]) in at[str(trench) if traversable else f"{trench} too_long"]


def test_no_word_lies_over_another_in_a_crowd(tmp_path: Path) -> None:
    found = found_in(drive(tmp_path / "drive.mcap", 1), CROWDED)
    assert len(found.detection.gaps) > 2 * CROWD
    figure = draw_frame(found)
    boxes = [text.get_window_extent() for text in words(figure)]
    view = ground(figure).bbox.padded(0.5)
    assert all(view.contains(*corner) for box in boxes for corner in box.corners())
    assert not any(one.padded(-0.5).overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])
    written = [text.get_text() for text in words(figure)]
    assert 1 <= written.count("START") <= WORDED
    assert 1 <= sum(word[0].isdigit() for word in written) <= CROWD
    arrows = figure.findobj(lambda each: str(each.get_gid()).startswith("crossing "))
    assert len(arrows) == len(found.detection.gaps)


FEW = {"detector": {"delta_r": 1.05, "r_max": 4.0, "k": 6, "n_o": 0}, "crossing": {"standoff": 0.8}}


@pytest.mark.parametrize("delta_r", [1.03, 1.05])
def test_each_of_a_few_gaps_has_its_number_in_both_pictures(tmp_path: Path, delta_r: float) -> None:
    values = FEW | {"detector": FEW["detector"] | {"delta_r": delta_r}}
    found = found_in(walled(tmp_path / "drive.mcap"), values)
    expected = {str(gap.index) for gap in found.detection.gaps}
    assert 10 < len(expected) <= CROWD
    above, stages = draw_frame(found), draw_stages(found)
    numbers = [text for text in words(above) if text.get_text()[0].isdigit()]
    assert sorted(text.get_text().split()[0] for text in numbers) == sorted(expected)
    contours = stages.axes[2]
    assert sorted(text.get_text() for text in contours.texts) == sorted(expected)
    for axes, texts in ((ground(above), numbers), (contours, contours.texts)):
        view = axes.bbox.padded(0.5)
        assert all(view.contains(*corner) for one in texts for corner in one.get_window_extent().corners())


def test_an_arrow_that_leaves_the_picture_is_dashed_to_its_border(tmp_path: Path) -> None:
    found = found_in(walled(tmp_path / "drive.mcap"), FEW)
    figure = draw_frame(found)
    axes = ground(figure)
    view = shapely.box(*axes.viewLim.extents)
    seen = set()
    for crossing in found.crossings:
        arrow = artist(figure, f"crossing {crossing.gap}")
        ends = [crossing.start[1::-1], crossing.end[1::-1]]
        leaves = not all(view.contains(shapely.Point(end)) for end in ends)
        line = shapely.LineString(ends)
        if not view.intersects(line):
            continue
        seen.add(leaves)
        assert (arrow.get_linestyle() != "-") == leaves
        path = arrow.get_path()
        drawn = path.vertices[path.codes != path.CLOSEPOLY]
        assert view.buffer(0.05).contains(shapely.MultiPoint(drawn))
        if leaves:
            for end in ends:
                if not view.contains(shapely.Point(end)):
                    cut = line.intersection(view.exterior)
                    assert shapely.MultiPoint(drawn).distance(cut) < 1e-6
    assert seen == {True, False}
    (legend,) = figure.legends
    named = [text.get_text() for text in legend.get_texts()]
    assert named.count("crossing goes on behind the border") == 1


def test_the_picture_is_the_box_in_equal_metres_with_the_robot_in_it(tmp_path: Path) -> None:
    found = found_in(drive(tmp_path / "drive.mcap", 1))
    figure = draw_frame(found)
    axes = ground(figure)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert 4.0 < left < 4.5  # y grows to the left
    assert -4.5 < right < -4.0
    assert -1.0 < low < -0.34
    assert 4.0 < high < 4.5
    width, height = axes.bbox.size
    assert width / (left - right) == pytest.approx(height / (high - low))
    length, across = found.configuration.robot.length, found.configuration.robot.width
    robot = artist(figure, "robot")
    assert (robot.get_xy(), robot.get_width(), robot.get_height()) == (
        (-across / 2, -length / 2),
        across,
        length,
    )
    assert np.hypot(*artist(figure, "r_max").get_data()) == pytest.approx(4.0)
    assert set(artist(figure, "x_min").get_ydata()) == {0.6}
    texts = " ".join(text.get_text() for text in figure.texts)
    for part in ("drive.mcap, frame 0", str(stamps(1)[0]), "k 6", "n_o 1", "delta_r 1.05", "pl_th 0.1 m"):
        assert part in texts


def test_the_legend_hides_no_data(tmp_path: Path) -> None:
    for values in (FINE, CROWDED, {"robot": {"length": 9.0, "width": 1.0}}):
        figure = draw_frame(found_in(drive(tmp_path / "drive.mcap", 1), values))
        png(figure)
        (legend,) = figure.legends
        box = legend.get_window_extent()
        assert box.y1 < ground(figure).get_tightbbox().y0
        assert box.x0 > 0
        assert box.x1 < figure.bbox.x1


def test_the_stages_are_those_of_the_surface(tmp_path: Path) -> None:
    found = found_in(walled(tmp_path / "drive.mcap"))
    surface, gaps = found.detection.surface, found.detection.gaps
    figure = draw_stages(found)
    binary, opened, contours = (
        artist(figure, name).images[0].get_array() for name in ("binary", "opened", "contours")
    )
    candidates = surface.seen.cells & ~surface.ground & ~surface.shaded
    assert np.array_equal(binary == GAP, candidates)
    assert np.array_equal(binary == UNSEEN, ~surface.seen.cells)
    assert np.array_equal(binary == OBSTACLE, surface.obstacle & surface.seen.cells)
    assert np.array_equal(
        binary == SHADED,
        surface.shaded & ~surface.ground & ~surface.obstacle & surface.seen.cells,
    )
    assert np.array_equal(opened == GAP, surface.gap.cells)
    assert np.array_equal(opened == OPENED, candidates & ~surface.gap.cells)
    assert (opened == OPENED).any()
    assert np.array_equal(contours, gaps.labels)
    assert [axes.get_title()[0] for axes in figure.axes] == ["1", "2", "3"]
    assert {text.get_text() for text in figure.axes[2].texts} == {str(gap.index) for gap in gaps}


def test_stages_have_the_left_on_the_left_and_far_above(tmp_path: Path) -> None:
    found = found_in(drive(tmp_path / "drive.mcap", 1))
    grid = found.detection.surface.grid
    figure = draw_stages(found)
    figure.canvas.draw()
    for axes in figure.axes:
        degrees = {text.get_text(): text.get_window_extent().x0 for text in axes.get_xticklabels()}
        assert degrees["90°"] < degrees["45°"] < degrees["0°"] < degrees["−45°"] < degrees["−90°"]  # noqa: RUF001
        edges = row_edges(grid, grid.rows)
        for tick, text in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True):
            assert np.interp(tick, np.arange(grid.rows + 1), edges) == pytest.approx(
                float(text.get_text()), abs=1e-6
            )
        low, high = axes.get_ylim()
        seen = np.flatnonzero(found.detection.surface.seen.cells.any(axis=1))
        assert 0 <= low <= seen[0]  # rows near the pole, of which nothing is known, are left out
        assert high == grid.rows
        (image,) = axes.images
        assert image.origin == "lower"
        assert tuple(image.get_extent()) == (0, grid.width, 0, grid.rows)
        assert axes.get_xlim() == (grid.width, 0)


def test_contour_lines_enclose_the_cells_of_the_gaps() -> None:
    cells = np.zeros((6, 8), dtype=np.int32)
    cells[0:2, 0:3] = 1
    cells[1:5, 3:6] = 2  # beside the first
    cells[5, 7] = 3
    lines = contour_lines(cells)
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(lines)))
    merged = sorted(face.area for face in faces)
    assert merged == [1.0, 6.0, 12.0]
    assert shapely.union_all(shapely.linestrings(lines)).length == len(lines)


def test_every_gap_has_a_colour_of_its_own() -> None:
    assert len(set(gap_colours(500))) == 500


def test_a_frame_without_gaps_can_be_drawn(tmp_path: Path) -> None:
    found = found_in(drive(tmp_path / "drive.mcap", 1), {"detector": {"n_o": 9}})
    assert len(found.detection.gaps) == 0
    assert png(draw_frame(found)) != png(draw_stages(found))
    assert words(draw_frame(found)) == []


@pytest.mark.parametrize("name", ["$x_{1$.mcap", "\u6eda.mcap"])
def test_a_log_of_any_name_can_be_drawn(tmp_path: Path, name: str) -> None:
    figure = draw_frame(found_in(drive(tmp_path / name, 1)))
    assert png(figure)
    assert figure.texts[0].get_text() == f"{name}, frame 0"


@pytest.mark.parametrize("k", [1, 2, 9])
def test_every_resolution_can_be_drawn(tmp_path: Path, k: int) -> None:
    found = found_in(drive(tmp_path / "drive.mcap", 1), {"detector": {"k": k, "delta_r": 1.01, "n_o": 0}})
    assert png(draw_frame(found)).startswith(PNG)
    assert png(draw_stages(found)).startswith(PNG)
