"""What every frame of a run added to the sums, read back from its result files."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray
from gapeval.results.hits import EDGES
from gapeval.scoring.metrics import SUMS
from gapeval.studies.cases import Planned
from gapeval.sweep.grid import configurations

COLUMN = {name: index for index, name in enumerate(SUMS)}
BEARING = np.pi / 6  # rad, of a group of labels
RING = 1.0  # m, of a group of false gaps
LETTERS = "abcdefghijklmnopqrstuvwxyz"


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """Sums of frames (F) under configurations (C), and whose they are.

    sums: (F, C, len(SUMS)). case: (F,), place among the run's cases. stamps: (F,) [ns]. labels: (F,), of each
    frame the labels that were asked for. judged: (F,), of each frame, by place of the configuration, those
    that were hit and say whether they can be crossed. watched: (F,), which frames were scored; None: those
    that the sums say. known: the sums that it holds; all others are not 0, but not known.
    """

    sums: FloatArray
    case: IndexArray
    stamps: NDArray[np.int64]
    labels: tuple[frozenset[str], ...]
    judged: tuple[frozenset[tuple[int, str]], ...] = ()
    watched: NDArray[np.bool_] | None = None
    known: frozenset[str] = frozenset(SUMS)

    def of(self, chosen: NDArray[np.bool_]) -> "Tally":
        frames = np.flatnonzero(chosen).tolist()
        return replace(
            self,
            sums=self.sums[chosen],
            case=self.case[chosen],
            stamps=self.stamps[chosen],
            labels=tuple(self.labels[frame] for frame in frames),
            judged=tuple(self.judged[frame] for frame in frames) if self.judged else (),
            watched=None if self.watched is None else self.watched[chosen],
        )

    @property
    def scored(self) -> NDArray[np.bool_]:
        """Which frames were labelled, (F,)."""
        if self.watched is not None:
            return self.watched
        return np.asarray(self.sums[..., COLUMN["scored_frames"]].any(axis=1), dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Tables:
    """The result files of a run. asked: the rows of labels.csv that were asked for.

    Of its rows, which frame and configuration: `frame`, `column`.
    """

    asked: pd.DataFrame
    gaps: pd.DataFrame | None
    whole: Tally
    position: IndexArray  # (F,), of each frame in its log


def read_tables(planned: Planned, folder: Path) -> Tables:
    """Read the result files of a run's folder."""
    frames = read(folder / "frames.csv")
    ids = [configuration.id for configuration in configurations(planned.config)]
    of_frames = frames.iloc[:: len(ids)]
    names = [case.name for case in planned.cases]
    number = {name: index for index, name in enumerate(names)}
    case = np.array([number[log] for log in of_frames["log"]], dtype=np.intp)
    stamps = of_frames["stamp"].to_numpy(dtype=np.int64)
    table = frames.reindex(columns=list(SUMS)).fillna(0.0).to_numpy(dtype=np.float64)
    sums = table.reshape(len(of_frames), len(ids), len(SUMS))
    place = {key: index for index, key in enumerate(zip(of_frames["log"], stamps.tolist(), strict=True))}
    asked = _placed(read(folder / "labels.csv"), place, ids)
    asked = asked[asked["hit"].notna()]
    labels: list[set[str]] = [set() for _ in place]
    judged: list[set[tuple[int, str]]] = [set() for _ in place]
    is_judged = _is_true(asked["hit"]) & asked["traversable"].notna().to_numpy()
    each = zip(asked["frame"], asked["column"], asked["label"], is_judged.tolist(), strict=True)
    for frame, column, name, has_verdict in each:
        key = f"{case[frame]} {name}"
        labels[frame].add(key)
        if has_verdict:
            judged[frame].add((column, key))
    gaps = folder / "gaps.csv"
    position = np.array(of_frames.groupby("log", sort=False).cumcount(), dtype=np.intp)
    return Tables(
        asked,
        _placed(read(gaps), place, ids) if gaps.exists() else None,
        Tally(sums, case, stamps, tuple(map(frozenset, labels)), tuple(map(frozenset, judged))),
        position,
    )


def read(path: Path) -> pd.DataFrame:
    """A result file, every figure as it was."""
    names = {"log": str, "configuration": str, "label": str, "stamp": np.int64}
    return pd.read_csv(path, dtype=names, keep_default_na=False, na_values=[""])


def _placed(table: pd.DataFrame, place: dict[tuple[str, int], int], ids: list[str]) -> pd.DataFrame:
    keys = zip(table["log"], table["stamp"].tolist(), strict=True)
    column = {name: index for index, name in enumerate(ids)}
    return table.assign(frame=[place[key] for key in keys], column=table["configuration"].map(column))


