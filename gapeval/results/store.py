"""Write the result files of a sweep or a score, row by row as frames come, sums in memory."""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from gapeval.files import make_folder, whole_files
from gapeval.frame import FloatArray
from gapeval.results import tables
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
GAPS = "gaps.csv"
MANIFEST = "manifest.json"


@dataclass(slots=True)
class Totals:
    """Sums (C, len(SUMS)) by log (None: all together), and the seconds of each stage by log."""

    configurations: int
    sums: dict[str | None, FloatArray] = field(default_factory=dict)
    stages: dict[tuple[str, str], list[tuple[float, int]]] = field(default_factory=dict)

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
        columns = {"frames.csv": tables.FRAMES, "labels.csv": tables.LABELS, GAPS: tables.GAPS}
        self._tables = {name: _table(files[name], columns[name]) for name in columns if name in files}

    def add(self, log: str, stamp: int, answers: Answers, spent: Mapping[str, Sequence[float]]) -> None:
        """One frame: its answers in the order of the points; frames come in order of log and stamp."""
        for row, point in enumerate(self.points):
            where = {"log": log, "stamp": stamp, "configuration": point.id}
            sums = dict(zip(SUMS, answers.sums[row].tolist(), strict=True))
            frame = {"plane_fallback": answers.fallbacks[row] or None} | tables.sums_row(sums)
            self._write("frames.csv", where | frame)
            for label in tables.label_rows(answers.labels[row]):
                self._write("labels.csv", where | label)
            for gap in tables.gap_rows(answers.gaps[row]):
                self._write(GAPS, where | gap)
        for name in (log, None):
            total = self._totals.of(name)
            total += answers.sums
        for stage, seconds in spent.items():
            self._totals.stages.setdefault((log, stage), []).append(
                (sum(seconds) / len(seconds), len(seconds))
            )

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

    def _write(self, file: str, row: Mapping[str, Any]) -> None:
        if file in self._tables:  # gaps only on request, nothing where nothing is to be written
            self._tables[file].writerow(_cells(row))

    def timings(self) -> list[dict[str, Any]]:
        """The rows of timing.csv."""
        rows = []
        for (log, stage), done in self._totals.stages.items():
            seconds = [second for second, _ in done]
            times = sum(count for _, count in done)
            rows.append(
                {
                    "log": log,
                    "stage": stage,
                    "shared_by": len(self.points) * len(done) / times,
                    "frames": len(done),
                    "median": float(np.median(seconds)),
                    "p95": float(np.quantile(seconds, 0.95)),
                }
            )
        return rows


@contextmanager
def open_store(folder: Path, points: Sequence[Point], with_gaps: bool = False) -> Iterator[Store]:
    """The result files of a folder; they appear when the block ends well, the manifest last."""
    make_folder(folder)
    gaps = (GAPS,) if with_gaps else ()
    names = ("summary.csv", "frames.csv", "labels.csv", *gaps, "timing.csv", "config.yaml", MANIFEST)
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
