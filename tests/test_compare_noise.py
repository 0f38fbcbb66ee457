"""Whether a change is more than other frames would bring, against the definition written out."""

import math
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from command import gapeval
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from result_folders import cells, compared, copied, edited, shown, swept, table, the_change, the_row

from gapeval.compare.frames import LogFrames
from gapeval.compare.noise import Pair, noises, pair
from gapeval.compare.outcome import FINE, Noise
from gapeval.results.figures import FIGURES, Figure
from gapeval.scoring.intervals import block_draws, log_draws

SECOND = 1_000_000_000
SEED = 2013
RATIOS = [figure for figure in FIGURES.values() if figure.above]
REAL = ("_sum", "_area")
RANDOM = settings(deadline=None, derandomize=True, max_examples=30)
Frames = list[dict[str, float]]  # of one configuration: sums of each frame


# The definition


def ratio(figure: Figure, frames: Frames, weights: Sequence[float]) -> float:
    """Sums over frames, divided once; NaN where undefined."""
    above = below = 0.0
    for frame, weight in zip(frames, weights, strict=True):
        above += weight * sum(times * frame[name] for name, times in figure.above.items())
        below += weight * sum(times * frame[name] for name, times in figure.below.items())
    return above / below if below else math.nan


def middle(differences: list[float]) -> tuple[float, float]:
    """The middle 95 %, linear between neighbours; NaN if more than one in twenty is undefined."""
    defined = sorted(value for value in differences if not math.isnan(value))
    if len(defined) < 0.95 * len(differences):
        return math.nan, math.nan
    ends = []
    for share in (0.025, 0.975):
        place = share * (len(defined) - 1)
        low = math.floor(place)
        high = min(low + 1, len(defined) - 1)
        ends.append(defined[low] + (place - low) * (defined[high] - defined[low]))
    return ends[0], ends[1]


def naive(
    figure: Figure, logs: Sequence[tuple[np.ndarray, Frames, Frames]], block: float
) -> tuple[float, float]:
    """logs: stamps, and the frames of both results."""
    if sum(any(frame["scored_frames"] for frame in before) for _, before, _ in logs) >= 5:
        of_logs = log_draws(len(logs), SEED)
        drawn = [
            np.concatenate([np.full(len(stamps), row[at]) for at, (stamps, _, _) in enumerate(logs)])
            for row in of_logs.tolist()
        ]
    else:
        each = [block_draws(stamps, block, [SEED, at]) for at, (stamps, _, _) in enumerate(logs)]
        drawn = list(np.concatenate(each, axis=1))
    before = [frame for _, frames, _ in logs for frame in frames]
    after = [frame for _, _, frames in logs for frame in frames]
    return middle(
        [
            ratio(figure, after, row) - ratio(figure, before, row)
            for row in (weights.tolist() for weights in drawn)
        ]
    )


# Small results


def frames_of(random: np.random.Generator, count: int, names: Sequence[str], share: float) -> Frames:
    """share: of frames in which a sum is not 0."""

    def value(name: str) -> float:
        if random.random() > share:
            return 0.0
        return float(random.uniform(0, 3)) if name.endswith(REAL) else float(random.integers(1, 4))

    return [{name: value(name) for name in names} for _ in range(count)]


def log_frames(stamps: np.ndarray, columns: Sequence[Frames]) -> LogFrames:
    names = list(columns[0][0])
    sums = {name: np.array([[frame[name] for frame in frames] for frames in columns]).T for name in names}
    return LogFrames(stamps, {str(at): at for at in range(len(columns))}, sums)


def totals(figure: Figure, logs: Sequence[Frames]) -> float:
    frames = [frame for log in logs for frame in log]
    return ratio(figure, frames, [1.0] * len(frames))


