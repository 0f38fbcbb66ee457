"""Tables for the terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from gapeval.results.store import Store
from gapeval.results.tables import PARAMETERS, Point
from gapeval.scoring.metrics import COUNTS, METRICS, figures

BEST_ROWS = 5
BEST_METRICS = (
    "hit_rate",
    "fp_per_frame",
    "pq",
    "coverage",
    "over_area",
    "near_edge_error",
    "splits",
    "merges",
)
WITH_INTERVAL = ("hit_rate", "fp_per_frame", "pq")
IF_LABELLED = ("npca_accuracy", "pca_accuracy")  # shown where labels say what can be crossed


def metrics_table(sums: Mapping[str, float]) -> str:
    """Every metric with its unit and meaning, and the counts behind it."""
    found = figures(sums)
    rows = [(metric.name, short(found[metric.name]), metric.unit, metric.meaning) for metric in METRICS]
    counts = "  ".join(f"{name} {int(sums.get(name, 0))}" for name in COUNTS)
    return f"{columns(('metric', 'value', 'unit', 'meaning'), rows)}\n\n{counts}"


def best_table(store: Store, also: str = "") -> str:
    """The best configurations of a sweep over all logs, by the parameters that differ between them.

    also: a configuration to show whatever its rank.
    """
    ranked = [p for rank, p in enumerate(store.ranked()) if rank < BEST_ROWS or p.id == also]
    if not ranked:
        return _no_ranking(store)
    title = f"Best of {counted(len(store.points), 'configuration')}, chosen on these data:\n\n"
    varied = [
        name
        for name in PARAMETERS
        if len({point.parameters.get(name) for point in store.points}) > 1
        and (name not in ("i_height", "i_width") or "k" not in PARAMETERS or _k_is_silent(store))
    ]
    shown = (
        *BEST_METRICS,
        *(n for n in IF_LABELLED if any(figures(store.sums(p))[n] is not None for p in ranked)),
    )
    rows = []
    for point in ranked:
        found = figures(store.sums(point))
        rows.append(
            (
                point.id,
                *(short(point.parameters.get(name)) for name in varied),
                *(short(found[name]) for name in shown),
            )
        )
    return title + columns(("configuration", *varied, *shown), rows) + _intervals(store, ranked[0])


def _intervals(store: Store, best: Point) -> str:
    """How sure the figures of the best are, as far as it is known."""
    found = store.limits(best)
    known = [
        f"{name} {short(low)} to {short(high)}"
        for name in WITH_INTERVAL
        if (low := found.get(f"{name}_low")) is not None and (high := found.get(f"{name}_high")) is not None
    ]
    return f"\n\n95 % intervals of {best.id}: {', '.join(known)}; see scoring.md" if known else ""


def _no_ranking(store: Store) -> str:
    found = [figures(store.sums(point))["fp_per_frame"] for point in store.points]
    false_gaps = [figure for figure in found if figure is not None]
    if false_gaps:
        return (
            "No label was asked for: there is none, or in no frame is enough of one in view and in the\n"
            "domain, which is scoring.domain or the largest x_min ... r_max of the grid; see labels.csv.\n"
            f"False gaps per frame: {short(min(false_gaps))} to {short(max(false_gaps))}; "
            "see fp_per_frame in summary.csv."
        )
    return "No labels, so no configuration is better than another."


def timing_table(store: Store) -> str:
    """Where the time of a sweep went."""
    rows = [
        (row["log"], row["stage"], f"{row['shared_by']:.1f}", f"{1e3 * row['median']:.3f}")
        for row in store.timings()
    ]
    return columns(("log", "stage", "shared by", "median [ms]"), rows)


def _k_is_silent(store: Store) -> bool:
    """Whether k does not tell the resolution of some configuration."""
    return any(
        point.parameters["k"] is None
        or {point.parameters["i_height"], point.parameters["i_width"]} != {2 ** point.parameters["k"] + 1}
        for point in store.points
    )


def columns(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows under their heads, aligned."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = [
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in (head, *rows)
    ]
    return "\n".join(lines)


def counted(number: int, noun: str) -> str:
    """`1 frame`, `2 frames`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def short(value: Any) -> str:
    """A figure for people; files have all digits. A dash for what is undefined."""
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
