"""The page of `gapeval report`: that all of it is there, is safe, and can be traced to the files."""

import base64
import csv
import json
import shutil
from pathlib import Path

import pytest
from command import gapeval
from page_checks import GRID, check_sound, reported, swept
from small_logs import drive, labels
from study_folder import write_studies

from gapeval.report.text import short

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return swept(tmp_path_factory.mktemp("swept"))


@pytest.fixture(scope="module")
def page(results: Path) -> str:
    return reported(results, output=results.parent / "report.html")


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_everything_is_on_the_page(page: str, results: Path) -> None:
    found = check_sound(page)
    assert found.texts("h1") == ["gapeval report"]
    assert found.texts("h2") == [f"Sweep {results.as_posix()}"]
    assert found.texts("h3") == [
        "What was run on what",
        "Recommended configuration",
        "Against each parameter",
        "Over pairs of parameters",
        "What can be had together",
        "Worst and best frames",
    ]
    assert found.texts("h4") == [
        "Against k",
        "Against delta_r",
        "Against n_o",
        "f1 over pairs of parameters",
        "Hit rate against false gaps against time",
        "One frame of all, which are alike",
        "Step by step",
    ]
    assert len(found.all("svg", class_="panel")) == 3 * 4
    assert len(found.all("svg", class_="heat")) == 3
    assert len(found.all("svg", class_="scatter")) == 1
    images = found.all("img")
    assert len(images) == len(
        [t for t in found.texts("h4") if "frame" in t.split()[:2] or t == "Step by step"]
    )
    for image in images:
        kind, _, content = image.attributes["src"].partition(",")
        assert kind == "data:image/png;base64"
        assert base64.b64decode(content).startswith(PNG)
    assert "All frames score alike, so that none is worst or best: the first is shown." in page
    assert "Nothing was refused, and nothing failed." in page


def test_every_figure_names_its_rows(page: str, results: Path) -> None:
    found = check_sound(page)
    for figure in found.all("figure"):
        assert f"From {results.as_posix()}/" in figure.text
        assert ".csv, " in figure.text


def test_what_is_tabulated_is_what_stands_in_the_named_rows(page: str, results: Path) -> None:
    """The table under a curve, read back against summary.csv by the filter in its caption."""
    found = check_sound(page)
    overall = [row for row in rows(results / "summary.csv") if row["log"] == "all"]
    (figure,) = [one for one in found.all("figure") if one.attributes["id"] == "s1-against-delta_r"]
    filters = figure.text.split("rows with log = all, ")[1].split(";")[0]
    held = dict(part.strip().split(" = ") for part in filters.split(","))
    assert held.keys() == {"k", "n_o"}
    of = {row["delta_r"]: row for row in overall if all(row[name] == value for name, value in held.items())}
    assert list(of) == ["1.03", "1.05", "1.2"]
    for value, row in of.items():
        hits = max(float(other["hit_rate"]) for other in overall if other["delta_r"] == value)
        assert f"{value}{short(float(row['f1']))}" in "".join(figure.text.split())
        line = [text for text in figure.text.split("\n") if text.startswith(value)]
        assert len(line) == 1
        assert short(hits) in line[0]


def test_the_recommended_configuration_is_one_of_the_best(page: str, results: Path) -> None:
    found = check_sound(page)
    (name,) = found.texts("p", class_="name")
    by_id = {row["configuration"]: row for row in rows(results / "summary.csv") if row["log"] == "all"}
    best = max(float(row["pq"]) for row in by_id.values() if row["pq"])
    assert float(by_id[name]["pq"]) >= best - 0.02
    assert "It was chosen on these data" in page
    assert f"{best:.3f}" in page


def test_the_same_folder_gives_the_same_bytes(page: str, results: Path, tmp_path: Path) -> None:
    assert reported(results, output=tmp_path / "again.html") == page
    assert gapeval("report", results, "--png", tmp_path / "a").status == 0
    assert gapeval("report", results, "--png", tmp_path / "b").status == 0
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert {"against-k.png", "pairs.png", "front.png", "stages.png"} <= set(names)
    for name in names:
        content = (tmp_path / "a" / name).read_bytes()
        assert content.startswith(PNG)
        assert content == (tmp_path / "b" / name).read_bytes()
    assert not Path("report.html").exists()  # --png alone