def by_labels(tables: Tables, by: str) -> list[tuple[Any, Tally]]:
    """The sums of groups of labels, each as a tally of its own, in the order of the groups."""
    asked = tables.asked
    group = _label_group(asked, tables, by)
    added = _label_sums(asked)
    return _grouped(tables.whole, asked, group, added)


def _label_group(asked: pd.DataFrame, tables: Tables, by: str) -> NDArray[Any]:
    """The group of each row of labels.csv: the middle of a sector, the lower edge of a range or width."""
    group: NDArray[Any]
    if by == "position":
        group = tables.position[asked["frame"].to_numpy(dtype=np.intp)]
    elif by == "bearing":
        sector = np.floor(asked["bearing"].to_numpy(dtype=np.float64) / BEARING)
        group = np.round((sector + 0.5) * BEARING, 3)
    elif by == "label":
        group = asked["label"].to_numpy(dtype=object)
    else:
        edges = np.array(EDGES[by])
        group = edges[np.searchsorted(edges, asked[by].to_numpy(dtype=np.float64), side="right") - 1]
    return group


def _label_sums(asked: pd.DataFrame) -> dict[str, NDArray[Any]]:
    """What each row of labels.csv adds to the sums."""

    def of(name: str) -> NDArray[np.float64]:
        return np.asarray(asked[name].fillna(0.0), dtype=np.float64)

    hit = _is_true(asked["hit"]).astype(np.float64)
    found = {
        "asked": np.ones(len(asked)),
        "hits": hit,
        "pairs_on_hits": of("gaps") * hit,
        "label_area": of("visible_area"),
        "covered_area": of("covered_area"),
        "edges": asked["near_edge_median"].notna().to_numpy(dtype=np.float64),
        "edge_median_sum": of("near_edge_median"),
        "edge_max_sum": of("near_edge_max"),
        "edge_rays": of("near_edge_rays"),
        "edge_rays_missed": of("near_edge_missed"),
        "axis_angles": asked["axis_angle"].notna().to_numpy(dtype=np.float64),
        "axis_angle_sum": of("axis_angle"),
    }
    for method in ("npca", "pca"):
        for what, many in (("length", "lengths"), ("yaw", "yaws")):
            column = f"{method}_{what}_error"
            found[f"{method}_{many}"] = asked[column].notna().to_numpy(dtype=np.float64)
            found[f"{column}_sum"] = np.abs(of(column))
    return found


def by_gap_range(tables: Tables) -> list[tuple[Any, Tally]]:
    """The gaps of scenes without labels, all of them false, by the distance of their centres."""
    gaps = tables.gaps
    if gaps is None:
        return []
    distance = np.hypot(gaps["npca_centre_x"].to_numpy(), gaps["npca_centre_y"].to_numpy())
    group = (np.floor(distance / RING) + 0.5) * RING
    added = {
        "gaps": np.ones(len(gaps)),
        "false_gaps": np.ones(len(gaps)),
        "over_area_sum": gaps["area"].to_numpy(dtype=np.float64),
    }
    watched = ("frames", "scored_frames")
    found = []
    for ring, tally in _grouped(tables.whole, gaps, group, added):
        sums = tally.sums.copy()
        for name in watched:
            sums[..., COLUMN[name]] = tables.whole.sums[..., COLUMN[name]]
        found.append((ring, replace(tally, sums=sums, known=tally.known | set(watched))))
    return found


def _is_true(column: "pd.Series[Any]") -> NDArray[np.bool_]:
    return np.asarray(column.astype(str).str.lower() == "true", dtype=np.bool_)


def _grouped(
    whole: Tally, rows: pd.DataFrame, group: NDArray[Any], added: dict[str, NDArray[Any]]
) -> list[tuple[Any, Tally]]:
    frame = rows["frame"].to_numpy(dtype=np.intp)
    column = rows["column"].to_numpy(dtype=np.intp)
    found = []
    for one in sorted(set(group.tolist())):
        mine = group == one
        sums = np.zeros_like(whole.sums)
        for name, values in added.items():
            np.add.at(sums[..., COLUMN[name]], (frame[mine], column[mine]), values[mine])
        labels: list[set[str]] = [set() for _ in whole.stamps]
        if "label" in rows:
            for index, name in zip(frame[mine], rows["label"].to_numpy()[mine], strict=True):
                labels[index].add(f"{whole.case[index]} {name}")
        found.append(
            (
                one,
                Tally(
                    sums,
                    whole.case,
                    whole.stamps,
                    tuple(map(frozenset, labels)),
                    watched=whole.scored,
                    known=frozenset(added),
                ),
            )
        )
    return found


def letter(position: int) -> str | int:
    """The paper's positions a, b, c ...; numbers where there are more of them than letters."""
    return LETTERS[position] if position < len(LETTERS) else position
