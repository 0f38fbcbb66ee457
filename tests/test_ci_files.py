"""The workflows that teams copy: every gapeval command in them is run, in their order, on a committed log."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from command import gapeval
from gate import COMMITTED, CONFIGS

from gapeval.cli import cli

GITHUB, GITLAB = CONFIGS / "github.yml", CONFIGS / "gitlab.yml"
FETCHED = "log/drive.mcap"
WRITTEN = re.compile(r"gapeval [a-z].*")  # a command in any line, also in a comment


@dataclass(frozen=True, slots=True)
class Step:
    """A shell script. anyway: also if one before it failed."""

    script: str
    anyway: bool


def steps(path: Path) -> Iterator[Step]:
    """Those that run gapeval."""
    document = yaml.safe_load(path.read_text())
    if path == GITHUB:
        for step in document["jobs"]["gate"]["steps"]:
            if "gapeval " in step.get("run", "").replace("pip install", ""):
                yield Step(step["run"], "always()" in str(step.get("if")))
    else:
        for line in document["gap-detection"]["script"]:
            yield Step(line, False)


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the workflows expect, with its baseline, in the working folder."""
    monkeypatch.chdir(tmp_path)
    for place, source in {
        "log/drive.mcap": COMMITTED / "street" / "street.mcap",
        "ci/labels.geojson": COMMITTED / "street" / "labels.geojson",
        "ci/gate.yaml": CONFIGS / "simulated.yaml",
    }.items():
        (tmp_path / place).parent.mkdir(exist_ok=True)
        shutil.copy(source, place)
    sweep = next(steps(GITHUB)).script
    assert gapeval(*shlex.split(sweep)[1:]).status == 0
    assert "`gapeval baseline results/ -o ci/baseline.csv`" in GITHUB.read_text()
    assert gapeval("baseline", "results/", "-o", "ci/baseline.csv").status == 0
    shutil.rmtree("results")
    return tmp_path


def run(path: Path) -> list[int]:
    """The exit status of each step, as a runner would go on with them."""
    programs = Path(sys.executable).parent
    environment = os.environ | {
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "GITHUB_STEP_SUMMARY": str(Path("summary.md").absolute()),
    }
    statuses: list[int] = []
    for step in steps(path):
        if step.anyway or not any(statuses):
            shell = ["bash", "-e", "-o", "pipefail", "-c", step.script]
            statuses.append(subprocess.run(shell, env=environment, capture_output=True).returncode)
    return statuses


@pytest.mark.parametrize("path", [GITHUB, GITLAB], ids=lambda path: path.name)
def test_a_workflow_passes_and_leaves_its_files(path: Path, repository: Path) -> None:
    assert run(path) == [0] * len(list(steps(path)))
    assert ElementTree.parse("compare.xml").getroot().tag in ("testsuite", "testsuites")
    assert Path("report.html").stat().st_size > 10_000


@pytest.mark.parametrize("path", [GITHUB, GITLAB], ids=lambda path: path.name)
def test_a_workflow_fails_by_the_gate_alone(path: Path, repository: Path) -> None:
    # Gaps that were found before: what was on the plane is now called an obstacle.
    config = Path("ci/gate.yaml")
    worse = config.read_text().replace("ground_z: -0.1", "ground_z: -0.25")
    config.write_text(worse)
    statuses = run(path)
    assert sorted(statuses)[-2:] == [0, 3]
    assert ElementTree.parse("compare.xml").findall(".//failure")
    assert Path("report.html").exists()


def commands(path: Path) -> set[str]:
    """Every line of gapeval's in a file, comments and all."""
    found = {match[0].split(" || ")[0].rstrip("`.") for match in WRITTEN.finditer(path.read_text())}
    return {line for line in found if line.split()[1] in cli.commands}


def test_every_command_that_is_written_is_run() -> None:
    for path in (GITHUB, GITLAB):
        ran = {step.script.split(" || ")[0].strip() for step in steps(path)}
        ran |= {SIMULATED_INSTEAD, "gapeval baseline results/ -o ci/baseline.csv"}
        assert {line.partition("` ")[0] for line in commands(path)} <= ran


SIMULATED_INSTEAD = "gapeval simulate street --sensor vlp16 --frames 10 --density 0.15 -o log/"


def test_the_log_may_be_simulated_instead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert f"run: {SIMULATED_INSTEAD}\n" in GITHUB.read_text()
    assert gapeval(*shlex.split(SIMULATED_INSTEAD)[1:]).status == 0
    assert "sweep log/street.mcap with log/labels.geojson then" in GITHUB.read_text()
    assert sorted(path.name for path in Path("log").iterdir()) == ["labels.geojson", "street.mcap"]


def test_the_workflow_of_github_may_only_read_and_uploads_whatever_came_out() -> None:
    document = yaml.safe_load(GITHUB.read_text())
    assert document["permissions"] == {"contents": "read"}
    uploads = [
        step for step in document["jobs"]["gate"]["steps"] if "upload-artifact" in step.get("uses", "")
    ]
    assert [step["if"] for step in uploads] == ["${{ always() }}"]
    assert "report.html" in uploads[0]["with"]["path"].splitlines()


def test_gitlab_reads_the_test_report_whatever_came_out() -> None:
    artifacts = yaml.safe_load(GITLAB.read_text())["gap-detection"]["artifacts"]
    assert artifacts["when"] == "always"
    assert artifacts["reports"] == {"junit": "compare.xml"}