def test_times_are_measured_once_and_kept(page: str, results: Path, tmp_path: Path) -> None:
    kept = rows(results / "times.csv")
    overall = [row["configuration"] for row in rows(results / "summary.csv") if row["log"] == "all"]
    assert [row["configuration"] for row in kept] == overall
    assert all(0 < float(row["median"]) <= float(row["p95"]) for row in kept)
    assert {row["frames"] for row in kept} == {"3"}
    copy = tmp_path / "results"
    shutil.copytree(results, copy)
    marked = (copy / "times.csv").read_text().replace(kept[0]["median"], "1.5").replace(kept[0]["p95"], "1.5")
    (copy / "times.csv").write_text(marked)
    reported(copy, output=tmp_path / "report.html")
    assert (copy / "times.csv").read_text() == marked
    # Of another log they do not hold.
    (copy / "times.csv").write_text(marked.replace(kept[0]["sha256"], "0" * 64))
    reported(copy, output=tmp_path / "report.html")
    assert "1.5" not in {row["median"] for row in rows(copy / "times.csv")}
    assert [row["sha256"] for row in rows(copy / "times.csv")] == [row["sha256"] for row in kept]


NASTY = """<img src=x onerror="alert(1)">&amp;'{{ 7*7 }}.mcap"""


def test_names_are_shown_and_never_obeyed(tmp_path: Path) -> None:
    results = swept(tmp_path, log=NASTY)
    page = reported(results, output=tmp_path / "report.html")
    found = check_sound(page)
    assert not [one for one in found.elements if one.attributes.get("src") == "x"]
    assert any(text == NASTY for text in found.texts("th", scope="row"))
    assert any(NASTY in one.attributes["alt"] for one in found.all("img"))
    assert "49.mcap" not in page


def test_a_log_that_is_gone_is_told_instead_of_a_picture(tmp_path: Path) -> None:
    results = swept(tmp_path)
    log = tmp_path / "drive.mcap"
    content = log.read_bytes()
    log.unlink()
    page = reported(results, output=tmp_path / "report.html")
    found = check_sound(page)
    assert found.all("img") == []
    assert f"No picture: the log is no longer at {log}" in page
    assert "No times: the log is no longer" in page
    assert not (results / "times.csv").exists()
    log.write_bytes(content[:-1])
    changed = reported(results, output=tmp_path / "report.html")
    assert "is not what was swept: its content has changed" in changed
    check_sound(changed)
    log.write_bytes(content)
    drawn = tmp_path / "labels.geojson"
    drawn.unlink()
    unlabelled = check_sound(reported(results, output=tmp_path / "report.html"))
    assert unlabelled.all("img")
    assert any("Drawn without its labels" in text for text in unlabelled.texts("figcaption"))
    shutil.rmtree(results / "parts")
    (results / "times.csv").unlink()
    page = reported(results, output=tmp_path / "report.html")
    assert "does not say which logs these results are of" in page


def test_a_sweep_begun_later_is_not_taken_for_the_one_that_is_there(tmp_path: Path) -> None:
    results = swept(tmp_path)
    order = results / "parts" / "sweep.json"
    document = json.loads(order.read_text())
    document["config"] = document["config"].replace("- 1.03", "- 1.04")
    order.write_text(json.dumps(document))
    page = reported(results, output=tmp_path / "report.html")
    assert "begun later and is not finished" in page
    check_sound(page)


def test_a_sweep_without_labels(tmp_path: Path) -> None:
    results = swept(tmp_path, labelled=False)
    page = reported(results, output=tmp_path / "report.html")
    found = check_sound(page)
    assert "There were no labels, so none is recommended" in page
    assert "Recommended configuration" not in found.texts("h3")
    assert "Over pairs of parameters" not in found.texts("h3")
    assert len(found.all("svg", class_="panel")) == 3 * 2  # gaps, and those that can be crossed
    assert "The frame with the most gaps" in found.texts("h4")


def test_one_configuration_has_no_curves(tmp_path: Path) -> None:
    results = swept(tmp_path, "-p", "delta_r=1.05", "--jobs", 1)
    page = reported(results, output=tmp_path / "report.html")
    found = check_sound(page)
    assert "No curves: there is one configuration, and no parameter varies." in page
    assert "nothing was chosen" in page
    assert "chosen on these data" not in page
    assert found.all("svg") == []
    assert found.all("img")
    assert not (results / "times.csv").exists()


