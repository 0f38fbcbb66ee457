"""All of our studies: the quick ones whole, killed and finished; the full ones against the docs."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gapeval.studies.definition import NAMES

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parent.parent
VERDICTS = {"holds", "holds partly", "does not hold", "not measured"}


def studies(folder: Path, *arguments: object) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "gapeval", "study", "-o", folder, *arguments]
    return subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def results(folder: Path) -> dict[str, list[dict[str, str]]]:
    """All that is the same each time: without times."""
    found = {name: rows(folder / f"{name}.csv") for name in NAMES if name != "timing"}
    return found | {"claims": [row for row in rows(folder / "claims.csv") if row["study"] != "timing"]}


def test_quick_studies_are_the_same_for_any_number_of_workers_and_after_a_kill(tmp_path) -> None:
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    running = studies(whole, "--quick", "--jobs", 2)
    assert running.communicate()[1] is not None
    assert running.returncode == 0
    claims = rows(whole / "claims.csv")
    assert {row["study"] for row in claims} == set(NAMES)
    assert {row["verdict"] for row in claims} <= VERDICTS
    assert all(rows(whole / f"{name}.csv") for name in NAMES)
    killed = studies(stopped, "--quick", "--jobs", 1)
    while not (stopped / "morphology.csv").exists():
        assert killed.poll() is None
        time.sleep(0.2)
    os.kill(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert {row["study"] for row in rows(stopped / "claims.csv")} < set(NAMES)  # of those that were done
    resumed = studies(stopped, "--quick", "--jobs", 3)
    assert resumed.communicate()[1] is not None
    assert resumed.returncode == 0
    assert results(stopped) == results(whole)


def test_full_studies_come_to_the_verdicts_of_the_docs(tmp_path) -> None:
    """Renew docs/reproduction.md by scripts/reproduce, with a reason, where a change moves one."""
    running = studies(tmp_path, "--jobs", 2)
    running.communicate()
    assert running.returncode == 0
    page = (ROOT / "docs" / "reproduction.md").read_text(encoding="utf-8")
    lines = [[part.strip() for part in line.split("|")] for line in page.splitlines() if line.startswith("|")]
    documented = {line[-2]: line[2] for line in lines if line[2] in VERDICTS}
    found = {f"{row['study']}: {row['claim']}": row["verdict"] for row in rows(tmp_path / "claims.csv")}
    of_times = {name for name in found if name.startswith("timing: ")}
    assert {name: found[name] for name in found.keys() - of_times} == {
        name: documented[name] for name in documented.keys() - of_times
    }
