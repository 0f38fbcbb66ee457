"""The section of a folder of studies in a page."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gapeval.report.curves.panel import Line, Panel, Point
from gapeval.report.curves.style import Look
from gapeval.report.exhibit import Exhibit, Table
from gapeval.report.studies.results import CLAIMS, Curve, Studies, Study, is_numeric
from gapeval.report.sweeps.parameters import BY_NAME, at_the_ends, label
from gapeval.report.sweeps.results import values_of
from gapeval.report.text import short
from gapeval.results.store import ALL
from gapeval.results.tables import PARAMETERS
from gapeval.results.written import Row, number

GROUP_UNITS = {"range": "m", "width": "m", "gap_range": "m", "bearing": "rad"}
VERDICTS = ("holds", "holds partly", "does not hold", "not measured")


@dataclass(frozen=True, slots=True)
class ShownStudy:
    """A study with the figures of those of its curves that have rows."""

    study: Study
    claims: tuple[Row, ...]
    curves: tuple[Exhibit, ...]


@dataclass(frozen=True, slots=True)
class StudySection:
    """counts: of claims by verdict."""

    title: str
    facts: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    claims: tuple[Row, ...]
    claims_source: str
    counts: tuple[tuple[str, int], ...]
    studies: tuple[ShownStudy, ...]
    kind: str = "study"
    unkept: str = ""

    @property
    def exhibits(self) -> tuple[Exhibit, ...]:
        return tuple(curve for one in self.studies for curve in one.curves)

    @property
    def photos(self) -> tuple[()]:
        return ()


def study_section(found: Studies, title: str) -> StudySection:
    """title: the folder, as it was named."""
    manifest = found.manifest
    versions = ", ".join(f"{name} {version}" for name, version in manifest.get("versions", {}).items())
    quick = ("This was a quick run: fewer frames and values than the studies ask for.",)
    verdicts = [row["verdict"] for row in found.claims]
    return StudySection(
        title=title,
        facts=(
            ("studies", ", ".join(one.name for one in found.studies) or "none"),
            ("on", str(manifest.get("log") or "simulated logs")),
            ("gapeval", f"{manifest.get('gapeval', '-')}, scorer {manifest.get('scorer', '-')}; {versions}"),
        ),
        warnings=(
            *(quick if manifest.get("quick") else ()),
            *(words for one in found.studies for words in one.left_out),
        ),
        claims=found.claims,
        claims_source=f"{title}/{CLAIMS}, all rows",
        counts=tuple((verdict, verdicts.count(verdict)) for verdict in VERDICTS if verdict in verdicts),
        studies=tuple(_shown(found, one, title) for one in found.studies),
    )


def _shown(found: Studies, study: Study, title: str) -> ShownStudy:
    claims = tuple(row for row in found.claims if row["study"] == study.name)
    source = f"{title}/{study.name}.csv"
    curves = [_exhibit(study, curve, source) for curve in study.curves]
    return ShownStudy(study, claims, tuple(one for one in curves if one is not None))


def _exhibit(study: Study, curve: Curve, source: str) -> Exhibit | None:
    """A panel for each y; None where no row is asked for, or none has a figure."""
    rows = [row for row in curve.rows_of(study.rows) if any(number(row, y) is not None for y in curve.y)]
    if not rows:
        return None
    curve, rows = _without_all_of_one(curve, rows)
    kinds = values_of(rows, curve.lines) if curve.lines else ("",)
    looks = {kind: Look(index) for index, kind in enumerate(kinds)}
    panels = tuple(_panel(curve, y, rows, looks) for y in curve.y)
    named = (
        tuple((f"{_grouped(curve, curve.lines)} {kind or '(empty)'}", look) for kind, look in looks.items())
        if curve.lines
        else ()
    )
    asked = ", ".join(
        f"{name} = {' or '.join(one or '(empty)' for one in any_of)}" for name, any_of in curve.where.items()
    )
    return Exhibit(
        name=f"{study.name}-{curve.place}",
        title=curve.title or f"{', '.join(curve.y)} against {_label(curve, curve.x)}",
        drawings=panels,
        legend=named,
        caption=_caption(rows, curve, panels),
        source=f"{source}, {f'rows with {asked}' if asked else 'all rows'}, by {curve.x}"
        + (f" and {curve.lines}" if curve.lines else ""),
        table=_table(curve, rows),
    )


def _without_all_of_one(curve: Curve, rows: list[Row]) -> tuple[Curve, list[Row]]:
    """Where there is one log, the line of all of them is its own: one of the two is enough."""
    if not curve.lines:
        return curve, rows
    of_one = [row for row in rows if row[curve.lines] != ALL]
    names = {row[curve.lines] for row in of_one}
    columns = [curve.x, *(f"{y}{end}" for y in curve.y for end in ("", "_low", "_high"))]

    def drawn(some: Sequence[Row]) -> list[list[str]]:
        return sorted([row.get(name, "") for name in columns] for row in some)

    if len(names) != 1 or drawn(of_one) != drawn([row for row in rows if row[curve.lines] == ALL]):
        return curve, rows
    return replace(curve, where={**curve.where, curve.lines: tuple(names)}), of_one


def _caption(rows: Sequence[Row], curve: Curve, panels: Sequence[Panel]) -> str:
    known = any(
        number(row, f"{y}_{end}") is not None for row in rows for y in curve.y for end in ("low", "high")
    )
    shape = "Bands" if is_numeric(rows, curve.x) else "Bars"
    ends = at_the_ends(zip(curve.y, panels, strict=True))
    return (
        f"{shape}: 95 % intervals, where there is enough data for one.{ends}"
        if known
        else "No intervals: there is too little data for them."
    )


def _panel(curve: Curve, y: str, rows: Sequence[Row], looks: dict[str, Look]) -> Panel:
    numeric = is_numeric(rows, curve.x)
    places = values_of(rows, curve.x)
    lines, doubled = [], False
    for kind, look in looks.items():
        of_kind = [row for row in rows if not curve.lines or row[curve.lines] == kind]
        points = [
            Point(
                float(row[curve.x]) if numeric else float(places.index(row[curve.x])),
                value,
                number(row, f"{y}_low"),
                number(row, f"{y}_high"),
            )
            for row in of_kind
            if (value := number(row, y)) is not None
        ]
        points.sort(key=lambda point: point.x)
        doubled |= len({point.x for point in points}) < len(points)
        if points:
            lines.append(Line(kind, tuple(points), look))
    values = [point.y for line in lines for point in line.points]
    metric = BY_NAME.get(y)
    share = (
        metric is not None
        and metric.unit == "1"
        and metric.better == "higher"
        and max(values, default=0) <= 1
    )
    return Panel(
        title=_title(y),
        x_label=_label(curve, curve.x),
        lines=tuple(lines),
        alt=f"{_title(y)} against {_label(curve, curve.x)}; its values are in the table below the figure.",
        categories=None if numeric else places,
        joined=numeric and not doubled,
        log_x=curve.log_x and numeric and all(point.x > 0 for line in lines for point in line.points),
        share=share,
    )


def _title(y: str) -> str:
    if y not in BY_NAME:
        return y
    metric = BY_NAME[y]
    unit = "" if metric.unit == "1" else f" [{metric.unit}]"
    return f"{y}{unit}" + ("" if metric.better == "none" else f", {metric.better} is better")


def _label(curve: Curve, column: str) -> str:
    column = _grouped(curve, column)
    return label(column) if column in PARAMETERS else column


def _grouped(curve: Curve, column: str) -> str:
    """What a column is called; of `group`, what the rows were grouped by."""
    by = [name for name in curve.where.get("by", ()) if name]
    if column != "group" or len(by) != 1:
        return column
    return f"{by[0]} [{GROUP_UNITS[by[0]]}]" if by[0] in GROUP_UNITS else by[0]


def _table(curve: Curve, rows: Sequence[Row]) -> Table:
    by = (curve.x, *((curve.lines,) if curve.lines else ()))
    return Table(
        (*(_label(curve, name) for name in by), *curve.y),
        tuple(
            (*(row[name] or "(empty)" for name in by), *(_figure(row, y) for y in curve.y)) for row in rows
        ),
    )


def _figure(row: Row, y: str) -> str:
    low, high = number(row, f"{y}_low"), number(row, f"{y}_high")
    interval = "" if low is None or high is None else f" ({short(low)} to {short(high)})"
    return short(number(row, y)) + interval
