"""Drawings: that points stand where they should, and that an SVG is fit for a page."""

import re
from itertools import pairwise
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.text import Text

from gapeval.report.curves.heat import Heat, draw_heat
from gapeval.report.curves.panel import Line, Panel, Point, draw_panel
from gapeval.report.curves.picture import curve_style, png, svg
from gapeval.report.curves.scatter import Dot, Scatter, draw_scatter
from gapeval.report.curves.style import COLOURS, DASHES, MARKERS, VARIABLES, Look
from gapeval.report.page.swatch import swatch

LINES = (
    Line("a", (Point(0, 0.5, 0.4, 0.7), Point(1, 0.6, 0.5, 0.8)), Look(0)),
    Line("b", (Point(0, 0.1), Point(1, 0.0)), Look(1)),
)
PANEL = Panel("f1 <&> $x_1$", "k", LINES, 'spoken "words" & <signs>', categories=("5", "6"))
HEAT = Heat("", "k", "n_o", ("5", "6"), ("0", "1"), ((0.0, 1.0), (None, 0.5)), (0.0, 1.0), (1, 0), "map")
SCATTER = Scatter("", "x", "y", (Dot(0, 1, 0, "1"), Dot(30, 0.5, None)), 3, ((0.0, 1.0),), (0.0, 1.0), "dots")


def drawn(panel: Panel) -> Figure:
    figure = Figure()
    with curve_style():
        draw_panel(figure.add_subplot(), panel)
        figure.canvas.draw()
    return figure


@pytest.mark.parametrize("what", [PANEL, HEAT, SCATTER], ids=["panel", "heat", "scatter"])
def test_an_svg_is_sound_and_the_same_each_time(what) -> None:
    text = svg(what, "name")
    assert svg(what, "name") == text
    tree = ElementTree.fromstring(text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1))
    assert tree.attrib["aria-label"] == what.alt
    assert tree.attrib["viewBox"].split() == ["0", "0", f"{what.width:g}", f"{what.height:g}"]
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(set(ids)) == len(ids)
    assert all(name.startswith("name-") for name in ids)
    assert not set(ids) & set(re.findall(r' id="([^"]+)"', svg(what, "other")))
    assert "DejaVu" not in text
    assert "<metadata" not in text
    for colour in VARIABLES:
        assert colour not in text
    if not isinstance(what, Heat):
        assert "#" not in re.sub(r'(href="|url\()#', "", text)


def test_words_are_words_and_nothing_is_taken_for_a_formula() -> None:
    words = ElementTree.fromstring(f"<a>{svg(PANEL, 'p')}</a>").itertext()
    assert "f1 <&> $x_1$" in [word.strip() for word in words]


def test_points_stand_at_their_places_and_bands_around_them() -> None:
    (axes,) = drawn(PANEL).axes
    marked = [line for line in axes.lines if line.get_marker() in MARKERS]
    assert [line.get_xydata().tolist() for line in marked] == [
        [[0, 0.5], [1, 0.6]],
        [[0, 0.1], [1, 0.0]],
    ]
    (band,) = axes.collections
    vertices = band.get_paths()[0].vertices
    assert {tuple(place) for place in vertices.tolist()} == {(0, 0.4), (1, 0.5), (1, 0.8), (0, 0.7)}
    assert [text.get_text() for text in axes.get_xticklabels()] == ["5", "6"]
    low, high = axes.get_ylim()
    assert low < 0 < 0.8 < high


def test_categories_get_bars_side_by_side() -> None:
    both = tuple(Line(name, LINES[0].points, Look(i)) for i, name in enumerate("ab"))
    (axes,) = drawn(Panel("f1", "scene", both, "", categories=("x", "y"), joined=False)).axes
    marked = [line for line in axes.lines if line.get_marker() in MARKERS]
    one, other = ([x for x, _ in line.get_xydata().tolist()] for line in marked)
    assert all(abs(a - b) > 0.1 for a, b in zip(one, other, strict=True))
    assert [round(x) for x in one] == [round(x) for x in other] == [0, 1]


