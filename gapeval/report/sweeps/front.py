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
from gapeval.report.sweeps.recommendation import Recommendation
from gapeval.report.sweeps.results import Results
from gapeval.report.sweeps.times import Times
from gapeval.report.text import counted, short
from gapeval.results.written import Row, number

EQUAL = 1.1  # times within a factor of about this count as equal: they were measured on a busy machine
LISTED = 24  # rows of the table
RECOMMENDED, HIGHEST = "recommended", "highest pq"


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


@dataclass(frozen=True, slots=True)
class Entry:
    """A row of the table. mark: whether it is the recommended one, or that of the highest pq."""

    number: int
    one: Candidate
    mark: str


def front_exhibit(
    results: Results, advised: Recommendation, measured: Times, source: str, times_source: str
) -> Exhibit | None:
    """Hit rate against false gaps, by time."""
    found = candidates(results.overall, measured.seconds)
    if len(found) < 2:
        return None
    best = front(found)
    entries = _entries(found, best, advised)
    timed = [one.seconds for one in found if one.seconds is not None]
    limits = tuple(np.quantile(timed, [1 / 3, 2 / 3]).tolist()) if timed else ()
    kinds = _kinds(limits)
    (here,) = [entry.one for entry in entries if RECOMMENDED in entry.mark]
    time_words = (
        "Times: detection and crossings of one frame by each configuration alone, best of three, median over "
        f"{counted(measured.frames, 'frame')} of {measured.log}; times within about a tenth count as equal."
        if timed
        else f"No times: {measured.missing}."
    )
    return Exhibit(
        name="front",
        title="Hit rate against false gaps against time" if timed else "Hit rate against false gaps",
        drawings=(
            Scatter(
                title="",
                x_label="fp_per_frame: false gaps per frame, fewer is better (by its root)",
                y_label="hit_rate, higher is better",
                dots=_dots(found, best, entries, limits),
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
        caption=f"{_caption(found, best, entries)} {time_words}",
        source=f"{source}, rows with log = all" + (f"; {times_source}, column median" if timed else ""),
        table=_table(results, entries),
        open=True,
    )


def _entries(found: Sequence[Candidate], best: Sequence[Candidate], advised: Recommendation) -> list[Entry]:
    """The first of the front, and after them what is marked and not among them."""
    names = {RECOMMENDED: advised.row["configuration"], HIGHEST: advised.best["configuration"]}
    marked = [one for one in found if one.row["configuration"] in names.values()]
    listed = [*best[:LISTED], *(one for one in marked if one not in best[:LISTED])]
    return [
        Entry(place, one, ", ".join(word for word, name in names.items() if name == one.row["configuration"]))
        for place, one in enumerate(listed, 1)
    ]


def _caption(found: Sequence[Candidate], best: Sequence[Candidate], entries: Sequence[Entry]) -> str:
    """What is numbered, what is not, and where the marked ones are."""
    words = [
        f"{len(best)} of {len(found)} configurations are beaten by no other in all of these at once: they "
        "have large markers, with their number in the table. Small dots, without a number, are the others."
    ]
    if len(best) > LISTED:
        words.append(
            f"Numbers and table end with the first {LISTED}; large markers without a number are the rest."
        )
    (here,) = [entry for entry in entries if RECOMMENDED in entry.mark]
    (highest,) = [entry for entry in entries if HIGHEST in entry.mark]
    if here is highest:
        words.append(
            f"Ringed: no. {here.number}, the recommended configuration, which has the highest pq too."
        )
    else:
        words.append(
            f"Ringed: no. {here.number}, the recommended configuration; "
            f"no. {highest.number} has the highest pq."
        )
    words += [
        f"No. {entry.number} is beaten by others here; it was chosen by its pq."
        for entry in entries
        if entry.mark and entry.one not in best
    ]
    return " ".join(words)


def _dots(
    found: Sequence[Candidate], best: Sequence[Candidate], entries: Sequence[Entry], limits: Sequence[float]
) -> tuple[Dot, ...]:
    """Of those at one place the first has the numbers of all."""
    at: dict[tuple[float, float], list[Entry]] = {}
    for entry in entries:
        at.setdefault((entry.one.false_gaps, entry.one.hit_rate), []).append(entry)
    large = [*best, *(entry.one for entry in entries if entry.one not in best)]
    dots = []
    for one in large:
        kind = sum(one.seconds > limit for limit in limits) if one.seconds is not None else 0
        here = at.pop((one.false_gaps, one.hit_rate), [])
        dots.append(Dot(one.false_gaps, one.hit_rate, kind, numbers(here)))
    ids = {one.row["configuration"] for one in large}
    small = (one for one in found if one.row["configuration"] not in ids)
    return (*dots, *(Dot(one.false_gaps, one.hit_rate, None) for one in small))


def numbers(entries: Sequence[Entry]) -> str:
    """`1, 4 recommended, 6 to 9`: marked ones by themselves, three or more in a row as a range."""
    runs: list[list[Entry]] = []
    for entry in entries:
        follows = (
            runs and not entry.mark and not runs[-1][-1].mark and entry.number == runs[-1][-1].number + 1
        )
        if follows:
            runs[-1].append(entry)
        else:
            runs.append([entry])
    words = []
    for run in runs:
        each = [f"{entry.number} {entry.mark}".rstrip() for entry in run]
        words += [f"{each[0]} to {each[-1]}"] if len(run) > 2 else each
    return ", ".join(words)


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


def _table(results: Results, entries: Sequence[Entry]) -> Table:
    """What it is about comes first: of many parameters a narrow page shows the first columns."""
    head = (
        "no.",
        "",
        "time [ms]",
        "hit_rate",
        "fp_per_frame",
        "pq",
        *map(label, results.varied),
        "configuration",
    )
    rows = tuple(
        (
            str(entry.number),
            entry.mark,
            "-" if entry.one.seconds is None else f"{1e3 * entry.one.seconds:.2f}",
            short(entry.one.hit_rate),
            short(entry.one.false_gaps),
            short(number(entry.one.row, "pq")),
            *(entry.one.row[name] or "(empty)" for name in results.varied),
            entry.one.row["configuration"],
        )
        for entry in entries
    )
    return Table(head, rows)
