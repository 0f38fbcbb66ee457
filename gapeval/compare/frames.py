"""The frames behind figures: sums of each frame and configuration, as a table of them holds."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gapeval.errors import GapevalError
from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray
from gapeval.scoring.intervals import Stamps
from gapeval.scoring.metrics import SUMS

if TYPE_CHECKING:
    import pandas as pd

ROWS_AT_A_TIME = 1 << 17


@dataclass(frozen=True, slots=True, eq=False)
class LogFrames:
    """One log. stamps: (F,) ascending [ns]. place: of each configuration in C. sums: (F, C) by name."""

    stamps: Stamps
    place: Mapping[str, int]
    sums: Mapping[str, FloatArray]

    def of(self, configurations: Sequence[str]) -> "LogFrames":
        """Only these configurations, in this order. Raises GapevalError where one is missing."""
        if tuple(configurations) == tuple(self.place):
            return self
        missing = [name for name in configurations if name not in self.place]
        if missing:
            raise GapevalError(f"frames of configuration {missing[0]} are missing")
        chosen = [self.place[name] for name in configurations]
        sums = {name: values[:, chosen] for name, values in self.sums.items()}
        return LogFrames(self.stamps, {name: at for at, name in enumerate(configurations)}, sums)


def read_frames(path: Path, skipped: int, configurations: Collection[str]) -> dict[str, LogFrames]:
    """The frames of these configurations, by log.

    skipped: lines above the header. Rows without a stamp, of whole logs, are left out. Raises GapevalError.
    """
    return {log: _one_log(path, parts) for log, parts in _by_log(path, skipped, configurations).items()}


def _by_log(path: Path, skipped: int, configurations: Collection[str]) -> dict[str, list["pd.DataFrame"]]:
    found: dict[str, list[pd.DataFrame]] = {}
    for rows in _tables(path, skipped):
        wanted = rows["stamp"].notna() & rows["configuration"].isin(list(configurations))
        rows = rows if wanted.all() else rows[wanted]
        for log, of_log in rows.groupby("log", observed=True, sort=False):
            found.setdefault(str(log), []).append(of_log)
    return found


def _tables(path: Path, skipped: int) -> Iterator["pd.DataFrame"]:
    import pandas as pd

    try:
        with pd.read_csv(
            path,
            skiprows=skipped,
            usecols=["log", "stamp", "configuration", *SUMS],
            dtype={"log": "category", "configuration": "category", "stamp": "Int64"}
            | dict.fromkeys(SUMS, np.float64),
            keep_default_na=False,
            na_values=[""],
            chunksize=ROWS_AT_A_TIME,
        ) as tables:
            yield from tables
    except OSError as error:
        raise GapevalError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, TypeError) as error:
        what = " ".join(str(error).split())
        raise GapevalError(f"{path}: not as gapeval writes it: {what}; make it again") from error


def _one_log(path: Path, parts: list["pd.DataFrame"]) -> LogFrames:
    """Rows in any order; each frame must have each configuration once."""
    import pandas as pd

    stamps = np.concatenate([part["stamp"].to_numpy(np.int64) for part in parts])
    names = [part["configuration"].astype(str).to_numpy(object) for part in parts]
    columns, found = pd.factorize(np.concatenate(names))
    every, rows = np.unique(stamps, return_inverse=True)
    place = rows * len(found) + columns
    there = np.zeros(len(every) * len(found), dtype=bool)
    there[place] = True
    if len(place) != len(there) or not there.all():
        raise GapevalError(f"{path}: rows are missing or there twice; make it again")
    shape = len(every), len(found)
    sums = {name: _table([part[name].to_numpy() for part in parts], place, shape) for name in SUMS}
    return LogFrames(every, {str(name): at for at, name in enumerate(found)}, sums)


def _table(columns: list[FloatArray], place: IndexArray, shape: tuple[int, int]) -> FloatArray:
    flat = np.empty(shape[0] * shape[1])
    flat[place] = np.concatenate(columns)
    np.nan_to_num(flat, copy=False)  # not scored: nothing to add
    return flat.reshape(shape)
