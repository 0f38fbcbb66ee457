"""The frames behind figures: sums of each frame and configuration, as a table of them holds."""

import csv
import io
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gapeval.errors import GapevalError
from gapeval.frame import FloatArray
from gapeval.scoring.intervals import Stamps
from gapeval.scoring.metrics import SUMS

if TYPE_CHECKING:
    import pandas as pd

NAMED = ("log", "stamp", "configuration")


@dataclass(frozen=True, slots=True, eq=False)
class LogFrames:
    """One log. stamps: (F,) ascending [ns]. place: of each configuration in C. sums: (F, C) by name."""

    stamps: Stamps
    place: Mapping[str, int]
    sums: Mapping[str, FloatArray]

    def of(self, configurations: Sequence[str]) -> "LogFrames":
        """Only these configurations, in this order. Raises GapevalError where one is missing."""
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
    import pandas as pd

    kinds: dict[str, Any] = {"log": str, "configuration": str, "stamp": "Int64"}
    try:
        with path.open("rb") as file:
            head = next(islice(file, skipped, None), b"")
            names = head.decode("utf-8", "replace").strip().split(",")
            lines = b"".join(
                _of(file, names.index("configuration"), {name.encode() for name in configurations})
            )
        table = pd.read_csv(
            io.BytesIO(lines),
            names=names,
            usecols=[*NAMED, *SUMS],
            dtype=kinds | dict.fromkeys(SUMS, np.float64),
            keep_default_na=False,
            na_values=[""],
        )
    except OSError as error:
        raise GapevalError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, OverflowError, csv.Error) as error:
        what = " ".join(str(error).split())
        raise GapevalError(f"{path}: not as gapeval writes it: {what}; make it again") from error
    rows = table[table["stamp"].notna()]
    return {str(log): _one_log(path, of_log) for log, of_log in rows.groupby("log", sort=False)}


def _of(lines: Iterator[bytes], place: int, configurations: Collection[bytes]) -> Iterator[bytes]:
    """Of many lines those of some configurations, before more is done with them."""
    for line in lines:
        cells = line.split(b",", place + 1)
        # A name that holds a comma or a quote.
        if b'"' in line and any(cell.startswith(b'"') for cell in cells[: place + 1]):
            cells = [cell.encode() for cell in next(csv.reader([line.decode()]))]
        if len(cells) <= place or cells[place] in configurations:  # what is cut off is refused later
            yield line


def _one_log(path: Path, rows: "pd.DataFrame") -> LogFrames:
    """Rows in any order; each frame must have each configuration once."""
    import pandas as pd

    stamps, frames = np.unique(rows["stamp"].to_numpy(np.int64), return_inverse=True)
    columns, found = pd.factorize(rows["configuration"])
    place = frames * len(found) + columns
    if len(place) != len(stamps) * len(found) or len(np.unique(place)) != len(place):
        raise GapevalError(f"{path}: rows are missing or there twice; make it again")
    order, shape = np.argsort(place), (len(stamps), len(found))
    sums = {name: rows[name].to_numpy()[order].reshape(shape) for name in SUMS}
    for name, values in sums.items():
        if np.isinf(values).any():
            raise GapevalError(f"{path}: {name} is infinite; make it again")
        np.nan_to_num(values, copy=False)  # what was not scored adds nothing
    return LogFrames(stamps, {str(name): at for at, name in enumerate(found)}, sums)
