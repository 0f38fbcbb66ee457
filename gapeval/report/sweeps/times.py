"""What each configuration takes alone: measured once, and kept beside the results."""

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gapeval.config import Configuration
from gapeval.errors import GapevalError
from gapeval.files import write_whole
from gapeval.frame import Frame
from gapeval.logs.read import Recording, read_frames
from gapeval.report.sweeps.logs import Sources
from gapeval.report.sweeps.results import Results
from gapeval.results.written import number, read_rows
from gapeval.sweep.alone import seconds_alone
from gapeval.sweep.executor import one_thread

TIMES = "times.csv"
COLUMNS = ("log", "sha256", "configuration", "frames", "median", "p95")
FRAMES, REPEATS = 3, 3


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """Seconds of each configuration, by its id. missing: why there are none. unkept: why no file is."""

    seconds: dict[str, float]
    log: str
    frames: int
    missing: str = ""
    unkept: str = ""


def times(results: Results, sources: Sources, advance: Callable[[int], object]) -> Times:
    """From times.csv, as far as it is of the same log; the rest is measured and added to it."""
    entry = results.manifest["logs"][0]
    path = results.folder / TIMES
    known = _known(path, entry)
    lacking = [row["configuration"] for row in results.overall if row["configuration"] not in known]
    unkept = ""
    if lacking:
        source = sources.of(entry["log"])
        if source.recording is None:
            return Times({}, entry["log"], 0, missing=source.missing)
        frames = list(_some_frames(source.recording))
        if not frames:
            return Times({}, entry["log"], 0, missing=f"no cloud of {entry['log']} could be read for them")
        for name in lacking:
            known[name] = _measured(entry, name, sources.configurations[name], frames)
            advance(1)
        unkept = _keep(path, [known[row["configuration"]] for row in results.overall])
    found = {name: number(row, "median") or 0.0 for name, row in known.items()}
    return Times(found, entry["log"], int(next(iter(known.values()))["frames"]), unkept=unkept)


def _known(path: Path, entry: dict[str, Any]) -> dict[str, dict[str, str]]:
    """The rows that are of this log, by configuration."""
    if not path.exists():
        return {}
    same = (entry["log"], str(entry["sha256"]))
    rows = read_rows(path, COLUMNS)
    return {row["configuration"]: row for row in rows if (row["log"], row["sha256"]) == same}


def _some_frames(recording: Recording) -> Iterator[Frame]:
    """Spread over the log."""
    count = len(recording.scans)
    for place in sorted({(2 * part + 1) * count // (2 * FRAMES) for part in range(FRAMES)}):
        for item in read_frames(recording, place, place + 1):
            if isinstance(item, Frame):
                yield item


def _measured(
    entry: dict[str, Any], name: str, configuration: Configuration, frames: Sequence[Frame]
) -> dict[str, str]:
    """The row of one configuration: of each frame the quickest time."""
    one_thread()
    each = [min(seconds_alone(frame, configuration) for _ in range(REPEATS)) for frame in frames]
    cells = (entry["log"], entry["sha256"], name, len(each), np.median(each), np.quantile(each, 0.95))
    return dict(
        zip(
            COLUMNS,
            (c if isinstance(c, str) else repr(c.item() if isinstance(c, np.generic) else c) for c in cells),
            strict=True,
        )
    )


def _keep(path: Path, rows: Sequence[dict[str, str]]) -> str:
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    try:
        write_whole(path, text.getvalue().encode())
    except GapevalError as error:
        return str(error)
    return ""
