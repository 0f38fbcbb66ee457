"""A part: what one unit of a sweep contributes to the result files, in one file."""

import io
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.results.rows import rows_of
from gapeval.results.tables import FRAMES, GAPS, LABELS
from gapeval.scoring.scene import AskedLabel
from gapeval.sweep.units import Task, Unit, run_unit

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

FILES = (FRAMES, LABELS, GAPS)
FAST = 1  # zstd's level


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The frames (n) of a unit under its configurations (C).

    key, first, last: what it was made from, and which frames; see results.parts.
    ids: of the configurations, in the order of the sweep that made it. gaps: whether it has rows of gaps.csv.
    refusals: why clouds were refused, one text each, in order. stamps, digests, points, dropped: of each
    frame. asked: of each frame, its labels (A) that were asked for. hits: (C, sum of A) of them.
    sums: (n, C, len(SUMS)). rows: of each file, its rows. ends: of each file, (n, C), where in its text the
    rows of that frame and configuration end. spent: of each frame, by stage: mean seconds, and how often.
    """

    key: str
    first: int
    last: int
    ids: tuple[str, ...]
    gaps: bool
    refusals: tuple[str, ...]
    stamps: NDArray[np.int64]
    digests: tuple[bytes, ...]
    points: NDArray[np.int64]
    dropped: NDArray[np.int64]
    asked: tuple[tuple[AskedLabel, ...], ...]
    hits: NDArray[np.bool_]
    sums: FloatArray
    rows: Mapping[str, str]
    ends: Mapping[str, NDArray[np.int64]]
    spent: tuple[dict[str, tuple[float, int]], ...]


class UnreadablePartError(Exception):
    """A part that is cut off, damaged, or something else."""


def make_part(task: Task, unit: Unit, stopped: Callable[[], bool]) -> bytes:
    """Evaluate a unit; the part as it is stored."""
    ids = [task.question.configurations[index].id for index in unit.configurations]
    name = task.names[unit.span.recording]
    refusals: list[str] = []
    stamps, digests, points, dropped, sums, spent = [], [], [], [], [], []
    asked: list[tuple[AskedLabel, ...]] = []
    hits = [np.zeros((len(ids), 0), dtype=np.bool_)]
    texts: dict[str, list[str]] = {file: [] for file in FILES}
    for frame in run_unit(task, unit, stopped):
        if frame.answers is None:
            refusals.append(frame.refusal)
            continue
        rows = rows_of(name, frame.stamp, ids, frame.answers)
        for file, each in {FRAMES: rows.frames, LABELS: rows.labels, GAPS: rows.gaps}.items():
            texts[file] += each
        stamps.append(frame.stamp)
        digests.append(frame.digest)
        points.append(frame.points)
        dropped.append(frame.dropped)
        asked.append(frame.answers.asked)
        hits.append(frame.answers.hits)
        sums.append(frame.answers.sums)
        spent.append({stage: (sum(each) / len(each), len(each)) for stage, each in frame.spent.items()})
    shape = (len(digests), len(ids))
    return packed(
        Part(
            key=task.keys[unit.span.recording],
            first=unit.span.first,
            last=unit.span.last,
            ids=tuple(ids),
            gaps=task.question.keep_gaps,
            refusals=tuple(refusals),
            stamps=np.array(stamps, dtype=np.int64),
            digests=tuple(digests),
            points=np.array(points, dtype=np.int64),
            dropped=np.array(dropped, dtype=np.int64),
            asked=tuple(asked),
            hits=np.concatenate(hits, axis=1),
            sums=np.array(sums, dtype=np.float64).reshape(*shape, -1) if sums else np.zeros((*shape, 0)),
            rows={file: "".join(each) for file, each in texts.items()},
            ends={file: _ends(each).reshape(shape) for file, each in texts.items()},
            spent=tuple(spent),
        )
    )


def packed(part: Part) -> bytes:
    """The bytes of a part: arrays as numpy stores them, compressed."""
    about = {
        "key": part.key,
        "first": part.first,
        "last": part.last,
        "ids": part.ids,
        "gaps": part.gaps,
        "refusals": part.refusals,
        "spent": part.spent,
        "asked": [[astuple(label) for label in frame] for frame in part.asked],
    }
    arrays: dict[str, NDArray[Any]] = {
        "about": _bytes(json.dumps(about)),
        "stamps": part.stamps,
        "digests": np.frombuffer(b"".join(part.digests), np.uint8),
        "points": part.points,
        "dropped": part.dropped,
        "hits": part.hits,
        "sums": part.sums,
    }
    arrays |= {f"rows {file}": _bytes(rows) for file, rows in part.rows.items()}
    arrays |= {f"ends {file}": ends for file, ends in part.ends.items()}
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays)  # whose checksums tell damage
    return zstd.compress(file.getbuffer(), FAST)


def unpacked(content: bytes) -> Part:
    """The part of these bytes. Raises UnreadablePartError."""
    try:
        with np.load(io.BytesIO(zstd.decompress(content)), allow_pickle=False) as arrays:
            about = json.loads(arrays["about"].tobytes())
            digests = arrays["digests"].tobytes()
            return Part(
                key=about["key"],
                first=about["first"],
                last=about["last"],
                ids=tuple(about["ids"]),
                gaps=about["gaps"],
                refusals=tuple(about["refusals"]),
                stamps=arrays["stamps"],
                digests=tuple(digests[start : start + 32] for start in range(0, len(digests), 32)),
                points=arrays["points"],
                dropped=arrays["dropped"],
                asked=tuple(tuple(AskedLabel(*label) for label in frame) for frame in about["asked"]),
                hits=arrays["hits"],
                sums=arrays["sums"],
                rows={file: arrays[f"rows {file}"].tobytes().decode() for file in FILES},
                ends={file: arrays[f"ends {file}"] for file in FILES},
                spent=tuple(
                    {stage: (mean, times) for stage, (mean, times) in each.items()} for each in about["spent"]
                ),
            )
    except Exception as error:  # the libraries raise all kinds for what is no such file
        raise UnreadablePartError(f"{type(error).__name__}: {error}") from error


def _bytes(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(text.encode(), np.uint8)


def _ends(texts: Sequence[str]) -> NDArray[np.int64]:
    return np.cumsum([len(text) for text in texts], dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Merged:
    """A unit under all configurations (C) that are asked for, from one part or several.

    rows: of each file. Of each frame: sums (C, len(SUMS)), hits (C, A).
    """

    first: Part
    rows: dict[str, str]
    sums: FloatArray
    hits: list[NDArray[np.bool_]]
    parts: tuple[Part, ...]


def merged(parts: Sequence[Part], ids: Sequence[str], files: Iterable[str]) -> Merged:
    """The parts of a unit as one, in the order of these configurations, each of which is in some part."""
    first = parts[0]
    if first.ids == tuple(ids):
        rows = {file: first.rows[file] for file in files}
        return Merged(first, rows, first.sums, _by_frame(first, first.hits), (first,))
    places = {name: (part, column) for part in reversed(parts) for column, name in enumerate(part.ids)}
    chosen = [places[name] for name in ids]
    used = tuple(part for part in parts if any(part is one for one, _ in chosen))
    rows = {}
    for file in files:
        starts = {id(part): np.concatenate([[0], part.ends[file].ravel()[:-1]]).tolist() for part in used}
        ends = {id(part): part.ends[file].ravel().tolist() for part in used}
        texts = []
        for frame in range(len(first.digests)):
            for part, column in chosen:
                index = frame * len(part.ids) + column
                texts.append(part.rows[file][starts[id(part)][index] : ends[id(part)][index]])
        rows[file] = "".join(texts)
    sums = np.stack([part.sums[:, column] for part, column in chosen], axis=1)
    hits = np.stack([part.hits[column] for part, column in chosen])
    return Merged(first, rows, sums, _by_frame(first, hits), used)


def _by_frame(part: Part, hits: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Hits (C, sum of A) frame by frame."""
    ends = np.cumsum([len(asked) for asked in part.asked], dtype=np.intp)
    return np.split(hits, ends[:-1], axis=1) if len(ends) else []
