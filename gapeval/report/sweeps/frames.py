"""The frames in which a configuration did worst and best."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gapeval.report.sweeps.results import Results
from gapeval.results.tables import FRAMES
from gapeval.results.written import Row, number, read_rows

COLUMNS = ("log", "stamp", "configuration", "gaps", "scored_frames", "asked", "hits", "false_gaps")
WORST = 3


@dataclass(frozen=True, slots=True)
class Choice:
    """A frame to draw. why: in words. kind: for what it is shown; `most` gaps, where no labels tell."""

    log: str
    stamp: int
    why: str
    kind: Literal["worst", "best", "alike", "most"]


def choose(rows: Sequence[Row]) -> list[Choice]:
    """The worst, by missed labels and false gaps together, then the best: fewest of them, most hits.

    rows: of frames.csv, of one configuration. No frame is both; a single one is worst if it has a fault.
    Where nothing was scored, the frame with the most gaps; where all scored alike, the first.
    """
    scored = [row for row in rows if number(row, "scored_frames")]
    if not scored:
        most = max(rows, key=lambda row: _count(row, "gaps"), default=None)
        return [] if most is None else [_choice(most, f"{most['gaps']} gaps, the most of all frames", "most")]
    if len(scored) > 1 and len(set(map(_told, scored))) == 1:
        return [_choice(scored[0], f"{_told(scored[0])}, as in all {len(scored)} frames", "alike")]
    ordered = sorted(scored, key=lambda row: (-_faults(row), _count(row, "hits")))
    last = ordered[-1]  # of equal ones the later in time
    faulty = [row for row in ordered if _faults(row) and (row is not last or len(ordered) == 1)]
    worst = [_choice(row, _told(row), "worst") for row in faulty[:WORST]]
    return worst if last in faulty else [*worst, _choice(last, _told(last), "best")]


def rows_of(results: Results, configuration: str) -> list[dict[str, str]]:
    """Of frames.csv, which may be large: the rows of one configuration."""
    path = results.folder / FRAMES
    return [row for row in read_rows(path, COLUMNS) if row["configuration"] == configuration]


def _count(row: Row, name: str) -> int:
    return int(number(row, name) or 0)


def _faults(row: Row) -> int:
    return _count(row, "asked") - _count(row, "hits") + _count(row, "false_gaps")


def _told(row: Row) -> str:
    asked, hits, false = (_count(row, name) for name in ("asked", "hits", "false_gaps"))
    gaps = "no false gap" if not false else f"{false} false gap" if false == 1 else f"{false} false gaps"
    return f"{hits} of {asked} labels hit, {gaps}"


def _choice(row: Row, why: str, kind: Literal["worst", "best", "alike", "most"]) -> Choice:
    return Choice(row["log"], int(row["stamp"]), why, kind)


def unshown(choices: Sequence[Choice]) -> str:
    """What the choice cannot show."""
    if not choices:
        return "No frame was evaluated."
    kind = choices[0].kind
    if kind == "most":
        return "No labels tell which frame is worst or best: the one with the most gaps is shown."
    if kind == "alike":
        return "All frames score alike, so that none is worst or best: the first is shown."
    return "" if kind == "worst" else "In no frame was a label missed or a gap false."
