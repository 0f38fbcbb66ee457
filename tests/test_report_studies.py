"""Studies in a report: their claims, and curves that are of the rows that they name."""

import csv
from pathlib import Path

import pytest
import yaml
from command import gapeval
from page_checks import check_sound, reported
from study_folder import JUDGED, RESOLUTION, rows_of, write_studies

from gapeval.report.curves.panel import Panel
from gapeval.report.studies.results import read_studies
from gapeval.report.studies.section import study_section


@pytest.fixture
def studies(tmp_path: Path) -> Path:
    return write_studies(tmp_path / "studies")


def test_claims_come_first_and_then_every_study(studies: Path, tmp_path: Path) -> None:
    page = reported(studies, output=tmp_path / "report.html")
    found = check_sound(page)
    assert found.texts("h3") == [
        "What the paper says, and what was measured",
        "What was run on what",
        "Resolution",
        "Erosion & dilation <n_o>",
    ]
    assert found.texts("h4") == ["By sensor", "f1 against roughness", "By scene"]
    everything, *_ = found.all("table", class_="claims")
    for claim in JUDGED:
        for text in claim[3:]:
            assert text in everything.text
    verdicts = [
        one.attributes["class"].split()[-1]
        for one in found.all("span")
        if "verdict" in one.attributes.get("class", "")
    ]
    assert verdicts[:4] == ["yes", "partly", "no", "unknown"]
    assert len(verdicts) == 4 + 2 * len(JUDGED)
    assert "No curves: no figure was measured." in page
    assert f"{studies.as_posix()}/resolution/runs/tunnel-lms151" in page


def test_curves_are_of_the_rows_that_are_asked_for(studies: Path) -> None:
    section = study_section(read_studies(studies), "studies")
    by_sensor, _, by_scene = section.studies[0].curves
    rows = rows_of(studies / "resolution.csv")
    for panel, metric in zip(by_sensor.drawings, ("hit_rate", "fp_per_frame"), strict=True):
        assert isinstance(panel, Panel)
        assert [line.name for line in panel.lines] == ["lms151", "vlp16", "os1-64"]
        for line in panel.lines:
            expected = [
                (float(row["k"]), float(row[metric]))
                for row in rows
                if row["by"] == "all" and row["scene"] in ("tunnel", "street") and row["sensor"] == line.name
            ]
            assert [(point.x, point.y) for point in line.points] == expected
            assert all((point.low is None) == (metric != "hit_rate") for point in line.points)
        assert panel.joined
    assert by_sensor.source == (
        "studies/resolution.csv, rows with by = all, scene = tunnel or street, by k and sensor"
    )
    assert len({look.artist()["marker"] for _, look in by_sensor.legend}) == 3
    (scenes,) = by_scene.drawings
    assert isinstance(scenes, Panel)
    assert scenes.categories == ("street", "hall", "slope")
    assert not scenes.joined


def test_a_quick_run_says_so(tmp_path: Path) -> None:
    page = reported(write_studies(tmp_path / "studies", quick=True), output=tmp_path / "report.html")
    assert "This was a quick run" in page


@pytest.mark.parametrize(
    ("curve", "complaint"),
    [
        ({"x": "no", "y": ["f1"]}, "curve 2 (f1 against no) is left out: there is no column no"),
        ({"y": ["f1"]}, "curve 2 is left out: it needs x and y, columns of resolution.csv"),
        ("f1", "curve 2 is left out: it needs x and y, columns of resolution.csv"),
        (
            {"x": "k", "y": "f1", "where": {"nowhere": 1}},
            "curve 2 (f1 against k) is left out: there is no column nowhere",
        ),
        ({"x": ["k"], "y": "f1"}, "curve 2 (f1 against ['k']) is left out: there is no column ['k']"),
        (
            {"title": "Scenes", "x": "k", "y": ["scene"]},
            "curve 2 (Scenes) is left out: scene is 'tunnel' in a row, which is no number",
        ),
        (
            {"x": "scene", "y": "f1", "log_x": True},
            "curve 2 (f1 against scene) is left out: scene is 'tunnel' in a row, "
            "which is no number, as log_x needs",
        ),
    ],
)
def test_a_curve_that_cannot_be_drawn_is_left_out_and_told(
    studies: Path, tmp_path: Path, curve: object, complaint: str
) -> None:
    """All other curves are drawn as if it were not there."""
    whole = [exhibit.name for exhibit in study_section(read_studies(studies), "studies").exhibits]
    first, _, *others = RESOLUTION["curves"]
    (studies / "resolution" / "study.yaml").write_text(
        yaml.safe_dump(RESOLUTION | {"curves": [first, curve, *others]})
    )
    done = gapeval("report", studies, "-o", tmp_path / "report.html")
    assert done.status == 0, done.err
    told = f"study resolution, {complaint}"
    assert told in done.err
    found = check_sound((tmp_path / "report.html").read_text())
    (loud,) = found.all("div", class_="warning")
    assert "Mind this first" in loud.text
    assert " ".join(loud.text.split()).endswith(told)
    section = study_section(read_studies(studies), "studies")
    assert [exhibit.name for exhibit in section.exhibits] == [n for n in whole if n != "resolution-2"]