@pytest.mark.parametrize(
    ("places", "log", "shown"),
    [
        ((4, 5, 6, 7, 8), False, ["4", "5", "6", "7", "8"]),
        ((0.001, 0.01, 0.05), True, ["0.001", "0.01", "0.05"]),
        ((1.05, 1.1, 1.2, 2.0), False, ["1.05", "1.2", "2"]),
        ((1.03, 1.05, 1.5, 2.0), True, ["1.03", "1.5", "2"]),
        (
            (-0.07, -0.035, -0.0175, 0, 0.0175, 0.035, 0.07),
            False,
            ["\N{MINUS SIGN}0.07", "\N{MINUS SIGN}0.035", "0", "0.035", "0.07"],
        ),
    ],
)
def test_few_numbers_are_named_as_they_are(places, log, shown) -> None:
    line = Line("", tuple(Point(x, 1.0) for x in places), Look())
    (axes,) = drawn(Panel("f1", "x", (line,), "", log_x=log)).axes
    low, high = axes.get_xlim()
    ticks = zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
    assert [text.get_text() for x, text in ticks if low <= x <= high] == shown


def test_many_numbers_get_few_ticks() -> None:
    line = Line("", tuple(Point(1 + i / 100, 1.0) for i in range(60)), Look())
    (axes,) = drawn(Panel("f1", "x", (line,), "")).axes
    assert len(axes.get_xticks()) < 12
    names = tuple(str(i) for i in range(60))
    (axes,) = drawn(Panel("f1", "x", (Line("", (Point(0, 1),), Look()),), "", categories=names)).axes
    assert 1 < len(axes.get_xticks()) <= 12


def test_cells_hold_their_values_in_readable_letters() -> None:
    figure = Figure()
    with curve_style():
        draw_heat(figure.add_subplot(), HEAT)
    written = {text.get_position(): (text.get_text(), text.get_color()) for text in figure.axes[0].texts}
    assert written[0, 0] == ("0.00", "#ffffff")
    assert written[1, 0] == ("1.00", "#000000")
    assert written[0, 1][0] == "–"  # noqa: RUF001
    assert written[1, 1][0] == "0.50"


def test_lines_differ_without_their_colours() -> None:
    looks = [Look(number) for number in range(3 * len(MARKERS))]
    shapes = {(str(look.artist()["ls"]), look.artist()["marker"]) for look in looks}
    assert len(shapes) == len(looks)
    assert len(set(MARKERS)) == len({str(dash) for dash in DASHES}) == len(set(COLOURS)) == 7
    drawings = [swatch(look) for look in looks]
    without_colour = {re.sub(r"var\([^)]*\)", "", text) for text in drawings}
    assert len(without_colour) == len(looks)
    for one, other in pairwise(drawings):
        assert one != other


def test_a_png_has_a_legend_and_all_panels() -> None:
    one = png([PANEL], [("a", Look(0))], "$title")
    assert one.startswith(b"\x89PNG")
    assert one == png([PANEL], [("a", Look(0))], "$title")
    assert one != png([PANEL, PANEL], [("a", Look(0))], "$title")


# The same crowds each time: among all that there could be, some leave no free place.
@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(st.integers(0, 8), st.integers(0, 10)), min_size=1, max_size=16, unique=True),
    st.integers(0, 15),
)
def test_numbers_in_a_crowd_lie_in_the_picture_and_over_no_other(
    places: list[tuple[int, int]], longest: int
) -> None:
    named = [f"{i} recommended" if i == longest else str(i) for i in range(len(places))]
    dots = tuple(Dot(x / 2, y / 10, 0, name) for (x, y), name in zip(places, named, strict=True))
    figure = Figure(figsize=(6.4, 4.4))
    with curve_style():
        draw_scatter(figure.add_subplot(), Scatter("", "x", "y", dots, 1, (), (0, 0), ""))
        figure.draw_without_rendering()
    (axes,) = figure.axes
    assert sorted(text.get_text() for text in axes.texts) == sorted(named)
    boxes = [Text.get_window_extent(text) for text in axes.texts]  # of the words, without their line
    assert all(axes.bbox.padded(1).contains(*corner) for box in boxes for corner in box.corners())
    assert not any(one.padded(-1).overlaps(two) for i, one in enumerate(boxes) for two in boxes[:i])
    of = dict(zip(named, dots, strict=True))
    assert all(text.xy == (of[text.get_text()].x, of[text.get_text()].y) for text in axes.texts)
