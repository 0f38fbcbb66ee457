"""A sweep's figures against each parameter, and over pairs of them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from gapeval.report.curves.heat import WRITTEN, Heat
from gapeval.report.curves.panel import Line, Panel, Point
from gapeval.report.curves.style import Look
from gapeval.report.exhibit import Exhibit, Table
from gapeval.report.sweeps.results import Results, values_of, where
from gapeval.report.text import short
from gapeval.results.tables import meanings
from gapeval.results.written import Row, number
from gapeval.scoring.metrics import METRICS

SHOWN = ("f1", "hit_rate", "fp_per_frame", "over_area")
WITHOUT_LABELS = ("gaps", "traversable_npca")  # what is known then, per frame
PAIRED = "f1"
AT_THE_ENDS = (
    "The interval of a figure that is exactly 0 or 1 is counted over distinct labels, blocks of time or logs "
    "(Clopper and Pearson; of false gaps Poisson), and is often wider than its neighbours'."
)
BEST = Look(faint=True)
BY_NAME = {metric.name: metric for metric in METRICS}


@dataclass(frozen=True, slots=True)
class Slice:
    """One metric against one parameter. base: with all others as in one row. best: of any row, by value."""

    metric: str
    base: tuple[Row | None, ...]
    best: tuple[Row | None, ...]


def curves(results: Results, base: Row, source: str) -> list[Exhibit]:
    """For each parameter that varies: the metrics, all other parameters as in the base row."""
    return [_curves(results, base, name, source) for name in results.varied]


def _curves(results: Results, base: Row, name: str, source: str) -> Exhibit:
    rows, others = results.overall, [other for other in results.varied if other != name]
    values = values_of(rows, name)
    metrics = SHOWN if results.scored else WITHOUT_LABELS
    slices = [cut(rows, base, name, others, metric) for metric in metrics]
    panels = tuple(_panel(one, name, values, base) for one in slices)
    both = tuple(f"{metric}{kind}" for metric in metrics for kind in ("", ", best of any"))
    table = tuple(
        (
            value or "(empty)",
            *(
                text
                for one in slices
                for text in (_figure(one.base[place], one.metric, True), _figure(one.best[place], one.metric))
            ),
        )
        for place, value in enumerate(values)
    )
    held = f", {where(base, others)}" if others else ""
    alone = len(others) == 0
    legend = (
        ("this parameter alone varied", Look()),
        *(() if alone else (("the best that any configuration with this value attains", BEST),)),
    )
    return Exhibit(
        name=f"against-{name}",
        title=f"Against {label(name)}",
        drawings=panels,
        legend=legend,
        caption=_caption(name, slices, panels),
        source=(
            f"{source}, rows with log = all{held}"
            + ("" if alone else "; the dashed line from all rows with log = all")
        ),
        table=Table((label(name), *both), table),
    )


def _caption(name: str, slices: Sequence[Slice], panels: Sequence[Panel]) -> str:
    meaning = meanings()[name].replace("`", "")
    known = any(row is not None and row.get(f"{one.metric}_low") for one in slices for row in one.base)
    bands = " Bands: 95 % intervals." if known else ""
    ends = at_the_ends((one.metric, panel) for one, panel in zip(slices, panels, strict=True))
    return (
        f"{name}: {meaning}. The values stand evenly spaced; the grey bar is the configuration above."
        f"{bands}{ends}"
    )


def at_the_ends(drawn: Iterable[tuple[str, Panel]]) -> str:
    """A sentence about intervals that are not drawn from blocks, where there is one of them.

    drawn: metrics and their panels. See gapeval.scoring.intervals.
    """
    for metric, panel in drawn:
        known = BY_NAME.get(metric)
        counts = "nothing" if known is None else known.counts
        ends = {"nothing": (), "events": (0.0,)}.get(counts, (0.0, 1.0))
        for point in (point for line in panel.lines if not line.look.faint for point in line.points):
            if point.y in ends and point.low is not None and point.low != point.high:
                return " " + AT_THE_ENDS
    return ""


def cut(rows: Sequence[Row], base: Row, name: str, others: Sequence[str], metric: str) -> Slice:
    """Of each value of a parameter, in their order: its row beside the base, and its best row."""
    here, best = [], []
    for value in values_of(rows, name):
        of_value = [row for row in rows if row[name] == value]
        here.append(next((row for row in of_value if all(row[o] == base[o] for o in others)), None))
        best.append(best_of(of_value, metric))
    return Slice(metric, tuple(here), tuple(best))


def best_of(rows: Sequence[Row], metric: str) -> Row | None:
    """The row where a metric is best; None where it is defined in none, or has no better and worse."""
    known = [(value, -i) for i, row in enumerate(rows) if (value := number(row, metric)) is not None]
    better = BY_NAME[metric].better if metric in BY_NAME else "none"
    if not known or better == "none":
        return None
    chosen = max(known) if better == "higher" else min(known, key=lambda one: (one[0], -one[1]))
    return rows[-chosen[1]]


def _panel(one: Slice, name: str, values: Sequence[str], base: Row) -> Panel:
    lines = [Line("best of any", _points(one.best, one.metric), BEST)] if any(one.best) else []
    lines.append(Line("this parameter alone varied", _points(one.base, one.metric), Look()))
    spoken = ", ".join(f"{v}: {_figure(row, one.metric)}" for v, row in zip(values, one.base, strict=True))
    return Panel(
        title=title(one.metric),
        x_label=label(name),
        lines=tuple(lines),
        alt=f"{title(one.metric)} against {label(name)}. {spoken}.",
        categories=tuple(values),
        share=one.metric in BY_NAME and one.metric in ("f1", "hit_rate"),
        mark=float(values.index(base[name])),
    )


def _points(rows: Sequence[Row | None], metric: str) -> tuple[Point, ...]:
    found = []
    for place, row in enumerate(rows):
        value = None if row is None else figure(row, metric)
        if row is not None and value is not None:
            low, high = number(row, f"{metric}_low"), number(row, f"{metric}_high")
            found.append(Point(float(place), value, low, high))
    return tuple(found)


def figure(row: Row, metric: str) -> float | None:
    """A metric, or a count per frame."""
    value = number(row, metric)
    if value is None or metric not in WITHOUT_LABELS:
        return value
    frames = number(row, "frames")
    return value / frames if frames else None


def _figure(row: Row | None, metric: str, interval: bool = False) -> str:
    value = None if row is None else figure(row, metric)
    if row is None or value is None:
        return "-"
    low, high = number(row, f"{metric}_low"), number(row, f"{metric}_high")
    if not interval or low is None or high is None:
        return short(value)
    return f"{short(value)} ({short(low)} to {short(high)})"


def title(metric: str) -> str:
    """With its unit, where it has one, and which way is better."""
    if metric in WITHOUT_LABELS:
        return f"{metric} / frames"
    unit = "" if BY_NAME[metric].unit == "1" else f" [{BY_NAME[metric].unit}]"
    return f"{metric}{unit}, {BY_NAME[metric].better} is better"


def label(name: str) -> str:
    """A parameter with its unit."""
    first = meanings()[name].split(",")[0]
    return f"{name} [{first}]" if first in ("m", "rad", "s") else name


def heat_maps(results: Results, base: Row, source: str) -> Exhibit | None:
    """f1 over every pair of parameters that vary, all others as in the base row."""
    pairs = list(combinations(results.varied, 2))
    if not pairs or not results.scored:
        return None
    wholes = [_pair(results, base, *pair) for pair in pairs]
    known = [value for heat in wholes for row in heat.values for value in row if value is not None]
    if not known:
        return None
    scale = (min(known), max(known))
    heats = tuple(_scaled(heat, scale) for heat in wholes)
    rows = tuple(
        (f"{heat.x_label} = {x}, {heat.y_label} = {y}", short(value))
        for heat in heats
        for y, values in zip(heat.y, heat.values, strict=True)
        for x, value in zip(heat.x, values, strict=True)
    )
    crowded = any(len(heat.x) > WRITTEN for heat in heats)
    unwritten = "; where a map has many columns its values are in the table alone" if crowded else ""
    return Exhibit(
        name="pairs",
        title=f"{PAIRED} over pairs of parameters",
        drawings=heats,
        legend=(),
        caption=(
            f"Brighter is higher, from {short(scale[0])} to {short(scale[1])} in all maps{unwritten}. "
            "Framed: the configuration above, whose values all other parameters have."
        ),
        source=(
            f"{source}, column {PAIRED}, rows with log = all and, but for the two parameters of a map, "
            f"{where(base, results.varied)}"
        ),
        table=Table(("pair", PAIRED), rows),
    )


def _pair(results: Results, base: Row, one: str, other: str) -> Heat:
    """The parameter with more values along x."""
    x, y = sorted((one, other), key=lambda name: -len(values_of(results.overall, name)))
    held = [name for name in results.varied if name not in (x, y)]
    found = {
        (row[x], row[y]): number(row, PAIRED)
        for row in results.overall
        if all(row[name] == base[name] for name in held)
    }
    columns, rows = values_of(results.overall, x), values_of(results.overall, y)
    values = tuple(tuple(found.get((column, row)) for column in columns) for row in rows)
    return Heat(
        title="",
        x_label=label(x),
        y_label=label(y),
        x=columns,
        y=rows,
        values=values,
        scale=(0.0, 1.0),
        mark=(columns.index(base[x]), rows.index(base[y])),
        alt=f"{PAIRED} over {label(x)} and {label(y)}; its values are in the table below the figure.",
        width=270.0 if len(columns) <= 8 else 560.0,
    )


def _scaled(heat: Heat, scale: tuple[float, float]) -> Heat:
    return replace(heat, scale=scale)
