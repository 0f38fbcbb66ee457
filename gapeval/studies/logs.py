"""The simulated logs of studies: made once, in several processes, and found again."""

import json
from collections.abc import Callable, Iterable
from pathlib import Path

from gapeval.files import make_folder, write_whole
from gapeval.logs.write import log_path
from gapeval.simulate.log import LABELS, write_simulation
from gapeval.studies.cases import Case, Given, Recipe
from gapeval.sweep.provenance import simulator
from gapeval.sweep.units import StoppedError

LOGS, MADE_BY = "logs", "made_by.json"
CONTAINER = "mcap"


def place(case: Case, folder: Path) -> Given:
    """A case's log and labels: the user's, or where they are simulated to."""
    if isinstance(case.source, Given):
        return case.source
    home = folder / LOGS / case.source.name
    return Given(log_path(home, case.source.scene, CONTAINER), home / LABELS)


def missing(cases: Iterable[Case], folder: Path) -> list[Recipe]:
    """The simulated logs that are not there, or that another version of the simulator made."""
    recipes = dict.fromkeys(case.source for case in cases if isinstance(case.source, Recipe))
    return [recipe for recipe in recipes if not _is_there(recipe, folder)]


def make(recipe: Recipe, folder: Path, stopped: Callable[[], bool]) -> None:
    """Simulate a log; it counts as there only when it is whole. Raises StoppedError between two clouds."""

    def advance() -> None:
        if stopped():
            raise StoppedError

    home = folder / LOGS / recipe.name
    make_folder(home)
    for path in (home / MADE_BY, home / LABELS, log_path(home, recipe.scene, CONTAINER)):
        path.unlink(missing_ok=True)
    write_simulation(recipe.simulation(), home, CONTAINER, advance)
    write_whole(home / MADE_BY, _made_by().encode())


def _is_there(recipe: Recipe, folder: Path) -> bool:
    home = folder / LOGS / recipe.name
    try:
        return (home / MADE_BY).read_text(encoding="utf-8") == _made_by()
    except OSError:
        return False


def _made_by() -> str:
    return json.dumps(simulator(), indent=2) + "\n"
