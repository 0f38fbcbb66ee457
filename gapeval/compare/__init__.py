"""Two results, or results and a baseline: what is worse, what is better, which frames and labels changed."""

from collections.abc import Iterator, Mapping, Sequence

from gapeval.compare.details import with_details
from gapeval.compare.limits import Limits
from gapeval.compare.outcome import MARKS, REGRESSIONS, Comparison, Row
from gapeval.compare.renamed import names_of, renamed
from gapeval.compare.rows import joined, judged, objections, rank, size
from gapeval.compare.side import Side
from gapeval.compare.times import times
from gapeval.config import Scoring
from gapeval.results.figures import FIGURES
from gapeval.results.store import ALL
from gapeval.results.tables import PARAMETERS
from gapeval.results.written import varied


def compare(base: Side, new: Side, limits: Limits) -> Comparison:
    """What NEW does worse and better than BASE, row by row, worst first."""
    names = names_of(base, new)
    new = renamed(new, names)
    against = objections(base, new)
    rows = [judged(pair, base, new, limits, against[pair.log]) for pair in joined(base, new)]
    rows = sorted(_without_echo(rows, base, new), key=_badness)
    block = float((new.scoring or {}).get("block", Scoring().block))
    return Comparison(
        base.origin,
        new.origin,
        with_details(rows, base, new, block),
        times(base, new, limits),
        varied([row.parameters for row in rows]),
        (*_renamings(names), *_notices(rows, base, new)),
    )


def _badness(row: Row) -> tuple[int, float]:
    """What rows are sorted by, worst first; equal ones stay in the order of the grid."""
    worse = [change for change in row.changes if change.mark in REGRESSIONS] or row.changes
    return rank(row.mark), -max(map(size, worse), default=0.0)


def _without_echo(rows: Sequence[Row], base: Side, new: Side) -> list[Row]:
    """Without rows of all logs that say what those of the only log say."""
    if len(base.logs | new.logs) > 1:
        return list(rows)
    said = {(row.was, row.configuration): row for row in rows if row.log != ALL}
    return [row for row in rows if row.log != ALL or not _echoes(row, said.get((row.was, row.configuration)))]


def _echoes(row: Row, other: Row | None) -> bool:
    return other is not None and (row.mark, row.base, row.new) == (other.mark, other.base, other.new)


def _renamings(names: Mapping[str, str]) -> Iterator[str]:
    for log, called in names.items():
        yield f"{called}: NEW calls it {log}; it is found by its contents, which are the same"


def _notices(rows: Sequence[Row], base: Side, new: Side) -> Iterator[str]:
    """What a reader must know that no row says."""
    renamed = sum(bool(row.was and row.was != row.configuration) for row in rows)
    if renamed:
        yield (
            f"{renamed} of {len(rows)} rows have another configuration id in NEW: the robot, the sensor or "
            "something else that is no column differs; see config.yaml"
        )
    yield from _moved(rows)
    for name, one, other in (("BASE", base, new), ("NEW", new, base)):
        missing = [metric for metric in FIGURES if metric not in one.rows[0] and metric in other.rows[0]]
        if missing:
            yield f"{name} has no column {', '.join(missing)}" + (": not compared" if one is base else "")
    for log in sorted(base.logs & new.logs):
        if base.scoring and new.scoring and not base.origin.logs.get(log) and not new.origin.logs.get(log):
            yield f"{log}: nothing says whether its contents are the same"


def _moved(rows: Sequence[Row]) -> Iterator[str]:
    """Where rows are gone and others have come: in which parameters those differ."""
    gone, come = [row for row in rows if not row.new], [row for row in rows if not row.base]
    if not gone or not come:
        return
    found = []
    for name in PARAMETERS:
        before, after = (sorted({row.parameters[name] for row in some}) for some in (gone, come))
        if before != after:
            found.append(f"{name} {', '.join(before) or '-'} -> {', '.join(after) or '-'}")
    if found:
        yield f"rows that are not in NEW and those that are not in BASE differ in {'; '.join(found)}"


def marks(comparison: Comparison) -> dict[str, int]:
    """How many rows there are of each mark, worst first; those of none are left out."""
    found = [row.mark for row in comparison.rows]
    return {mark: found.count(mark) for mark in MARKS if mark in found}
