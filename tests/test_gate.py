"""Our own gate: it catches what is broken on purpose, and lets pass what only looks different."""

import csv
import json
import os
import subprocess
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest
from broken import Edit, copy_with, run_copy
from command import gapeval
from gate import SIMULATED, Case, compared, each, main, os1_street, renewed, sweep_command, worst
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from gapeval.compare.outcome import FINE, REGRESSION
from gapeval.report.comparisons import FORMATS
from gapeval.scoring.metrics import METRICS
from gapeval.sweep.provenance import source

JOBS = ("--jobs", "2")


@pytest.fixture(params=["simulated", "os1_street"])
def case(request: pytest.FixtureRequest) -> Case:
    if request.param == "simulated":
        return SIMULATED
    return os1_street(request.getfixturevalue("real_data"))


@dataclass(frozen=True, slots=True)
class Breakage:
    """worse: metrics that get worse in some row, and no others if `alone`. same: those that never change."""

    edit: Edit
    worse: frozenset[str]
    same: frozenset[str] = frozenset()
    alone: bool = False


BREAKAGES = {
    # Eq. (1) with the other sign: floors of gaps are obstacles, and what stands on the ground is none.
    "plane sign": Breakage(
        Edit("detection/surface.py", "    t = plane.distance(points)\n", "    t = -plane.distance(points)\n"),
        frozenset({"coverage", "pq", "near_edge_missed", "fp_per_frame", "shadow_gaps"}),
    ),
    # Obstacles hide nothing but themselves: the ground behind them is a gap.
    "occlusion off": Breakage(
        Edit(
            "detection/surface.py",
            "shaded = np.logical_or.accumulate(obstacle, axis=0)",
            "shaded = obstacle",
        ),
        frozenset({"shadow_gaps", "fp_per_frame", "over_area", "over_coverage", "precision"}),
    ),
    # All is one column too far to the right.
    "one-cell shift": Breakage(
        Edit(
            "detection/surface.py",
            "np.arange(-margin, grid.width + margin)",
            "np.arange(1 - margin, grid.width + margin + 1)",
        ),
        frozenset({"coverage", "over_area", "over_coverage", "sq", "pq", "near_edge_late"}),
    ),
    # Ground within a gap is part of it.
    "lost holes": Breakage(
        Edit("detection/contours.py", "for hole in np.flatnonzero(parent >= 0).tolist():", "for hole in ():"),
        frozenset({"over_area", "over_coverage"}),
        frozenset({"hit_rate", "fp_per_frame", "near_edge_error", "npca_length_error", "npca_yaw_error"}),
    ),
    # By npca, gaps are crossed along their longer side.
    "wrong eigenvector": Breakage(
        Edit("traversability/axes.py", "covariance, eigenvector=1)", "covariance, eigenvector=0)"),
        frozenset({"npca_length_error", "npca_yaw_error"}),
        frozenset({"hit_rate", "coverage", "over_area", "pq", "pca_length_error", "pca_yaw_error"}),
        alone=True,
    ),
}

# Another order of summing (the only one that moves last bits), equivalent conditions, another name.
REFACTORING = (
    Edit(
        "scoring/metrics.py",
        "np.divide(above, below, out=undefined, where=below != 0)",
        "np.multiply(above, np.divide(1.0, below, out=undefined, where=~(below == 0)))",
    ),
    Edit(
        "scoring/match.py",
        "np.array([sum(of, 0.0) for of in covered.tolist()])",
        "np.array([sum(reversed(of), 0.0) for of in covered.tolist()])",
    ),
    Edit(
        "traversability/axes.py",
        "sums(normal[:, :, None] * normal[:, None, :] * length[:, None, None], owner, len(gaps))",
        "sums(length[:, None, None] * normal[:, None, :] * normal[:, :, None], owner, len(gaps))",
    ),
    Edit(
        "detection/surface.py",
        "ground, obstacle = table.least <= pl_th, table.highest > pl_th",
        "ground, obstacle = pl_th >= table.least, ~(table.highest <= pl_th)",
    ),
    Edit("detection/contours.py", "_doubtful", "_perhaps_invalid", times=2),
)


def swept_by_copy(case: Case, edits: tuple[Edit, ...], folder: Path) -> Path:
    """Results of the case by a copy of the package with these edits."""
    results = folder / "results"
    run_copy(copy_with(edits, folder / "copy"), sweep_command(case, results, *JOBS))
    said = json.loads((results / "manifest.json").read_text())
    assert said["source"] != source()  # nobody but the copy has been at work
    return results


def comparison(case: Case, results: Path) -> tuple[int, dict]:
    done = gapeval("compare", case.baseline, results, "--format", "json")
    assert done.out, done.err
    return done.status, json.loads(done.out)


def metrics(document: dict, marks: str) -> set[str]:
    """Those that have one of these marks in any row."""
    return {
        change["metric"] for row in document["rows"] for change in row["changes"] if change["mark"] in marks
    }


