"""Write the result files of a sweep or a score, row by row as frames come, sums in memory."""

import csv
import json
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from gapeval.files import make_folder, whole_files
from gapeval.frame import FloatArray
from gapeval.results import tables
from gapeval.results.hits import Hits
from gapeval.results.rows import rows_of
from gapeval.results.tables import APPROACHES, FRAMES, GAPS, HITS, LABELS, SUMMARY, TIMING, Point
from gapeval.results.tally import SEED, AllSums, LogSums, Total
from gapeval.scoring.intervals import Stamps
from gapeval.scoring.metrics import SUMS, figures
from gapeval.scoring.scene import AskedLabel
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


def badness(figure: Callable[[str], float | None]) -> tuple[float, ...]:
    """What configurations are sorted by, best first. figure: a metric of one, by name."""
    return tuple(sign * (figure(name) or 0.0) for name, sign in BEST)


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


class Store:
    """Open result files. Made by `open_store`."""

    def __init__(
        self,
        files: Mapping[str, IO[str]],
        points: Sequence[Point],
        timelines: Mapping[str, Stamps],
        block: float,
    ) -> None:
        self.points = points
        self._files = files
        self._timelines = timelines
        self._block = block
        self._all = AllSums(len(points))
        self._current: tuple[str, LogSums] | None = None
        self._totals: dict[str | None, Total] = {}
        self._stages: dict[tuple[str, str], Stage] = {}
        self._rows = {point.id: row for row, point in enumerate(points)}
        self._tables = {
            name: _table(files[name], columns) for name, columns in tables.FILES.items() if name in files
        }

    def add(self, log: str, stamp: int, answers: Answers, spent: Mapping[str, Sequence[float]]) -> None:
        """One frame: its answers in the order of the points; frames come in order of log and stamp."""
        rows = rows_of(log, stamp, [point.id for point in self.points], answers)
        for name, texts in {FRAMES: rows.frames, LABELS: rows.labels, GAPS: rows.gaps}.items():
            self.write(name, "".join(texts))
        self.count(log, stamp, answers.sums, answers.asked, answers.hits)
        seconds = {stage: (sum(each) / len(each), len(each)) for stage, each in spent.items()}
        self.time(log, [(seconds, len(self.points))])

    def write(self, name: str, rows: str) -> None:
        """Rows of frames.csv, labels.csv or gaps.csv, which come in order of log, stamp and configuration."""
        if name in self._files:  # gaps only on request, nothing where nothing is to be written
            self._files[name].write(rows)

    def count(self, log: str, stamp: int, sums: FloatArray, asked: Sequence[AskedLabel], hits: Hits) -> None:
        """One frame, which come in order of log and stamp: sums (C, len(SUMS)), hits (C, A) of labels."""
        if self._current is None or self._current[0] != log:
            self._end_log()
            seed = [SEED, len(self._totals)]
            self._current = log, LogSums(len(self.points), self._timelines[log], self._block, seed)
        self._current[1].add(stamp, sums, asked, hits)
        self._all.sums += sums

    def _end_log(self) -> None:
        """Nothing more comes of the log that is being counted."""
        if self._current is None:
            return
        name, log = self._current
        self._current = None
        self._totals[name] = log.total()
        self._all.include(log, self._totals[name])
        if APPROACHES in self._tables:
            for index, point in enumerate(self.points):
                head = {"log": name, "configuration": point.id}
                self._tables[APPROACHES].writerows(_cells(head | row) for row in log.approaches.rows(index))

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
            self._stages.setdefault((log, stage), Stage()).add(mean, times, served)

    def finish(self, config: str, manifest: Mapping[str, Any], logs: Sequence[str]) -> None:
        """The files that need all frames: summary, timing, configuration (YAML) and manifest."""
        self._end_log()
        nothing = LogSums(len(self.points), np.empty(0, dtype=np.int64), self._block, [SEED]).total()
        self._totals[None] = self._all.total()
        for log in (*logs, None):
            best = self.ranked(log)[:1]
            total = self._totals.get(log, nothing)
            for index, point in enumerate(self.points):
                head = {"log": log or ALL, "configuration": point.id}
                self._tables[HITS].writerows(_cells(head | row) for row in total.hits.rows(index))
                sums = self.sums(point, log)
                chosen = point in best and len(self.points) > 1
                row = head | {"best": True if chosen else None} | point.parameters | figures(sums)
                row |= self.limits(point, log) | total.first_hits.figures(index) | tables.sums_row(sums)
                self._tables[SUMMARY].writerow(_cells(row))
        self._tables[TIMING].writerows(_cells(row) for row in self.timings())
        self._files["config.yaml"].write(config)
        json.dump(manifest, self._files[MANIFEST], indent=2, ensure_ascii=False)
        self._files[MANIFEST].write("\n")

    def ranked(self, log: str | None = None) -> list[Point]:
        """The configurations, best first, by what BEST says; equal ones in the order of the grid.

        Empty where no label was asked for.
        """
        scored = [point for point in self.points if self.sums(point, log).get("asked")]
        return sorted(scored, key=lambda point: badness(figures(self.sums(point, log)).get))

    @property
    def names(self) -> tuple[str, ...]:
        """The files that are written."""
        return tuple(self._files)

    def sums(self, point: Point, log: str | None = None) -> dict[str, float]:
        if log is None:
            found = self._all.sums
        elif log in self._totals:
            found = self._totals[log].sums
        elif self._current is not None and self._current[0] == log:
            found = self._current[1].sums
        else:
            found = np.zeros((len(self.points), len(SUMS)))
        return dict(zip(SUMS, found[self._rows[point.id]].tolist(), strict=True))

    def limits(self, point: Point, log: str | None = None) -> dict[str, float | None]:
        """The 95 % interval of each metric when all is finished: M_low, M_high; None where it is unknown."""
        row, found = self._rows[point.id], {}
        if log in self._totals:
            for name, of in self._totals[log].limits.items():
                for end, value in zip(tables.ENDS, of[:, row].tolist(), strict=True):
                    found[f"{name}_{end}"] = None if value != value else value
        return found

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
            for (log, stage), done in self._stages.items()
        ]


@contextmanager
def open_store(
    folder: Path,
    points: Sequence[Point],
    timelines: Mapping[str, Stamps],
    block: float,
    with_gaps: bool = False,
) -> Iterator[Store]:
    """The result files of a folder; they appear when the block ends well, the manifest last.

    timelines: of each log, the stamps of all its clouds [ns]. block: of time [s], see scoring.intervals.
    """
    make_folder(folder)
    gaps = (GAPS,) if with_gaps else ()
    names = (SUMMARY, FRAMES, LABELS, *gaps, HITS, APPROACHES, TIMING, "config.yaml", MANIFEST)
    with whole_files(folder, names) as files:
        yield Store(files, points, timelines, block)
    if not with_gaps:  # those of an earlier sweep do not belong to these results
        (folder / GAPS).unlink(missing_ok=True)


def _table(file: IO[str], columns: Sequence[str]) -> "csv.DictWriter[str]":
    table = csv.DictWriter(file, columns, restval="", extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    return table


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tables.cell(value) for name, value in row.items()}
