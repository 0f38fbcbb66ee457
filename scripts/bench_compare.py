"""Results as large as a comparison must bear: a grid of 1,000 configurations over 1,000 frames, made up.

The files are laid out as a sweep writes them, with sums that are drawn and figures that follow from them.
"""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Config
from gapeval.results import tables
from gapeval.results.manifest import SCORER, manifest
from gapeval.scoring.metrics import SUMS, figures
from gapeval.sweep.grid import configurations

LOG = "long.mcap"
FIRST, STEP = 1_700_000_000_000_000_000, 100_000_000  # ns
LABELS = ("trench", "pit", "drain")
GRID = {  # 1,000 configurations
    "k": [5, 6, 7, 8],
    "n_o": [0, 1, 2, 3, 4],
    "delta_r": [1.02, 1.05, 1.1, 1.2, 1.5],
    "pl_th": [0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5],
}


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """sums: of each name (F, C). hit: (F, C, labels)."""

    sums: dict[str, NDArray[np.float64]]
    hit: NDArray[np.bool_]


def drawn(frames: int, grid: int, share_lost: float) -> Drawn:
    """What might have come out. share_lost: of the labels that are hit otherwise, missed now, in all rows."""
    random = np.random.default_rng(1)
    shape = frames, grid
    hit = random.random((*shape, len(LABELS))) < 0.9
    hit &= random.random(hit.shape) >= share_lost
    hits = hit.sum(axis=2).astype(np.float64)
    areas = random.random(shape)
    counts = {
        name: random.integers(0, 9, shape).astype(np.float64) for name in SUMS if not tables.is_real(name)
    }
    reals = {name: np.round(random.random(shape), 15) for name in SUMS if tables.is_real(name)}
    asked = np.full(shape, float(len(LABELS)))
    fixed = {"frames": np.ones(shape), "scored_frames": np.ones(shape), "empty_frames": np.zeros(shape)}
    of_labels = {"asked": asked, "hits": hits, "tp": hits, "fn": asked - hits, "iou_sum": hits * 0.7}
    covered = {"label_area": np.full(shape, 2.5), "covered_area": hits * areas / len(LABELS)}
    return Drawn({name: (counts | reals | fixed | of_labels | covered)[name] for name in SUMS}, hit)


def write_results(folder: Path, found: Drawn) -> None:
    """A folder as of a sweep, of as many configurations of the grid as were drawn."""
    folder.mkdir(parents=True)
    frames, number = found.hit.shape[:2]
    grid = configurations(Config(grid={f"detector.{name}": list(of) for name, of in GRID.items()}))
    points = [tables.point(one) for one in grid[:number]]
    totals = [{name: float(of[:, at].sum()) for name, of in found.sums.items()} for at in range(len(points))]
    rows = [
        {"configuration": one.id} | one.parameters | figures(total) | tables.sums_row(total)
        for one, total in zip(points, totals, strict=True)
    ]
    with (folder / tables.SUMMARY).open("w", newline="") as file:
        table = csv.DictWriter(
            file, tables.SUMMARY_COLUMNS, restval="", extrasaction="ignore", lineterminator="\n"
        )
        table.writeheader()
        for log in (LOG, "all"):
            table.writerows(
                {name: tables.cell(value) for name, value in ({"log": log} | row).items()} for row in rows
            )
    ids = [one.id for one in points]
    _write_frames(folder / tables.FRAMES, ids, frames, found)
    _write_labels(folder / tables.LABELS, ids, frames, found)
    with (folder / tables.TIMING).open("w") as file:
        file.write(",".join(tables.TIMING_COLUMNS) + f"\n{LOG},contours,1.0,{frames},0.001,0.002\n")
    entry = {"log": LOG, "sha256": "0" * 64, "labels": "1" * 64, "frames": frames}
    document = manifest([entry], [], len(points), Config().scoring.model_dump(mode="json"))
    (folder / "manifest.json").write_text(json.dumps(document | {"scorer": SCORER}))


def _write_frames(path: Path, ids: list[str], frames: int, found: Drawn) -> None:
    kinds = [repr if tables.is_real(name) else lambda value: str(int(value)) for name in SUMS]
    with path.open("w") as file:
        file.write(",".join(tables.FRAME_COLUMNS) + "\n")
        for frame in range(frames):
            columns = [
                list(map(kind, found.sums[name][frame].tolist()))
                for name, kind in zip(SUMS, kinds, strict=True)
            ]
            head = f"{LOG},{FIRST + frame * STEP}"
            texts = map(",".join, zip(*columns, strict=True))
            known = "," * len(tables.POSE)
            file.writelines(f"{head},{name},,{known}{text}\n" for name, text in zip(ids, texts, strict=True))


def _write_labels(path: Path, ids: list[str], frames: int, found: Drawn) -> None:
    columns = tables.LABEL_COLUMNS[3:]
    texts = {}
    for label in LABELS:
        for hit in (False, True):
            row = {"label": label, "state": "visible", "hit": "true" if hit else "false"}
            row |= {name: "0.5" for name in columns if name not in row}
            texts[label, hit] = ",".join(row[name] for name in columns)
    with path.open("w") as file:
        file.write(",".join(tables.LABEL_COLUMNS) + "\n")
        for frame in range(frames):
            head, hits = f"{LOG},{FIRST + frame * STEP}", found.hit[frame].tolist()
            file.writelines(
                f"{head},{name},{texts[label, one]}\n"
                for name, each in zip(ids, hits, strict=True)
                for label, one in zip(LABELS, each, strict=True)
            )
