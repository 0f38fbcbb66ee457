"""The same verdict with any number of workers and on another machine."""

import math
from pathlib import Path

import numpy as np
import pytest
from command import gapeval
from result_folders import GRID, Texts, compared, copied, edited, shown, table, write_table

from gapeval.compare.outcome import FINE, REGRESSION
from gapeval.report.comparisons import FORMATS
from gapeval.results.tables import FILES, PARAMETERS

GIVEN = {"log", "stamp", "configuration", *PARAMETERS}  # as the configuration says it
REAL = {name for columns in FILES.values() for name in columns} - GIVEN
TABLES = ("summary.csv", "frames.csv", "labels.csv")


def nudged(folder: Path, seed: int) -> Path:
    """Every real figure of every table by up to 4 units in the last place."""
    random = np.random.default_rng(seed)

    def nudge(row: Texts) -> Texts:
        return row | {name: nudged_text(row[name]) for name in REAL & set(row)}

    def nudged_text(text: str) -> str:
        if ("." not in text and "e" not in text) or not text.lstrip("-")[:1].isdigit():
            return text
        value = float(text)
        for _ in range(random.integers(0, 5)):
            value = math.nextafter(value, random.choice([-math.inf, math.inf]))
        return repr(value)

    for name in TABLES:
        before = (folder / name).read_bytes()
        edited(folder, nudge, name)
        assert (folder / name).read_bytes() != before
    return folder


def test_sweeps_with_any_number_of_workers_compare_alike(
    results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against a baseline of the same sweep, and of one at another threshold, with regressions and all."""
    source = results.parent
    logs, drawn = (source / "a.mcap", source / "b.mcap"), source / "labels.geojson"
    for name, folder in (("same.csv", results), ("other.csv", nudged_grid(results, tmp_path))):
        assert gapeval("baseline", folder, "-o", tmp_path / name).status == 0
    said = []
    for jobs in (1, 3):
        (tmp_path / str(jobs)).mkdir()
        monkeypatch.chdir(tmp_path / str(jobs))
        done = gapeval("sweep", *logs, "--labels", drawn, *GRID, "-o", "results", "--jobs", jobs)
        assert done.status == 0, done.err
        Path("results/timing.csv").unlink()  # the one thing that differs from run to run
        said.append(
            {
                (name, form): gapeval("compare", tmp_path / name, "results", "--format", form)
                for name in ("same.csv", "other.csv")
                for form in FORMATS
            }
        )
    assert said[0] == said[1]
    assert {name: result.status for (name, _), result in said[0].items()} == {
        "same.csv": FINE,
        "other.csv": REGRESSION,
    }


def nudged_grid(results: Path, tmp_path: Path) -> Path:
    """The same rows, but each configuration did what the next one does."""
    folder = copied(results, tmp_path / "turned")
    ids = list(dict.fromkeys(row["configuration"] for row in table(folder / "summary.csv")))
    for name in TABLES:
        rows = table(folder / name)
        parameters = {row["configuration"]: {key: row.get(key) for key in ("n_o", "pl_th")} for row in rows}

        def turn(row: Texts, parameters: dict[str, dict[str, str | None]] = parameters) -> Texts:
            following = ids[(ids.index(row["configuration"]) + 1) % len(ids)]
            given = {key: text for key, text in parameters[following].items() if text is not None}
            return row | {"configuration": following} | given

        edited(folder, turn, name)
    return folder


@pytest.mark.parametrize("seed", range(3))
def test_last_bits_change_no_verdict(results: Path, tmp_path: Path, seed: int) -> None:
    same = nudged(copied(results, tmp_path / "same"), seed)
    assert gapeval("baseline", results, "-o", tmp_path / "baseline.csv").status == 0
    for base in (results, tmp_path / "baseline.csv"):
        status, document = shown(base, same)
        assert status == FINE
        assert {row["mark"] for row in document["rows"]} == {" "}


@pytest.mark.parametrize("seed", range(3))
def test_last_bits_change_no_list_of_what_is_worse(results: Path, tmp_path: Path, seed: int) -> None:
    other = nudged_grid(results, tmp_path)
    _, exact = shown(results, other)
    _, near = shown(results, nudged(copied(other, tmp_path / "near"), seed))
    for one, two in zip(exact["rows"], near["rows"], strict=True):
        for key in ("log", "configuration", "mark", "frames", "labels", "unknown"):
            assert one[key] == two[key]
        changes = [
            {
                change["metric"]: (change["mark"], (change["noise"] or {}).get("beyond"))
                for change in row["changes"]
            }
            for row in (one, two)
        ]
        assert changes[0] == changes[1]


def test_last_bits_sort_nothing(results: Path, tmp_path: Path) -> None:
    """What is as bad stays in the order of the grid, and figures in that of their columns."""
    base = edited(copied(results, tmp_path / "base"), lambda row: row | {"pq": "0.3", "recall": "0.3"})
    new = edited(copied(base, tmp_path / "new"), lambda row: row | {"pq": "0.1", "recall": "0.1"})
    rows = table(new / "summary.csv")
    for at, row in enumerate(rows):
        for name, sign in (("pq", -1), ("recall", 1)):
            row[name] = repr(0.1 * (1 + sign * at * 2.0**-52))
    write_table(new / "summary.csv", rows)
    for pair, mark in (((base, new), "+"), ((new, base), "-")):
        found = compared(*pair)
        assert [(row.mark, row.log, row.configuration) for row in found.rows] == [
            (mark, row["log"], row["configuration"]) for row in rows
        ]
        assert {tuple(change.metric for change in row.changes) for row in found.rows} == {("recall", "pq")}
