"""Comparisons: one as a team would meet it, and any that the data allow."""

import math
from typing import Any

from hypothesis import strategies as st

from gapeval.compare.outcome import (
    MARKS,
    Change,
    Comparison,
    LabelChange,
    Noise,
    Origin,
    Row,
    Spread,
    Time,
)
from gapeval.scoring.metrics import COUNTS, METRICS

INF, NAN = math.inf, math.nan
RANK = {mark: rank for rank, mark in enumerate(MARKS)}
SHORT = "fewer than 10 blocks of 2 s"


def origin(path: str, **fields: Any) -> Origin:
    logs = {"street.mcap": "5f3c" * 16, "tunnel.mcap": "a901" * 16}
    known = {
        "gapeval": "0.1.0",
        "revision": "97c42f3e" * 5,
        "source": "1d" * 32,
        "scorer": "2",
        "logs": logs,
        "labels": {"street.mcap": "77aa" * 16, "tunnel.mcap": "0b0c" * 16},
    }
    return Origin(path, **(known | fields))


def row(mark: str, changes: tuple[Change, ...] = (), **fields: Any) -> Row:
    """One that is in both results, unless something else is said."""
    known = {
        "log": "street.mcap",
        "configuration": "5ed457beaf20",
        "parameters": {"k": "7", "delta_r": "1.02", "n_o": "1", "pl_th": "0.4"},
        "reasons": (),
        "base": {"hit_rate": 1.0, "pq": 0.6667} | {c.metric: c.base for c in changes},
        "new": {"hit_rate": 1.0, "pq": 0.6667} | {c.metric: c.new for c in changes},
    }
    return Row(mark=mark, changes=changes, **(known | fields))


def comparison(*rows: Row, **fields: Any) -> Comparison:
    known = {
        "base": origin("baseline.csv"),
        "new": origin("results", revision="0badc0de" * 5 + "+changes", source="2e" * 32),
        "times": (),
        "varied": ("n_o", "pl_th"),
        "notices": (),
    }
    return Comparison(rows=rows, **(known | fields))


def realistic() -> Comparison:
    """A detector that was made worse: a baseline of two logs, of which one has new labels."""
    worse = (
        Change("hit_rate", "+", 0.95, 0.8, 0.0, Noise(-0.24, -0.06)),
        Change("pq", "+", 0.6667, 0.66668, 0.0, Noise(-0.02, 0.01)),
        Change("over_area", "-", 7.748, 6.5, 0.0, Noise(-2.0, -0.5)),
        Change("gaps", "~", 31.0, 28.0, INF),
    )
    labels = (
        LabelChange("trench", "hit", "missed", (4, 5, 6, 7, 8, 9), tuple(range(400, 1000, 100))),
        LabelChange("kerb | `low`", "not asked for", "hit", (12,), (1200,)),
    )
    rows = (
        row(
            "x",
            log="tunnel.mcap",
            configuration="e38b37806118",
            parameters={"k": "7", "delta_r": "1.02", "n_o": "0", "pl_th": "0.05"},
            reasons=("labels differ: 0b0c0b0c0b0c in BASE, 1c1d1c1d1c1d in NEW",),
        ),
        row(
            "!",
            configuration="f3a8ce15674c",
            parameters={"k": "7", "delta_r": "1.02", "n_o": "2", "pl_th": "0.4"},
            reasons=("missing in NEW",),
            new={},
        ),
        row("+", worse, frames=(4, 5, 6, 7, 8, 9, 12), labels=labels),
        row(
            "+",
            (Change("pq", "+", 0.5, 0.48, 0.01, Noise(NAN, NAN, SHORT)),),
            configuration="a013f6f3d667",
            parameters={"k": "7", "delta_r": "1.02", "n_o": "1", "pl_th": "0.1"},
            unknown="BASE has no frames",
        ),
        row("-", (Change("fp_per_frame", "-", 0.25, 0.125, 0.0, Noise(-0.3, 0.05)),), log="all"),
        row("*", log="yard.mcap", reasons=("new in NEW",), base={}),
        row(" ", log="yard.mcap", configuration="b71a05984bbd"),
    )
    times = (
        Time("street.mcap", "time", "+", Spread(0.0021, 0.0024, 30), Spread(0.004, 0.0045, 30), 0.0005),
        Time("street.mcap", "read", " ", Spread(0.01, 0.02, 30), Spread(0.012, 0.02, 30), INF),
        Time("street.mcap", "contours", "~", Spread(0.0005, 0.0006, 30), Spread(0.0015, 0.002, 30), INF),
        Time("street.mcap", "scene", " ", None, Spread(0.012, 0.02, 30), INF),
        Time("tunnel.mcap", "time", "~", Spread(0.002, 0.0024, 12), Spread(0.0019, 0.0022, 12), INF),
    )
    history = ({"gapeval": "0.1.0", "reason": "first"}, {"gapeval": "0.1.0", "reason": "holes are kept now"})
    labels_now = {"street.mcap": "77aa" * 16, "tunnel.mcap": "1c1d" * 16, "yard.mcap": ""}
    logs_now = {"street.mcap": "5f3c" * 16, "tunnel.mcap": "a901" * 16, "yard.mcap": "ee" * 32}
    return comparison(
        *rows,
        base=origin("baseline.csv", history=history),
        new=origin(
            "results",
            revision="0badc0de" * 5 + "+changes",
            source="2e" * 32,
            logs=logs_now,
            labels=labels_now,
        ),
        times=times,
        notices=("numpy 2.4.6 in BASE, 2.5.0 in NEW",),
    )


