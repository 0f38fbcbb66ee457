"""A study as its YAML says it: what is swept over which logs, what is drawn, which claims are judged."""

import sysconfig
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from gapeval.config import Section, read_yaml, validation_message
from gapeval.errors import ConfigError
from gapeval.simulate.layouts import SCENES
from gapeval.simulate.sensors import SENSORS

# In the order in which they are run: timing at the end, after all that keeps cores busy.
NAMES = (
    "delta_r",
    "resolution",
    "morphology",
    "plane_threshold",
    "values",
    "occlusion",
    "pose_error",
    "radius",
    "crossing",
    "sensors",
    "deviations",
    "timing",
)
Value = bool | int | float | str
Where = dict[str, Value]
By = Literal["label", "range", "bearing", "width", "position"]

WITHOUT_GAPS = {"plain", "slope"}
OF_SCENES = ("roughness", "slope", "obstacles", "density")  # conditions that a simulated log is made with
OF_POSES = ("roll", "pitch", "height")  # errors of robot<-cloud, with which any log is read
OF_NOISE = ("tilt_noise", "height_noise")  # standard deviations of such errors, drawn cloud by cloud


class Quick(Section):
    """What `--quick` runs instead."""

    scenes: tuple[str, ...] | None = None
    seeds: Annotated[int, Field(ge=1)] = 1
    frames: Annotated[int, Field(ge=1)] | None = None
    vary: dict[str, list[Value]] = {}
    grid: dict[str, list[Any]] = {}


class Run(Section):
    """One sweep of a study: a grid over logs, each under every combination of conditions.

    kind: `sweep`, `time` (each configuration alone), or `bins` (how radial bins match echoes).
    vary: conditions, each with its values. conditions: others, by which its rows are told from those of other
    runs. config: over the study's own. gaps: also say where false gaps are; only for scenes without labels.
    simulated: makes sense on simulated scenes only. A log of the user's is taken as it is, whatever is varied
    about scenes.
    """

    name: Annotated[str, Field(pattern=r"^[a-z0-9_-]+$")] = "runs"
    kind: Literal["sweep", "time", "bins"] = "sweep"
    sensor: str = "lms151"
    scenes: tuple[str, ...]
    seeds: Annotated[int, Field(ge=1)] = 5
    frames: Annotated[int, Field(ge=1)] | None = None
    vary: dict[str, list[Value]] = {}
    conditions: dict[str, Value] = {}
    config: dict[str, Any] = {}
    grid: dict[str, list[Any]] | None = None
    gaps: bool = False
    simulated: bool = False
    quick: Quick = Quick()


class Curve(Section):
    """One figure of the report: a panel for each of y, a line for each value of `lines`."""

    title: str = ""
    x: str
    y: list[str]
    lines: str | None = None
    where: dict[str, Any] = {}
    log_x: bool = False


class Figure(Section):
    """A measured figure, from rows of the study's CSV.

    of: its column, in the row that `where` picks. top: in the best of the rows that `where` leaves.
    minus: less that of the row where these differ, pairwise over logs. over: divided by it.
    best: instead, the value of this column whose row has the best `of`. fit: instead, R2 of a straight line
    of `of` against this column. weigh: instead, the probability that what is right comes from a smaller value
    of this column than what is false: a hit than a false gap (`of: fp_per_frame`), a covered m2 than one
    outside every label (`of: over_area`).
    """

    of: str
    where: Where = {}
    minus: Where = {}
    over: Where = {}
    top: bool = False
    best: str = ""
    fit: str = ""
    weigh: str = ""


class Claim(Section):
    """What the paper says, and the rule by which figures decide whether it holds.

    by: a column for each of whose values, or of those in `among`, the rule is asked; it holds partly if it
    holds for some.
    holds, partly: expressions over figures, each with `value`, `low` and `high`.
    """

    claim: Annotated[str, Field(pattern=r"^[a-z0-9_]+$")]
    section: str
    words: str
    figures: dict[str, Figure]
    where: Where = {}
    by: str = ""
    among: tuple[Value, ...] = ()
    holds: str
    partly: str = ""


