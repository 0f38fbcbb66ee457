"""The section of a sweep in a page: all that is said of it, before it is set."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gapeval.report.exhibit import Exhibit, Photo, Table
from gapeval.report.sweeps.frames import choose, rows_of, unshown
from gapeval.report.sweeps.front import HIGHEST, RECOMMENDED, front_exhibit
from gapeval.report.sweeps.logs import Sources
from gapeval.report.sweeps.parameters import BY_NAME, curves, heat_maps, label
from gapeval.report.sweeps.photos import photos
from gapeval.report.sweeps.recommendation import difference, reason, recommend
from gapeval.report.sweeps.results import Results
from gapeval.report.sweeps.times import TIMES, Times, times
from gapeval.report.text import counted, short
from gapeval.results.store import ALL
from gapeval.results.tables import FRAMES, PARAMETERS, SUMMARY
from gapeval.results.written import Row, number, read_rows

FIGURES = ("pq", "f1", "hit_rate", "fp_per_frame", "coverage", "over_area", "splits", "merges")

HEADINGS = {
    (True, True): "Recommended configuration",
    (True, False): "The configuration",
    (False, True): "Configuration that is shown",
    (False, False): "The configuration",
}


@dataclass(frozen=True, slots=True)
class Advice:
    """The configuration that is shown: the recommended one, where labels allow one.

    heading: what it is called. chosen: whether among others. other: how that of the highest pq differs, if it
    is another. values: the parameters that vary. held: all others.
    """

    configuration: str
    heading: str
    scored: bool
    chosen: bool
    reason: str
    other: str
    values: Table
    held: Table
    figures: Table
    source: str


@dataclass(frozen=True, slots=True)
class SweepSection:
    """warnings: what was refused, failed or is missing, to be said loudly. facts: terms and texts."""

    title: str
    facts: tuple[tuple[str, str], ...]
    logs: Table
    warnings: tuple[str, ...]
    advice: Advice
    per_log: Table | None
    curves: tuple[Exhibit, ...]
    pairs: Exhibit | None
    front: Exhibit | None
    photos: tuple[Photo, ...]
    no_photos: str
    unkept: str
    kind: str = "sweep"

    @property
    def exhibits(self) -> tuple[Exhibit, ...]:
        return (*self.curves, *(one for one in (self.pairs, self.front) if one is not None))


def sweep_section(results: Results, title: str, advance: Callable[[int], object]) -> SweepSection:
    """title: the folder, as it was named; also before the names of files."""
    advised = recommend(results.overall)
    base = results.overall[0] if advised is None else advised.row
    other = None if advised is None or advised.best is base else advised.best
    varied = results.varied or ("k", "delta_r", "n_o", "pl_th")
    sources = Sources(results)
    summary, several = f"{title}/{SUMMARY}", len(results.overall) > 1
    measured = times(results, sources, advance) if several and advised else Times({}, "", 0)
    chosen = choose(rows_of(results, base["configuration"]))
    return SweepSection(
        title=title,
        facts=_facts(results),
        logs=_logs(results.manifest["logs"]),
        warnings=tuple(_warnings(results)),
        advice=Advice(
            base["configuration"],
            HEADINGS[(advised is not None, several)],
            advised is not None,
            advised is not None and several,
            _without_labels(results) if advised is None else reason(advised, len(results.overall)),
            "" if other is None else difference(base, other),
            _values([name for name in varied if base[name] or several], base, other),
            _values([name for name in PARAMETERS if name not in varied and base[name]], base),
            _figures(base, other),
            f"{summary}, rows with log = all, configuration = {base['configuration']}"
            + ("" if other is None else f" or {other['configuration']}"),
        ),
        per_log=_per_log(results, base),
        curves=tuple(curves(results, base, summary)),
        pairs=heat_maps(results, base, summary),
        front=front_exhibit(results, advised, measured, summary, f"{title}/{TIMES}") if advised else None,
        photos=tuple(photos(chosen, sources, base, f"{title}/{FRAMES}", advance)),
        no_photos=unshown(chosen),
        unkept=measured.unkept,
    )


def _facts(results: Results) -> tuple[tuple[str, str], ...]:
    manifest, first = results.manifest, results.overall[0]
    labels = "; ".join(
        f"{entry['labels']} ({counted(entry['features'], 'feature')})" for entry in manifest["labels"]
    )
    versions = ", ".join(f"{name} {version}" for name, version in manifest["versions"].items())
    grid = " x ".join(
        f"{name} {', '.join(dict.fromkeys(row[name] or '(empty)' for row in results.overall))}"
        for name in results.varied
    )
    scored, asked = first["scored_frames"], first.get("asked", "")
    return (
        ("configurations", f"{len(results.overall)}" + (f": {grid}" if grid else "")),
        (
            "frames",
            f"{first['frames']}, {scored or 'none'} of them labelled; {asked or 'no'} labels asked for",
        ),
        ("labels", labels or "none"),
        ("gapeval", f"{manifest['gapeval']}, scorer {manifest['scorer']}; {versions}"),
    )


def _logs(entries: Sequence[dict[str, Any]]) -> Table:
    head = ("log", "frames", "clouds", "refused", "clouds from", "poses", "sha256 of its content")
    rows = tuple(
        (
            str(entry["log"]),
            str(entry["frames"]),
            str(entry.get("clouds", "-")),
            str(sum(entry.get("refused", {}).values())),
            f"{entry['container']}, {entry['cloud_topic']}"
            if "container" in entry
            else entry.get("detections", "-"),
            f"{entry['fixed_frame'] or 'no fixed frame'}, {entry['pose_source']}"
            if "container" in entry
            else "-",
            str(entry.get("sha256") or "-")[:12],
        )
        for entry in entries
    )
    return Table(head, rows)


def _warnings(results: Results) -> list[str]:
    """What a reader must know before any figure."""
    found = []
    for entry in results.manifest["logs"]:
        for why, count in entry.get("refused", {}).items():
            found.append(f"{entry['log']}: refused {counted(count, 'cloud')} of {entry['clouds']}: {why}")
        found += [f"{entry['log']}: {notice}" for notice in entry.get("notices", ())]
    for entry in results.manifest["labels"]:
        if missing := entry.get("unmatched_stamps"):
            found.append(f"{entry['labels']}: {counted(missing, 'labelled stamp')} without a cloud")
    for entry in results.manifest.get("failed", ()):
        found.append(
            f"{entry['log']}: {counted(entry['frames'], 'frame')} failed and are in no figure "
            f"(stamps {entry['first']} to {entry['last']}): {entry['reason']}"
        )
    return found


def _without_labels(results: Results) -> str:
    shown = "the first of the grid" if len(results.overall) > 1 else "the only one"
    why = "No label was asked for in any frame" if results.manifest["labels"] else "There were no labels"
    return f"{why}, so none is recommended; shown is {shown}."


def _values(names: Sequence[str], base: Row, other: Row | None = None) -> Table:
    columns = [base] if other is None else [base, other]
    head = ("parameter", *_heads(other, "value"))
    return Table(head, tuple((label(name), *(row[name] or "(empty)" for row in columns)) for name in names))


def _heads(other: Row | None, alone: str) -> tuple[str, ...]:
    return (alone,) if other is None else (RECOMMENDED, HIGHEST)


def _figures(base: Row, other: Row | None) -> Table:
    rows = []
    for name in FIGURES:
        metric = BY_NAME[name]
        unit = "" if metric.unit == "1" else f" [{metric.unit}]"
        values = [_with_interval(row, name) for row in (base, other) if row is not None]
        rows.append((f"{name}{unit}", *values, metric.meaning.replace("`", "")))
    known = any(number(base, f"{name}_low") is not None for name in FIGURES)
    heads = [f"{head} (95 % interval)" if known else head for head in _heads(other, "value")]
    return Table(("metric", *heads, "meaning"), tuple(rows))


def _with_interval(row: Row, name: str) -> str:
    low, high = number(row, f"{name}_low"), number(row, f"{name}_high")
    interval = "" if low is None or high is None else f" ({short(low)} to {short(high)})"
    return short(number(row, name)) + interval


def _per_log(results: Results, base: Row) -> Table | None:
    """The shown configuration in each log, where there are several."""
    if len(results.manifest["logs"]) < 2:
        return None
    names = ("frames", "asked", *FIGURES[:6])
    rows = [
        (row["log"], *(short(number(row, name)) for name in names))
        for row in read_rows(results.folder / SUMMARY)
        if row["configuration"] == base["configuration"] and row["log"] != ALL
    ]
    return Table(("log", *names), tuple(rows))
