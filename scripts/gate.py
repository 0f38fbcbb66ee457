"""Our own regression gate: what comes out of sweeps over fixed logs, held against committed baselines.

Exit status: 0 fine, 3 worse than a baseline, 4 not comparable with one, anything else an error, which weighs
most. All logs are looked at, whatever came out of the first.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click

from gapeval.compare.outcome import FINE, NOT_COMPARABLE, REGRESSION

ROOT = Path(__file__).parent.parent
COMMITTED, CONFIGS = ROOT / "data" / "ci", ROOT / "configs" / "ci"
OUTPUT = ROOT / "out" / "gate"
ORDER = (FINE, REGRESSION, NOT_COMPARABLE)  # the mildest first; what is not among them is an error


@dataclass(frozen=True, slots=True)
class Case:
    """Logs with their labels that are swept together, and held against one baseline."""

    name: str
    logs: tuple[Path, ...]
    labels: tuple[Path, ...]
    config: Path
    baseline: Path


SIMULATED = Case(
    "simulated",
    (COMMITTED / "street" / "street.mcap", COMMITTED / "approach" / "approach.mcap"),
    (COMMITTED / "street" / "labels.geojson", COMMITTED / "approach" / "labels.geojson"),
    CONFIGS / "simulated.yaml",
    COMMITTED / "simulated.baseline.csv",
)


def os1_street(data: Path) -> Case:
    """The real log, in a folder of such."""
    folder = data / "os1_street"
    return Case(
        "os1_street",
        (folder / "os1_street.mcap",),
        (folder / "labels.geojson",),
        CONFIGS / "os1_street.yaml",
        COMMITTED / "os1_street.baseline.csv",
    )


@click.command(help=__doc__)
@click.option(
    "--renew", "reason", metavar="REASON", help="Make the baselines anew, and say why in their history."
)
def main(reason: str | None) -> None:
    cases = [SIMULATED]
    if data := os.environ.get("GAPEVAL_DATA"):
        cases.append(os1_street(Path(data)))
    else:
        click.echo("os1_street is left out: GAPEVAL_DATA is not set", err=True)
    done = compared if reason is None else partial(renewed, reason=reason)
    sys.exit(worst(each(cases, OUTPUT, done)))


def each(cases: Iterable[Case], output: Path, done: Callable[[Case, Path], int]) -> list[int]:
    """The exit status of each case: that of its sweep, or of what is done with the results."""
    statuses = []
    for case in cases:
        click.echo(f"{case.name}:", err=True)
        results = output / case.name
        shutil.rmtree(results, ignore_errors=True)
        statuses.append(swept(case, results) or done(case, results))
    return statuses


def swept(case: Case, results: Path) -> int:
    """Its output is shown only if it fails."""
    process = subprocess.run(sweep_command(case, results), capture_output=True, text=True)
    if process.returncode:
        click.echo(process.stderr, err=True, nl=False)
    return process.returncode


def sweep_command(case: Case, results: Path, *options: str) -> list[str]:
    labels = [argument for path in case.labels for argument in ("--labels", here(path))]
    logs = map(here, case.logs)
    return [*GAPEVAL, "sweep", *logs, *labels, "--config", here(case.config), "-o", here(results), *options]


def compared(case: Case, results: Path) -> int:
    options = ["--format", "github"] if os.environ.get("GITHUB_ACTIONS") == "true" else []
    command = [*GAPEVAL, "compare", here(case.baseline), here(results), *options]
    return subprocess.run(command).returncode


def renewed(case: Case, results: Path, reason: str) -> int:
    command = [*GAPEVAL, "baseline", here(results), "-o", here(case.baseline), "--reason", reason]
    return subprocess.run(command).returncode


def worst(statuses: Sequence[int]) -> int:
    """One for all: an error before what is not comparable, and that before a regression."""
    errors = [status for status in statuses if status not in ORDER]
    return errors[0] if errors else max(statuses, key=ORDER.index, default=FINE)


def here(path: Path) -> str:
    """As short as it can be said from here."""
    return os.path.relpath(path)


GAPEVAL = (sys.executable, "-P", "-m", "gapeval")  # -P: not whatever lies in the working folder

if __name__ == "__main__":
    main()