class Study(Section):
    """A file of configs/studies/.

    labels_by: also rows for groups of labels: by `label`, `range`, `bearing`, `width`, or `position`, the
    place of the frame in its log.
    """

    title: str
    paper: str
    question: str
    says: str
    config: dict[str, Any] = {}
    grid: dict[str, list[Any]] = {}
    runs: Annotated[tuple[Run, ...], Field(min_length=1)]
    labels_by: tuple[By, ...] = ()
    curves: tuple[Curve, ...] = ()
    claims: tuple[Claim, ...] = ()


def studies_folder() -> Path:
    """configs/studies of this checkout, or where an installation has put it."""
    checkout = Path(__file__).parents[2] / "configs" / "studies"
    return checkout if checkout.is_dir() else Path(sysconfig.get_path("data"), "share", "gapeval", "studies")


def read_study(name: str) -> tuple[str, Study]:
    """A study of ours by its name, or anybody's by its file; and what it is called. Raises ConfigError."""
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        if name not in NAMES:
            raise ConfigError(f"{name}: no such study; there are {', '.join(NAMES)}, or name a .yaml file")
        path = studies_folder() / f"{name}.yaml"
    try:
        study = Study.model_validate(read_yaml(path))
    except ValidationError as error:
        raise ConfigError(f"{path}: {validation_message(error)}") from error
    _check(study, path)
    return path.stem, study


def _check(study: Study, path: Path) -> None:
    """Names that must be known before anything is run. Raises ConfigError."""
    known = {*OF_SCENES, *OF_POSES, *OF_NOISE}
    names = [run.name for run in study.runs]
    claims = [claim.claim for claim in study.claims]
    for claim in claims:
        if claims.count(claim) > 1:
            raise ConfigError(f"{path}: claims.{claim}: there is more than one claim of this name")
    for run in study.runs:
        where = f"{path}: runs.{run.name}"
        if names.count(run.name) > 1:
            raise ConfigError(f"{where}: there is more than one run of this name")
        for what, chosen, there in (
            ("scene", run.scenes + (run.quick.scenes or ()), SCENES),
            ("sensor", (run.sensor,), SENSORS),
            ("condition to vary", (*run.vary, *run.quick.vary), known),
        ):
            for one in chosen:
                if one not in there:
                    raise ConfigError(f"{where}: {one}: no such {what}; there are {', '.join(sorted(there))}")
        if run.gaps and not (run.simulated and {*run.scenes, *(run.quick.scenes or ())} <= WITHOUT_GAPS):
            raise ConfigError(
                f"{where}: gaps: all gaps count as false there; set `simulated: true`, and only scenes "
                f"without gaps: {', '.join(sorted(WITHOUT_GAPS))}"
            )
        for varied in (run.vary, run.quick.vary):
            for condition, values in varied.items():
                if not values:
                    raise ConfigError(f"{where}: vary.{condition}: no values; give at least one")
                for value in values:
                    if isinstance(value, str) or isinstance(value, bool) != (condition == "obstacles"):
                        kind = "true or false" if condition == "obstacles" else "a number"
                        raise ConfigError(f"{where}: vary.{condition}: {value!r}: must be {kind}")


def quickly(run: Run) -> Run:
    """The run that stands for this one where time is short."""
    quick = run.quick
    return run.model_copy(
        update={
            "scenes": quick.scenes or run.scenes,
            "seeds": min(quick.seeds, run.seeds),
            "frames": quick.frames or run.frames,
            "vary": run.vary | quick.vary,
            "grid": (run.grid or {}) | quick.grid if quick.grid else run.grid,
        }
    )


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values, those of `over` winning."""
    found = dict(base)
    for key, value in over.items():
        below = found.get(key)
        found[key] = (
            merged(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
        )
    return found