def test_a_score_of_detections_can_be_reported(tmp_path: Path) -> None:
    log, drawn = drive(tmp_path / "drive.mcap"), labels(tmp_path / "labels.geojson")
    assert gapeval("detect", log, "-o", tmp_path / "found.geojson", "-p", "delta_r=1.05").status == 0
    assert gapeval("score", tmp_path / "found.geojson", drawn, "-o", tmp_path / "score").status == 0
    found = check_sound(reported(tmp_path / "score", output=tmp_path / "report.html"))
    assert "found.geojson" in " ".join(found.texts("td"))


def test_several_logs_have_a_row_each(tmp_path: Path) -> None:
    logs = [drive(tmp_path / "a.mcap", 3), drive(tmp_path / "b.mcap", 2, seed=1)]
    drawn = labels(tmp_path / "labels.geojson")
    assert gapeval("sweep", *logs, "--labels", drawn, *GRID, "-o", tmp_path / "out").status == 0
    found = check_sound(reported(tmp_path / "out", output=tmp_path / "report.html"))
    assert "This configuration in each log" in found.texts("caption")
    (name,) = found.texts("p", class_="name")
    of = {row["log"]: row for row in rows(tmp_path / "out/summary.csv") if row["configuration"] == name}
    (table,) = [one for one in found.all("table") if "This configuration in each log" in one.text]
    for log in ("a.mcap", "b.mcap"):
        line = "".join(table.text.split(log)[1].split())
        assert line.startswith(of[log]["frames"] + of[log]["asked"])


def test_what_was_refused_is_said_loudly(tmp_path: Path) -> None:
    results = swept(tmp_path)
    manifest = json.loads((results / "manifest.json").read_text())
    manifest["logs"][0]["refused"] = {"no transform <here>": 3}
    manifest["failed"] = [
        {"log": "drive.mcap", "first": 1, "last": 2, "frames": 2, "reason": "ValueError: no"}
    ]
    (results / "manifest.json").write_text(json.dumps(manifest))
    done = gapeval("report", results, "-o", tmp_path / "report.html")
    found = check_sound((tmp_path / "report.html").read_text())
    (loud,) = found.all("div", class_="warning")
    assert "refused 3 clouds of 4: no transform <here>" in loud.text
    assert "2 frames failed and are in no figure" in loud.text
    assert "refused 3 clouds of 4" in done.err


def test_studies_and_sweeps_on_one_page(results: Path, tmp_path: Path) -> None:
    studies = write_studies(tmp_path / "studies")
    page = reported(studies, results, output=tmp_path / "report.html")
    found = check_sound(page)
    assert found.texts("h2") == [f"Studies {studies.as_posix()}", f"Sweep {results.as_posix()}"]
    assert [one.attributes["href"] for one in found.all("a")] == ["#s1", "#s2"]


def test_a_folder_without_results_is_an_error(tmp_path: Path) -> None:
    done = gapeval("report", tmp_path, "-o", tmp_path / "report.html")
    assert done.status == 1
    assert done.last_line.startswith(f"gapeval: {tmp_path}: neither summary.csv of a sweep nor claims.csv")
    assert not (tmp_path / "report.html").exists()


def test_what_is_no_folder_of_results_is_told_by_what_it_is(results: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    file = tmp_path / "README.md"
    file.write_text("# Read me")
    for path, complaint in {
        tmp_path / "nothere": "does not exist; name a folder of results",
        file: "is a file; name a folder of results, which has summary.csv or claims.csv in it",
        results.parent: "neither summary.csv of a sweep nor claims.csv of studies is here; "
        f"is {results} meant?",
    }.items():
        done = gapeval("report", path, "-o", page)
        assert (done.status, done.last_line) == (1, f"gapeval: {path}: {complaint}")
        assert not page.exists()


def test_nothing_but_a_page_is_replaced(results: Path, tmp_path: Path) -> None:
    precious = tmp_path / "notes.html"
    precious.write_text("dear diary")
    done = gapeval("report", results, "-o", precious)
    assert (done.status, precious.read_text()) == (1, "dear diary")
    assert "exists and is no HTML page" in done.last_line
    assert gapeval("report", results, "-o", tmp_path).status == 1


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("summary.csv", "log,configuration\nall,abc\n", "no column k"),
        ("manifest.json", "{", "not JSON"),
        ("manifest.json", "[]", "not what gapeval writes"),
    ],
)
def test_damaged_files_are_told_in_one_line(
    results: Path, tmp_path: Path, name: str, content: str, complaint: str
) -> None:
    copy = tmp_path / "results"
    shutil.copytree(results, copy)
    (copy / name).write_text(content)
    done = gapeval("report", copy, "-o", tmp_path / "report.html")
    assert done.status == 1
    assert complaint in done.last_line
