"""Studies in a report: their claims, and curves that are of the rows that they name."""

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
    ("change", "complaint"),
    [
        ({"curves": [{"x": "no", "y": ["f1"]}]}, "names no, which is no column"),
        ({"curves": [{"y": ["f1"]}]}, "needs x and y"),
        ({"curves": [{"x": "k", "y": "f1", "where": {"nowhere": 1}}]}, "names nowhere"),
    ],
)
def test_a_study_that_cannot_be_drawn_is_told(
    studies: Path, tmp_path: Path, change: dict[str, object], complaint: str
) -> None:
    (studies / "resolution" / "study.yaml").write_text(yaml.safe_dump(RESOLUTION | change))
    done = gapeval("report", studies, "-o", tmp_path / "report.html")
    assert done.status == 1
    assert complaint in done.last_line
