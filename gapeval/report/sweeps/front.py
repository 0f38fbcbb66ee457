"""The configurations that no other beats in hit rate, false gaps and time alike."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gapeval.frame import FloatArray
from gapeval.report.curves.scatter import Dot, Scatter
from gapeval.report.curves.style import Look
from gapeval.report.exhibit import Exhibit, Table
from gapeval.report.sweeps.parameters import label
from gapeval.report.sweeps.results import Results, Row, number
from gapeval.report.sweeps.times import Times
from gapeval.report.text import counted, short

EQUAL = 1.1  # times within a factor of about this count as equal: they were measured on a busy machine
LISTED = 24  # rows of the table
CLASSES = 3


@dataclass(frozen=True, slots=True)
class Candidate:
    """step: its time, in steps of EQUAL; 0 where no times are known."""

    row: Row
    hit_rate: float
    false_gaps: float
    step: int
    seconds: float | None


def candidates(rows: Sequence[Row], seconds: Mapping[str, float]) -> list[Candidate]:
    """Those that were scored."""
    found = []
    for row in rows:
        hits, false = number(row, "hit_rate"), number(row, "fp_per_frame")
        if hits is not None and false is not None:
            took = seconds.get(row["configuration"])
            found.append(Candidate(row, hits, false, _step(took), took))
    return found


def _step(seconds: float | None) -> int:
    return 0 if not seconds else round(math.log(seconds) / math.log(EQUAL))


def front(of: Sequence[Candidate]) -> list[Candidate]:
    """Those that no other equals or betters in all three and betters in one: most hits first."""
    aims = np.array([(-one.hit_rate, one.false_gaps, one.step) for one in of]).reshape(-1, 3)
    kept = [one for one, beaten in zip(of, dominated(aims).tolist(), strict=True) if not beaten]
    return sorted(kept, key=lambda one: (-one.hit_rate, one.false_gaps, one.step, one.seconds or 0.0))


def dominated(aims: FloatArray) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """(N,): whether another row of aims (N, M), of which less is better, is nowhere worse and once better."""
    beaten = np.zeros(len(aims), dtype=np.bool_)
    for index, one in enumerate(aims):
        beaten[index] = bool(((aims <= one).all(axis=1) & (aims < one).any(axis=1)).any())
    return beaten


def front_exhibit(
    results: Results, base: Row, measured: Times, source: str, times_source: str
) -> Exhibit | None:
    """Hit rate against false gaps, by time."""
    found = candidates(results.overall, measured.seconds)
    if len(found) < 2:
        return None
    best = front(found)
    timed = [one.seconds for one in found if one.seconds is not None]
    limits = tuple(np.quantile(timed, [1 / 3, 2 / 3]).tolist()) if timed else ()
    kinds = _kinds(limits)
    on_front = {one.row["configuration"]: rank for rank, one in enumerate(best, 1)}
    dots = tuple(_dot(one, on_front, limits) for one in _in_order(found, on_front))
    (here,) = [one for one in found if one.row["configuration"] == base["configuration"]] or [found[0]]
    time_words = (
        "Times: detection and crossings of one frame by each configuration alone, best of three, median over "
        f"{counted(measured.frames, 'frame')} of {measured.log}; times within about a tenth count as equal."
        if timed
        else f"No times: {measured.missing}."
    )
    more = f" The table has the first {LISTED} of {len(best)}." if len(best) > LISTED else ""
    return Exhibit(
        name="front",
        title="Hit rate against false gaps against time" if timed else "Hit rate against false gaps",
        drawings=(
            Scatter(
                title="",
                x_label="fp_per_frame: false gaps per frame, fewer is better (by its root)",
                y_label="hit_rate, higher is better",
                dots=dots,
                kinds=len(kinds),
                edge=_edge(best),
                mark=(here.false_gaps, here.hit_rate),
                alt=(
                    f"Hit rate against false gaps per frame of {len(found)} configurations; "
                    f"{len(best)} are beaten by no other. They are in the table below."
                ),
            ),
        ),
        legend=tuple((name, Look(kind, joined=False)) for kind, name in enumerate(kinds)),
        caption=(
            f"{len(best)} of {len(found)} configurations are beaten by no other in all of these at once; "
            "small dots are the others. Numbers: rows of the table. Ringed: the configuration above. "
            f"{time_words}{more}"
        ),
        source=f"{source}, rows with log = all" + (f"; {times_source}, column median" if timed else ""),
        table=_table(results, best),
        open=True,
    )


def _in_order(found: Sequence[Candidate], ranks: Mapping[str, int]) -> list[Candidate]:
    return sorted(found, key=lambda one: ranks.get(one.row["configuration"], len(found) + 1))


def _dot(one: Candidate, ranks: Mapping[str, int], limits: Sequence[float]) -> Dot:
    rank = ranks.get(one.row["configuration"])
    if rank is None:
        return Dot(one.false_gaps, one.hit_rate, None)
    kind = sum(one.seconds > limit for limit in limits) if one.seconds is not None else 0
    return Dot(one.false_gaps, one.hit_rate, kind, str(rank) if rank <= LISTED else "")


def _kinds(limits: Sequence[float]) -> tuple[str, ...]:
    if not limits:
        return ("not timed",)
    low, high = (f"{1e3 * limit:.2g} ms" for limit in limits)
    return (f"up to {low}", f"{low} to {high}", f"more than {high}")


def _edge(best: Sequence[Candidate]) -> tuple[tuple[float, float], ...]:
    """Along those that are the best without regard to time, fewest false gaps first."""
    corners: list[tuple[float, float]] = []
    for false, hits in sorted((one.false_gaps, -one.hit_rate) for one in best):
        if not corners or -hits > corners[-1][1]:
            corners.append((false, -hits))
    return tuple(corners)


def _table(results: Results, best: Sequence[Candidate]) -> Table:
    head = (
        "no.",
        "configuration",
        *map(label, results.varied),
        "hit_rate",
        "fp_per_frame",
        "pq",
        "time [ms]",
    )
    rows = tuple(
        (
            str(rank),
            one.row["configuration"],
            *(one.row[name] or "(empty)" for name in results.varied),
            short(one.hit_rate),
            short(one.false_gaps),
            short(number(one.row, "pq")),
            "-" if one.seconds is None else f"{1e3 * one.seconds:.2f}",
        )
        for rank, one in enumerate(best[:LISTED], 1)
    )
    return Table(head, rows)