@RANDOM
@given(
    figure=st.sampled_from(RATIOS),
    seed=st.integers(0, 1 << 32),
    logs=st.sampled_from([1, 1, 1, 2, 4, 5, 7]),
    count=st.integers(12, 24),
    share=st.sampled_from([0.15, 0.5, 0.9, 1.0]),
    moved=st.sampled_from([0.1, 0.5, 1.0]),
    is_pick=st.booleans(),
)
def test_noise_is_what_its_definition_says(
    figure: Figure, seed: int, logs: int, count: int, share: float, moved: float, is_pick: bool
) -> None:
    random = np.random.default_rng(seed)
    names = list(dict.fromkeys(("scored_frames", *figure.above, *figure.below)))
    rows, block = 3, 0.2
    of_logs, pairs = [], []
    for at in range(logs):
        stamps = np.cumsum(random.integers(SECOND // 20, SECOND // 2, count)).astype(np.int64)
        before = [frames_of(random, count, names, share) for _ in range(rows)]
        after = [
            [
                other if random.random() < moved else frame
                for frame, other in zip(frames, frames_of(random, count, names, share), strict=True)
            ]
            for frames in before
        ]
        for frames in (*before, *after):  # which frames are labelled is the same for all
            for frame, first in zip(frames, before[0], strict=True):
                frame["scored_frames"] = float(first["scored_frames"] > 0)
        of_logs.append((stamps, before, after))
        pairs.append(pair(log_frames(stamps, before), log_frames(stamps, after), block, at))
    places = [2, 0] if is_pick else [0, 1, 2]
    values = np.array(
        [[totals(figure, [sides[side][at] for sides in of_logs]) for at in places] for side in (1, 2)]
    )
    found = noises(figure, pairs, np.array(places), values)
    assert len(found) == len(places)
    for at, value, noise in zip(places, values.T, found, strict=True):
        if "to draw from" in noise.unknown:
            continue
        if np.isnan(value).any():
            assert "do not add up" in noise.unknown
            continue
        low, high = naive(figure, [(stamps, one[at], other[at]) for stamps, one, other in of_logs], block)
        assert (noise.unknown != "") is math.isnan(low)
        if not noise.unknown:
            size = max(1.0, abs(low), abs(high))
            assert (noise.low, noise.high) == (
                pytest.approx(low, abs=3e-6 * size),
                pytest.approx(high, abs=3e-6 * size),
            )
            if min(abs(low), abs(high)) > 1e-5 * size:
                assert noise.beyond is (not low <= 0 <= high)
    assume(any(not noise.unknown for noise in found))


HITS = FIGURES["hit_rate"]


def one_log(before: Sequence[float], after: Sequence[float], block: float = 0.1, place: int = 0) -> Pair:
    """Frames at 10 Hz with a label each, hit or not."""
    stamps = np.arange(len(before)) * (SECOND // 10)
    one, other = (
        log_frames(stamps, [[{"scored_frames": 1.0, "asked": 1.0, "hits": hit} for hit in hits]])
        for hits in (before, after)
    )
    return pair(one, other, block, place)


def noise_of(*pairs: Pair) -> Noise:
    values = [
        sum(side.sums["hits"].sum() for side in sides) / sum(len(side.stamps) for side in sides)
        for sides in ([one.base for one in pairs], [one.new for one in pairs])
    ]
    (found,) = noises(HITS, pairs, np.array([0]), np.array(values)[:, None])
    return found


def test_a_change_in_all_frames_alike_is_beyond_and_one_in_a_single_frame_is_not() -> None:
    everywhere = noise_of(one_log([1.0] * 30, [0.0] * 30))
    assert (everywhere.beyond, everywhere.low, everywhere.high) == (True, -1.0, -1.0)
    once = noise_of(one_log([1.0] * 30, [1.0] * 29 + [0.0]))
    assert once.beyond is False
    assert once.high == 0.0 > once.low
    gained = noise_of(one_log([0.0] + [1.0] * 29, [1.0] * 30))
    assert gained.beyond is False
    assert gained.low == 0.0 < gained.high
    assert noise_of(one_log([1.0] * 30, [1.0] * 15 + [0.0] * 15)).beyond is True
    balanced = noise_of(one_log([1.0, 0.0] * 15, [0.0, 1.0] * 15))
    assert (balanced.beyond, balanced.unknown) == (False, "")


def test_last_bits_are_no_noise() -> None:
    """In all frames one bit less, as another machine may have it, and in a single one much less."""
    bit = math.nextafter(1.0, 0.0)
    assert noise_of(one_log([1.0] * 30, [bit] * 30)).beyond is False
    assert noise_of(one_log([1.0] * 30, [bit] * 29 + [0.0])).beyond is False
    assert noise_of(one_log([bit] * 30, [1.0] * 29 + [2.0])).beyond is False
    assert noise_of(one_log([1.0] * 30, [1.0 - 1e-6] * 30)).beyond is True


def test_ten_blocks_of_time_are_needed() -> None:
    for block, number in ((0.3, 10), (0.34, 9)):
        found = noise_of(one_log([1.0] * 30, [0.0] * 30, block))
        assert (found.beyond is None) is (number < 10)
        if number < 10:
            assert found.unknown == "9 blocks of time to draw from, 10 are needed"
    halves = [one_log([1.0] * 15, [0.0] * 15, 0.3, place) for place in (0, 1)]
    assert noise_of(*halves).beyond is True


def test_from_five_logs_on_whole_logs_are_drawn() -> None:
    """In one of them all is lost: with blocks that would be beyond noise, with logs it is not."""
    logs = [one_log([1.0] * 12, [1.0] * 12, place=place) for place in range(5)]
    logs[2] = one_log([1.0] * 12, [0.0] * 12, place=2)
    assert noise_of(*logs[:4]).beyond is True
    assert noise_of(*logs).beyond is False
    # One without labels is none of five.
    stamps = np.arange(12) * (SECOND // 10)
    nothing = log_frames(stamps, [[{"scored_frames": 0.0, "asked": 0.0, "hits": 0.0}] * 12])
    unlabelled = pair(nothing, nothing, 0.1, 4)
    assert (unlabelled.evaluated, unlabelled.scored) == (12, 0)
    values = np.array([[1.0], [0.75]])
    (found,) = noises(HITS, [*logs[:4], unlabelled], np.array([0]), values)
    assert (found.beyond, found.unknown) == (True, "")


def test_frames_without_labels_are_no_blocks_of_what_needs_labels() -> None:
    stamps = np.arange(30) * (SECOND // 10)
    frames = [
        {"scored_frames": float(at < 5), "asked": float(at < 5), "hits": float(at < 5)} for at in range(30)
    ]
    lost = [frame | {"hits": 0.0} for frame in frames]
    one = pair(log_frames(stamps, [frames]), log_frames(stamps, [lost]), 0.1, 0)
    (found,) = noises(HITS, [one], np.array([0]), np.array([[1.0], [0.0]]))
    assert found.unknown.startswith("5 blocks of time")


def test_frames_of_other_results_say_nothing() -> None:
    one = one_log([1.0] * 30, [0.0] * 30)
    for before, after, fits in ((1.0, 0.0, True), (0.9, 0.0, False), (1.0, 0.1, False)):
        (found,) = noises(HITS, [one], np.array([0]), np.array([[before], [after]]))
        assert ("do not add up" in found.unknown) is not fits


# Whole results


@pytest.fixture
def moved(results: Path, tmp_path: Path) -> Callable[[set[int]], Path]:
    """Results in which the trench is missed by a configuration in these frames of one log."""

    def made(frames: set[int]) -> Path:
        new = copied(results, tmp_path / f"{len(list(tmp_path.iterdir()))}")
        here = {"log": "a.mcap", "configuration": "2fb9257526a2"}
        stamps = [row["stamp"] for row in table(new / "frames.csv") if row.items() >= here.items()]
        for index in frames:
            at = here | {"stamp": stamps[index]}
            edited(new, cells(at, hits="0"), "frames.csv")
            edited(new, cells(at, hit="false", gaps="0"), "labels.csv")
        hits = len(stamps) - len(frames)
        return edited(new, cells(here, hits=str(hits), hit_rate=hits / len(stamps)))

    return made


@pytest.mark.parametrize(("frames", "beyond"), [({4}, False), ({4, 5, 6, 20}, True), (set(range(24)), True)])
def test_which_frames_and_labels_changed(
    results: Path, moved: Callable[[set[int]], Path], frames: set[int], beyond: bool
) -> None:
    row = the_row(compared(results, moved(frames)), "a.mcap", "2fb9257526a2")
    noise = the_change(row, "hit_rate").noise
    assert noise is not None
    assert noise.beyond is beyond
    assert the_change(row, "hits").noise is None
    assert row.frames == tuple(sorted(frames))
    (label,) = row.labels or ()
    assert (label.label, label.was, label.now, label.frames) == ("trench", "hit", "missed", row.frames)
    assert all(
        stamp == 1_600_000_000 * SECOND + index * SECOND // 10
        for index, stamp in zip(label.frames, label.stamps, strict=True)
    )


def test_all_logs_are_drawn_from_in_the_row_of_all(results: Path, moved: Callable[[set[int]], Path]) -> None:
    new = moved({4, 5, 6, 20})
    edited(new, cells({"log": "all", "configuration": "2fb9257526a2"}, hit_rate=32 / 36, hits="32"))
    row = the_row(compared(results, new), "all", "2fb9257526a2")
    noise = the_change(row, "hit_rate").noise
    alone = the_change(the_row(compared(results, new), "a.mcap", "2fb9257526a2"), "hit_rate").noise
    assert noise is not None
    assert alone is not None
    assert noise.beyond is True
    assert alone.low < noise.low < 0
    assert (row.frames, row.labels, row.unknown) == (None, None, "")


def test_the_same_bytes_on_every_run_and_in_another_process(
    results: Path, moved: Callable[[set[int]], Path]
) -> None:
    new = moved({4, 5, 6, 20})
    first, second = (gapeval("compare", results, new, "--format", "json").out for _ in range(2))
    command = [sys.executable, "-P", "-m", "gapeval", "compare", results, new, "--format", "json"]
    environment = os.environ | {"PYTHONHASHSEED": "7", "OMP_NUM_THREADS": "4"}
    other = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert first == second == other.stdout
    assert '"beyond": true' in first


def test_the_block_of_new_decides(tmp_path: Path) -> None:
    """Nothing but noise depends on it; with wide blocks there are too few."""
    folder = swept(tmp_path, (24,), ("-p", "pl_th=0.05", "-p", "d_r=0.8"))
    new = edited(copied(folder, tmp_path / "new"), cells({}, coverage=0.9))
    status, document = shown(folder, new)
    assert status == FINE
    (row,) = document["rows"]
    assert row["changes"][0]["noise"]["unknown"] == "2 blocks of time to draw from, 10 are needed"
