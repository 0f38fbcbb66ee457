"""Write the result files of a sweep or a score, row by row as frames come, sums in memory."""

import csv
import json
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from gapeval.files import make_folder, whole_files
from gapeval.frame import FloatArray
from gapeval.results import tables
from gapeval.results.rows import FRAMES, GAPS, LABELS, rows_of
from gapeval.results.tables import Point
from gapeval.scoring.metrics import SUMS, figures
from gapeval.sweep.evaluation import Answers

ALL = "all"
# What the best configuration is chosen by, most important first; -1 for more is better. pq before hit_rate:
# whoever calls all the ground a gap hits every label, with hardly a gap that belongs to none.
BEST = (
    ("pq", -1),
    ("hit_rate", -1),
    ("fp_per_frame", 1),
    ("coverage", -1),
    ("over_area", 1),
    ("npca_accuracy", -1),
)
MANIFEST = "manifest.json"


@dataclass(slots=True)
class Stage:
    """How long a stage took in each frame [s], how often it was done, and for how many configurations."""

    seconds: "array[float]" = field(default_factory=lambda: array("d"))
    times: int = 0
    served: int = 0

    def add(self, seconds: float, times: int, configurations: int) -> None:
        self.seconds.append(seconds)
        self.times += times
        self.served += configurations


@dataclass(slots=True)
class Totals:
    """Sums (C, len(SUMS)) by log (None: all together), and the seconds of each stage by log."""

    configurations: int
    sums: dict[str | None, FloatArray] = field(default_factory=dict)
    stages: dict[tuple[str, str], Stage] = field(default_factory=dict)

    def of(self, log: str | None) -> FloatArray:
        if log not in self.sums:
            self.sums[log] = np.zeros((self.configurations, len(SUMS)))
        return self.sums[log]


class Store:
    """Open result files. Made by `open_store`."""

    def __init__(self, files: Mapping[str, IO[str]], points: Sequence[Point]) -> None:
        self.points = points
        self._files = files
        self._totals = Totals(len(points))
        self._rows = {point.id: row for row, point in enumerate(points)}
        for name, columns in {FRAMES: tables.FRAMES, LABELS: tables.LABELS, GAPS: tables.GAPS}.items():
            if name in files:
                _table(files[name], columns)

    def add(self, log: str, stamp: int, answers: Answers, spent: Mapping[str, Sequence[float]]) -> None:
        """One frame: its answers in the order of the points; frames come in order of log and stamp."""
        rows = rows_of(log, stamp, [point.id for point in self.points], answers)
        for name, texts in {FRAMES: rows.frames, LABELS: rows.labels, GAPS: rows.gaps}.items():
            self.write(name, "".join(texts))
        self.count(log, answers.sums)
        seconds = {stage: (sum(each) / len(each), len(each)) for stage, each in spent.items()}
        self.time(log, [(seconds, len(self.points))])

    def write(self, name: str, rows: str) -> None:
        """Rows of frames.csv, labels.csv or gaps.csv, which come in order of log, stamp and configuration."""
        if name in self._files:  # gaps only on request, nothing where nothing is to be written
            self._files[name].write(rows)

    def count(self, log: str, sums: FloatArray) -> None:
        """The sums (C, len(SUMS)) of one frame, which come in order of log and stamp."""
        for name in (log, None):
            total = self._totals.of(name)
            total += sums

    def time(self, log: str, evaluations: Iterable[tuple[Mapping[str, tuple[float, int]], int]]) -> None:
        """What one frame took, each time it was evaluated, and under how many configurations.

        Of each stage: mean seconds, and how often it was done.
        """
        done: dict[str, list[tuple[float, int, int]]] = {}
        for spent, configurations in evaluations:
            for stage, (seconds, times) in spent.items():
                done.setdefault(stage, []).append((seconds, times, configurations))
        for stage, each in done.items():
            times = sum(count for _, count, _ in each)
            mean = sum(seconds * count for seconds, count, _ in each) / times
            served = sum(configurations for _, _, configurations in each)
            self._totals.stages.setdefault((log, stage), Stage()).add(mean, times, served)

    def finish(self, config: str, manifest: Mapping[str, Any], logs: Sequence[str]) -> None:
        """The files that need all frames: summary, timing, configuration (YAML) and manifest."""
        summary = _table(self._files["summary.csv"], tables.SUMMARY)
        for log in (*logs, None):
            best = self.ranked(log)[:1]
            for point in self.points:
                sums = self.sums(point, log)
                chosen = point in best and len(self.points) > 1
                row = {"log": log or ALL, "configuration": point.id, "best": True if chosen else None}
                row |= point.parameters | figures(sums) | tables.sums_row(sums)
                summary.writerow(_cells(row))
        timing = _table(self._files["timing.csv"], tables.TIMING)
        for row in self.timings():
            timing.writerow(_cells(row))
        self._files["config.yaml"].write(config)
        json.dump(manifest, self._files[MANIFEST], indent=2, ensure_ascii=False)
        self._files[MANIFEST].write("\n")

    def ranked(self, log: str | None = None) -> list[Point]:
        """The configurations, best first, by what BEST says; equal ones in the order of the grid.

        Empty where no label was asked for.
        """
        scored = [point for point in self.points if self.sums(point, log).get("asked")]

        def goodness(point: Point) -> tuple[float, ...]:
            found = figures(self.sums(point, log))
            return tuple(sign * (found[name] or 0.0) for name, sign in BEST)

        return sorted(scored, key=goodness)

    @property
    def names(self) -> tuple[str, ...]:
        """The files that are written."""
        return tuple(self._files)

    def sums(self, point: Point, log: str | None = None) -> dict[str, float]:
        return dict(zip(SUMS, self._totals.of(log)[self._rows[point.id]].tolist(), strict=True))

    def timings(self) -> list[dict[str, Any]]:
        """The rows of timing.csv."""
        return [
            {
                "log": log,
                "stage": stage,
                "shared_by": done.served / done.times,
                "frames": len(done.seconds),
                "median": float(np.median(done.seconds)),
                "p95": float(np.quantile(done.seconds, 0.95)),
            }
            for (log, stage), done in self._totals.stages.items()
        ]


@contextmanager
def open_store(folder: Path, points: Sequence[Point], with_gaps: bool = False) -> Iterator[Store]:
    """The result files of a folder; they appear when the block ends well, the manifest last."""
    make_folder(folder)
    gaps = (GAPS,) if with_gaps else ()
    names = ("summary.csv", FRAMES, LABELS, *gaps, "timing.csv", "config.yaml", MANIFEST)
    with whole_files(folder, names) as files:
        yield Store(files, points)
    if not with_gaps:  # those of an earlier sweep do not belong to these results
        (folder / GAPS).unlink(missing_ok=True)


def _table(file: IO[str], columns: Sequence[str]) -> "csv.DictWriter[str]":
    table = csv.DictWriter(file, columns, restval="", extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    return table


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tables.cell(value) for name, value in row.items()}