def for_people(row: Row) -> list[Change]:
    """Not counts that nothing is held against, nor what says the same as another figure of the same mark."""
    said = {("under_coverage", change.mark) for change in row.changes if change.metric == "coverage"}
    said |= {("rq", change.mark) for change in row.changes if change.metric == "f1"}
    return [
        change
        for change in row.changes
        if (change.metric, change.mark) not in said
        and not (change.metric in COUNTS and change.mark == "~" and change.limit == INF)
    ]


# Any characters but halves of surrogate pairs, and above all those that mean something to some format.
TEXTS = st.text(
    st.one_of(
        st.sampled_from("ab|`\\<>&\"'*_,;:%\n\r\t\x00\x1b\x85\u2028\ufffe]"), st.characters(codec="utf-8")
    ),
    max_size=12,
)
NAMES = TEXTS.filter(bool)
VALUES = st.none() | st.floats(-1e6, 1e6) | st.integers(0, 10_000).map(float)
METRIC_NAMES = (
    st.sampled_from([metric.name for metric in METRICS])
    | st.sampled_from(["coverage", "under_coverage", "f1", "rq"])
    | NAMES
)
REASONS = st.sampled_from(["not in NEW", "other scorer"]) | TEXTS
MARK = st.sampled_from(list(MARKS))
LIMITS = st.just(INF) | st.floats(0, 1e3)
WORDS = st.sampled_from(["hit", "missed", "not asked for"])
FRAMES = st.lists(st.integers(0, 60), max_size=40, unique=True).map(sorted).map(tuple)
SPREADS = st.none() | st.builds(Spread, st.floats(0, 10), st.floats(0, 10), st.integers(1, 1000))
NOISES = st.one_of(
    st.none(),
    st.builds(lambda low, width: Noise(low, low + width), st.floats(-1, 1), st.floats(0, 1)),
    st.builds(lambda reason: Noise(NAN, NAN, reason), NAMES),
)
TIMES = st.builds(Time, TEXTS, st.just("time") | NAMES, MARK, SPREADS, SPREADS, LIMITS)
ORIGINS = st.builds(
    Origin,
    *[TEXTS] * 5,
    st.dictionaries(NAMES, TEXTS, max_size=3),
    st.dictionaries(NAMES, TEXTS, max_size=3),
    st.lists(st.dictionaries(st.sampled_from(["gapeval", "reason"]), TEXTS | VALUES), max_size=2).map(tuple),
)


@st.composite
def label_changes(draw: st.DrawFn) -> LabelChange:
    frames = draw(FRAMES.filter(bool))
    return LabelChange(
        draw(TEXTS), draw(WORDS), draw(WORDS), frames, tuple(10**18 + frame for frame in frames)
    )


CHANGES = st.builds(Change, METRIC_NAMES, MARK, VALUES, VALUES, LIMITS, NOISES)


@st.composite
def rows(draw: st.DrawFn) -> Row:
    changes = draw(st.lists(CHANGES, max_size=4, unique_by=lambda change: change.metric))
    figures = st.dictionaries(METRIC_NAMES, VALUES, max_size=3)
    return Row(
        draw(TEXTS),
        draw(NAMES),
        {name: draw(TEXTS) for name in ("k", "n_o", "pl_th")},
        draw(MARK),
        tuple(draw(st.lists(REASONS, max_size=2))),
        draw(figures) | {change.metric: change.base for change in changes},
        draw(figures) | {change.metric: change.new for change in changes},
        tuple(sorted(changes, key=lambda change: RANK[change.mark])),
        draw(st.none() | FRAMES),
        draw(st.none() | st.lists(label_changes(), max_size=3).map(tuple)),
        draw(TEXTS),
    )


@st.composite
def comparisons(draw: st.DrawFn) -> Comparison:
    found = draw(st.lists(rows(), max_size=6))
    return Comparison(
        draw(ORIGINS),
        draw(ORIGINS),
        tuple(sorted(found, key=lambda one: RANK[one.mark])),
        tuple(draw(st.lists(TIMES, max_size=4))),
        tuple(draw(st.sampled_from([(), ("k",), ("n_o", "pl_th")]))),
        tuple(draw(st.lists(TEXTS, max_size=2))),
    )


def large(number: int = 1000, figures: int = 25) -> Comparison:
    """Worse in everything."""
    changes = tuple(
        Change(metric.name, "+", 0.5 + index / 1000, 0.25, 0.0, Noise(-0.5, -0.125))
        for index, metric in enumerate(METRICS[:figures])
    )
    labels = (LabelChange("trench", "hit", "missed", tuple(range(0, 60, 2)), tuple(range(0, 60, 2))),)
    return comparison(
        *(
            row(
                "+",
                changes,
                configuration=f"{index:012x}",
                parameters={"n_o": str(index), "pl_th": "0.1"},
                frames=tuple(range(60)),
                labels=labels,
            )
            for index in range(number)
        )
    )
