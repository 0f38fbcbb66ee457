"""Hits by range and by width, and label by label as the robot comes near: of one log, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray
from gapeval.scoring.scene import AskedLabel

Row = dict[str, Any]
Hits = NDArray[np.bool_]

INF = float("inf")
EDGES = {  # m; a class holds its lower edge
    "range": (0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0, INF),
    "width": (0.0, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0, 3.0, INF),
}
NEARER = 1.0  # m that a robot comes nearer to a label that it drives towards


class HitCounts:
    """How many labels were asked for, and hit under each configuration (C), by class of range and width."""

    def __init__(self, configurations: int) -> None:
        self.asked = {by: np.zeros(len(edges) - 1, dtype=np.int64) for by, edges in EDGES.items()}
        self.hits = {
            by: np.zeros((configurations, len(edges) - 1), dtype=np.int64) for by, edges in EDGES.items()
        }

    def add(self, asked: Sequence[AskedLabel], hits: Hits) -> None:
        """The labels (A) of one frame; hits (C, A)."""
        for by, edges in EDGES.items():
            for label, hit in zip(asked, hits.T, strict=True):
                place = int(np.searchsorted(edges, getattr(label, by), side="right")) - 1
                self.asked[by][place] += 1
                self.hits[by][:, place] += hit

    def include(self, other: "HitCounts") -> None:
        """Those of another log."""
        for by in EDGES:
            self.asked[by] += other.asked[by]
            self.hits[by] += other.hits[by]

    def rows(self, configuration: int) -> Iterator[Row]:
        """What follows log and configuration in hits.csv."""
        for by, edges in EDGES.items():
            for place in np.flatnonzero(self.asked[by]).tolist():
                asked, hits = int(self.asked[by][place]), int(self.hits[by][configuration, place])
                row: Row = {"by": by, "low": edges[place], "high": edges[place + 1]}
                yield row | {"asked": asked, "hits": hits, "hit_rate": hits / asked}


@dataclass(slots=True, eq=False)
class Approach:
    """One label through a log. Ranges [m]: at the first frame at which it was asked for, the nearest.

    Of each configuration (C): hits; range at the first frame at which it was hit, NaN if it never was; the
    nearest range at which it was missed, infinite if it never was.
    """

    width: float
    judged: bool
    first_asked: float
    hits: IndexArray
    first_hit: FloatArray
    nearest_missed: FloatArray
    nearest: float = INF
    asked: int = 0

    @property
    def towards(self) -> bool:
        """Whether the robot drives towards it."""
        return self.first_asked - self.nearest >= NEARER

    def add(self, at: float, hit: Hits) -> None:
        self.asked += 1
        self.nearest = min(self.nearest, at)
        self.first_hit[hit & (self.hits == 0)] = at
        self.hits += hit
        self.nearest_missed[~hit] = np.minimum(self.nearest_missed[~hit], at)


@dataclass(slots=True, eq=False)
class Approaches:
    """The labels of one log, by id, in the order in which they were first asked for."""

    configurations: int
    labels: dict[str, Approach] = field(default_factory=dict)

    def add(self, asked: Sequence[AskedLabel], hits: Hits) -> None:
        """The labels (A) of one frame; hits (C, A). Frames come in order of time."""
        for label, hit in zip(asked, hits.T, strict=True):
            if label.label not in self.labels:
                number = self.configurations
                self.labels[label.label] = Approach(
                    label.width,
                    label.judged,
                    label.range,
                    np.zeros(number, dtype=np.intp),
                    np.full(number, np.nan),
                    np.full(number, np.inf),
                )
            self.labels[label.label].add(label.range, hit)

    def rows(self, configuration: int) -> Iterator[Row]:
        """What follows log and configuration in approaches.csv."""
        for name, label in self.labels.items():
            hit = bool(label.hits[configuration])
            missed = float(label.nearest_missed[configuration])
            yield {
                "label": name,
                "width": label.width,
                "asked": label.asked,
                "hits": int(label.hits[configuration]),
                "first_asked": label.first_asked,
                "first_hit": float(label.first_hit[configuration]) if hit else None,
                "nearest_missed": missed if missed < INF else None,
                "nearest": label.nearest,
                "towards": label.towards,
            }

    @property
    def judged(self) -> IndexArray:
        """Labels that were hit at least once and say whether they can be crossed, (C,)."""
        found = np.zeros(self.configurations, dtype=np.intp)
        for label in self.labels.values():
            if label.judged:
                found += label.hits > 0
        return found


@dataclass(slots=True, eq=False)
class FirstHits:
    """Of labels that the robot drives towards, under each configuration (C): how many were hit at all, ranges
    at their first hits [m], one after the other, and how many were missed."""

    hit: FloatArray
    ranges: FloatArray
    missed: IndexArray
    towards: int = 0

    @classmethod
    def none(cls, configurations: int) -> "FirstHits":
        return cls(
            np.zeros(configurations), np.zeros(configurations), np.zeros(configurations, dtype=np.intp)
        )

    def add(self, approaches: Approaches) -> None:
        """The labels of one log."""
        for label in approaches.labels.values():
            if label.towards:
                hit = label.hits > 0
                self.towards += 1
                self.hit += hit
                self.ranges += np.where(hit, label.first_hit, 0.0)
                self.missed += ~hit

    def figures(self, configuration: int) -> Row:
        """first_hit_range, towards_missed; None where there is no such label."""
        if not self.towards:
            return {"first_hit_range": None, "towards_missed": None}
        hit = self.hit[configuration]
        return {
            "first_hit_range": float(self.ranges[configuration] / hit) if hit else None,
            "towards_missed": int(self.missed[configuration]),
        }