def test_a_column_that_is_missing_is_empty(studies: Path) -> None:
    """`by` and `group` are in a CSV file only where a study has groups of labels."""
    curve = {"x": "k", "y": "f1", "where": {"by": "all", "nowhere": "", "nor_here": ["", 3]}}
    (studies / "resolution" / "study.yaml").write_text(yaml.safe_dump(RESOLUTION | {"curves": [curve]}))
    section = study_section(read_studies(studies), "studies")
    assert section.warnings == ()
    (exhibit,) = section.exhibits
    assert len(exhibit.table.rows) == 16


def test_a_figure_that_is_no_number_is_told(studies: Path) -> None:
    path = studies / "resolution.csv"
    path.write_text(path.read_text().replace(",0.2,0.5,24", ",0.2,nan,24"))
    curves = [{"x": "k", "y": ["f1"]}, {"x": "k", "y": ["hit_rate"]}]
    (studies / "resolution" / "study.yaml").write_text(yaml.safe_dump(RESOLUTION | {"curves": curves}))
    section = study_section(read_studies(studies), "studies")
    (told,) = section.warnings
    assert told.endswith("curve 1 (f1 against k) is left out: f1 is 'nan' in a row, which is no number")
    assert [exhibit.name for exhibit in section.exhibits] == ["resolution-2"]


def test_groups_are_called_by_what_they_are_of(studies: Path) -> None:
    curves = [
        {"x": "group", "y": ["hit_rate"], "where": {"by": by}} for by in ("scene", ["scene", "all"], "range")
    ]
    path = studies / "resolution.csv"
    path.write_text(path.read_text() + "tunnel,lms151,0.01,range,1.5,6,0.5,,,1,0.5,24\n")
    (studies / "resolution" / "study.yaml").write_text(yaml.safe_dump(RESOLUTION | {"curves": curves}))
    exhibits = study_section(read_studies(studies), "studies").exhibits
    assert [one.drawings[0].x_label for one in exhibits] == ["scene", "group", "range [m]"]
    assert [one.table.head[0] for one in exhibits] == ["scene", "group", "range [m]"]
    assert exhibits[2].title == "hit_rate against range [m]"


def test_of_one_log_there_is_one_line(studies: Path) -> None:
    """Rows of `all` that are those of the only log."""
    path = studies / "resolution.csv"
    head = path.read_text().splitlines()[0]
    lines = [
        f"{scene},lms151,0.01,all,,{k},0.{k},,,1,{f1},24"
        for scene in ("all", "a.mcap")
        for k, f1 in ((5, 0.5), (6, 0.7))
    ]
    path.write_text("\n".join([head, *lines]) + "\n")
    curve = {"x": "k", "y": ["hit_rate", "f1"], "lines": "scene", "where": {"by": "all"}}
    (studies / "resolution" / "study.yaml").write_text(yaml.safe_dump(RESOLUTION | {"curves": [curve]}))
    (exhibit,) = study_section(read_studies(studies), "studies").exhibits
    assert [name for name, _ in exhibit.legend] == ["scene a.mcap"]
    assert exhibit.source.endswith("rows with by = all, scene = a.mcap, by k and scene")
    assert len(exhibit.table.rows) == 2
    path.write_text("\n".join([head, *lines]).replace("0.7,24", "0.8,24", 1) + "\n")  # they differ
    (exhibit,) = study_section(read_studies(studies), "studies").exhibits
    assert [name for name, _ in exhibit.legend] == ["scene all", "scene a.mcap"]


def test_an_interval_at_the_end_is_explained_where_there_is_one(studies: Path) -> None:
    (studies / "resolution" / "study.yaml").write_text(
        yaml.safe_dump(RESOLUTION | {"curves": [{"x": "k", "y": ["hit_rate"], "where": {"by": "scene"}}]})
    )
    (exhibit,) = study_section(read_studies(studies), "studies").exhibits
    assert "exactly 0 or 1" not in exhibit.caption
    path = studies / "resolution.csv"
    path.write_text(path.read_text().replace("street,6,0.9,", "street,6,1.0,"))
    (exhibit,) = study_section(read_studies(studies), "studies").exhibits
    assert exhibit.caption.count("exactly 0 or 1") == 1


def test_a_verdict_on_values_alone_says_so(studies: Path, tmp_path: Path) -> None:
    words = "on values alone: too little data for intervals"
    assert words not in reported(studies, output=tmp_path / "report.html")  # an older folder
    claims = rows_of(studies / "claims.csv")
    bases = ["intervals", "values alone", "intervals", ""]
    with (studies / "claims.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, [*claims[0], "basis"])
        table.writeheader()
        table.writerows({**row, "basis": basis} for row, basis in zip(claims, bases, strict=True))
    found = check_sound(reported(studies, output=tmp_path / "report.html"))
    cells = [text for text in found.texts("td") if words in text]
    assert cells == [f"holds partly {words}"] * 2