@pytest.mark.parametrize("name", BREAKAGES)
def test_what_is_broken_is_caught(name: str, case: Case, tmp_path: Path) -> None:
    breakage = BREAKAGES[name]
    status, found = comparison(case, swept_by_copy(case, (breakage.edit,), tmp_path))
    changed, worse = metrics(found, "+!-*~"), metrics(found, "+!")
    assert breakage.same.isdisjoint(changed)
    if name == "wrong eigenvector" and case.name == "os1_street":
        # No label there says how its gap is crossed: all that moves is what has no better direction.
        assert (status, worse) == (FINE, set())
        assert "axis_angle" in changed
    else:
        assert status == REGRESSION
        assert worse == breakage.worse if breakage.alone else worse >= breakage.worse


def test_a_pure_refactoring_passes(case: Case, tmp_path: Path) -> None:
    assert sum(edit.times for edit in REFACTORING) > 3
    results = swept_by_copy(case, REFACTORING, tmp_path)
    status, found = comparison(case, results)
    assert (status, metrics(found, "+!-*~x")) == (FINE, set())
    assert found["verdict"].startswith("fine: ")
    assert last_bits_that_differ(case, results) > 20


def last_bits_that_differ(case: Case, results: Path) -> int:
    """How many figures of summary.csv are not the same text as in the baseline."""
    with case.baseline.open(newline="") as file:
        before = list(csv.DictReader(line for line in file if not line.startswith("# ")))
    with (results / "summary.csv").open(newline="") as file:
        after = list(csv.DictReader(file))
    kept = [row for row in before if not row["stamp"]]
    assert len(kept) == len(after)
    return sum(
        one[metric.name] != other[metric.name]
        for one, other in zip(kept, after, strict=True)
        for metric in METRICS
    )


# Whole code


def test_the_code_as_it_is_passes_with_any_number_of_workers(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = []
    for jobs in (1, 3):
        folder = tmp_path / str(jobs)
        folder.mkdir()
        monkeypatch.chdir(folder)  # so that both are called the same
        done = subprocess.run(sweep_command(case, Path("results"), "--jobs", str(jobs)), capture_output=True)
        assert done.returncode == 0, done.stderr
        Path("results/timing.csv").unlink()  # the one thing that differs from run to run
        compared = {form: gapeval("compare", case.baseline, "results", "--format", form) for form in FORMATS}
        assert {form: result.status for form, result in compared.items()} == dict.fromkeys(FORMATS, FINE)
        said.append(compared)
    assert said[0] == said[1]


def test_the_verdict_is_the_same_with_the_arithmetic_of_another_processor(case: Case, tmp_path: Path) -> None:
    here = [name for name in __cpu_dispatch__ if __cpu_features__.get(name)]
    if not here:
        pytest.skip("numpy has but one way to calculate on this processor")
    environment = os.environ | {"NPY_DISABLE_CPU_FEATURES": " ".join(here)}
    done = subprocess.run(sweep_command(case, tmp_path, *JOBS), env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr
    status, found = comparison(case, tmp_path)
    assert (status, metrics(found, "+!-*~x")) == (FINE, set())


# The script


@pytest.mark.parametrize(
    ("statuses", "one"),
    [([], 0), ([0, 0], 0), ([0, 3], 3), ([4, 3], 4), ([1, 4], 1), ([3, 2], 2), ([4, -9, 0], -9)],
)
def test_errors_weigh_more_than_what_is_not_comparable_and_that_more_than_a_regression(
    statuses: list[int], one: int
) -> None:
    assert worst(statuses) == one


def test_all_logs_are_compared_even_if_the_first_fails(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    missing = replace(SIMULATED, name="missing", logs=(tmp_path / "none.mcap",), labels=())
    assert each([missing, SIMULATED], tmp_path, compared) == [1, FINE]
    shown = capfd.readouterr()
    assert "none.mcap" in shown.err
    assert shown.out.splitlines()[-1].startswith("fine: ")


def test_a_baseline_is_renewed_with_its_reason(tmp_path: Path) -> None:
    case = replace(SIMULATED, baseline=tmp_path / "mine.baseline.csv")
    for reason in ("first", "a better plane"):
        assert each([case], tmp_path, partial(renewed, reason=reason)) == [FINE]
    status, found = comparison(case, tmp_path / case.name)
    assert status == FINE
    assert [entry["reason"] for entry in found["base"]["history"]] == ["first", "a better plane"]


def test_without_real_logs_it_says_what_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("GAPEVAL_DATA", raising=False)
    monkeypatch.setattr("gate.OUTPUT", tmp_path)
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == FINE
    shown = capfd.readouterr()
    assert "os1_street is left out: GAPEVAL_DATA is not set" in shown.err
    assert [path.name for path in tmp_path.iterdir()] == ["simulated"]


def test_in_github_it_says_what_github_can_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary.md"))
    without_holes = swept_by_copy(SIMULATED, (BREAKAGES["lost holes"].edit,), tmp_path)
    assert compared(SIMULATED, without_holes) == REGRESSION
    said = capfd.readouterr().out.splitlines()
    assert said[0].startswith("::error ")
    assert "over_area" in "".join(said)
    assert "over_area" in (tmp_path / "summary.md").read_text()
