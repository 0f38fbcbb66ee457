"""Intervals: what is drawn, and that they hold what they say."""

import numpy as np
import pytest
import scipy.signal
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval.results.hits import HitCounts
from gapeval.results.replicates import HELD, NAMES, Replicates
from gapeval.results.tally import AllSums, LogSums
from gapeval.scoring import intervals
from gapeval.scoring.intervals import (
    REPLICATES,
    block_draws,
    blocks,
    event_limits,
    interval,
    limits,
    log_draws,
    share_limits,
)
from gapeval.scoring.metrics import METRICS, SUMS, figure
from gapeval.scoring.scene import AskedLabel

SECOND = 1_000_000_000
OF = {metric.name: metric for metric in METRICS}
RANDOM = settings(deadline=None, derandomize=True)


def at(*seconds):
    return np.array([round(second * SECOND) for second in seconds], dtype=np.int64)


def steady(count, period=0.1):
    return np.arange(count) * round(period * SECOND)


# --- what is drawn -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("count", "block", "long"), [(100, 2.0, 20), (60, 0.5, 5), (41, 2.0, 20), (7, 0.1, 1)]
)
def test_blocks_are_whole_and_as_many_as_fit(count, block, long):
    weights = block_draws(steady(count), block, 0).astype(int)
    assert weights.shape == (REPLICATES, count)
    drawn = max(1, round(count / long))
    assert set(weights.sum(axis=1)) == {drawn * long}
    # Around the end, a block begins where more frames than before count, and ends where fewer do.
    begins = np.clip(np.diff(weights, axis=1, prepend=weights[:, -1:]), 0, None)
    assert begins.sum(axis=1).max() <= drawn
    as_long = sum(np.roll(begins, shift, axis=1) for shift in range(long))
    lonely = begins.sum(axis=1) == drawn
    assert lonely.any()
    assert (as_long[lonely] == weights[lonely]).all()


def test_every_frame_counts_once_on_average():
    for stamps in (steady(50), np.sort(np.random.default_rng(1).integers(0, 30 * SECOND, 80))):
        mean = block_draws(stamps, 2.0, 3).mean(axis=0)
        assert mean == pytest.approx(np.ones(len(stamps)), abs=0.25)


def test_frames_that_are_rarer_than_blocks_are_drawn_one_by_one():
    weights = block_draws(at(*range(0, 300, 10)), 2.0, 0).astype(int)
    assert set(weights.sum(axis=1)) == {30}
    neighbours = np.corrcoef(weights.T)[np.arange(29), np.arange(1, 30)]
    assert abs(neighbours).mean() < 0.1


def test_a_pause_is_as_long_as_a_block():
    """Two stretches of 10 s, an hour apart: blocks as of 22 s, and most of them hold frames."""
    stamps = np.concatenate([steady(100), 3600 * SECOND + steady(100)])
    weights = block_draws(stamps, 2.0, 0)
    assert weights.sum(axis=1, dtype=int).max() == 11 * 20
    assert weights.sum(axis=1).mean() == pytest.approx(200, rel=0.05)
    assert blocks(stamps, 2.0)[-1] == 10
    sooner = np.concatenate([steady(100), 60 * SECOND + steady(100)])
    assert (block_draws(sooner, 2.0, 0) == weights).all()


@RANDOM
@given(st.lists(st.integers(0, 20 * SECOND), min_size=1, max_size=40), st.floats(0.01, 30), st.integers(0, 9))
def test_draws_are_those_of_the_seed_whatever_the_stamps(stamps, block, seed):
    stamps = np.sort(np.array(stamps, dtype=np.int64))
    weights = block_draws(stamps, block, seed)
    assert (weights == block_draws(stamps, block, seed)).all()
    assert (weights == block_draws(stamps + 77 * SECOND, block, seed)).all()
    assert weights.any(axis=1).all()
    found = blocks(stamps, block)
    assert found[0] == 0
    assert ((np.diff(found) == 0) | (np.diff(found) == 1)).all()


def test_other_seeds_draw_others():
    assert (block_draws(steady(100), 2.0, 0) != block_draws(steady(100), 2.0, 1)).any()
    assert (block_draws(steady(100), 2.0, [5, 0]) != block_draws(steady(100), 2.0, [5, 1])).any()


def test_of_nothing_nothing_is_drawn():
    assert block_draws(steady(0), 2.0, 0).shape == (REPLICATES, 0)
    assert blocks(steady(0), 2.0).shape == (0,)


def test_blocks_are_counted_one_after_the_other():
    assert blocks(steady(40), 2.0).tolist() == [0] * 20 + [1] * 20
    assert blocks(at(0, 5, 10, 10.5), 2.0).tolist() == [0, 1, 2, 2]


def test_logs_are_drawn_whole():
    weights = log_draws(7, 0)
    assert weights.shape == (REPLICATES, 7)
    assert (weights.sum(axis=1) == 7).all()
    assert weights.mean(axis=0) == pytest.approx(np.ones(7), abs=0.2)


# --- limits ------------------------------------------------------------------------------------------


def test_the_interval_is_the_middle_of_the_replicates():
    found = np.random.default_rng(0).normal(size=(REPLICATES, 3))
    low, high = interval(found)
    assert low == pytest.approx(np.quantile(found, 0.025, axis=0))
    assert high == pytest.approx(np.quantile(found, 0.975, axis=0))
    found[:20, 1] = found[:200, 2] = np.nan
    low, high = interval(found)
    assert (low[1], high[1]) == pytest.approx(np.nanquantile(found[:, 1], [0.025, 0.975]))
    assert np.isnan([low[2], high[2]]).all()


@pytest.mark.parametrize("things", [1, 2, 7, 50, 1000])
def test_limits_of_a_share_of_none_or_all_are_those_of_clopper_and_pearson(things):
    low, high = share_limits(np.array([0.0, 1.0, 0.5, np.nan]), things)
    for hits, index in ((0, 0), (things, 1)):
        exact = scipy.stats.binomtest(hits, things).proportion_ci(0.95, method="exact")
        assert (low[index], high[index]) == pytest.approx((exact.low, exact.high), abs=1e-12)
    assert np.isnan([low[2:], high[2:]]).all()


@pytest.mark.parametrize("things", [1, 3, 40])
def test_limits_of_a_rate_of_none_are_exact(things):
    low, high = event_limits(np.array([0.0, 0.25, np.nan]), things)
    assert (low[0], high[0]) == (0.0, pytest.approx(scipy.stats.chi2.ppf(0.975, 2) / 2 / things))
    assert np.isnan([low[1:], high[1:]]).all()


def test_of_nothing_no_limits_are_known():
    assert np.isnan(share_limits(np.array([0.0, 1.0]), 0)).all()
    assert np.isnan(event_limits(np.array([0.0]), 0)).all()


def test_what_a_metric_counts_decides_its_limits_where_it_is_0_or_1():
    things = {"labels": 3, "judged": np.array([2, 0, 5]), "blocks": 20}
    values, replicates = np.array([1.0, 0.0, 0.5]), np.full((REPLICATES, 3), [1.0, 0.0, 0.5])
    assert limits(OF["hit_rate"], values, replicates, things)[0][0] == pytest.approx(0.025 ** (1 / 3))
    assert limits(OF["precision"], values, replicates, things)[1][1] == pytest.approx(1 - 0.025 ** (1 / 20))
    low, high = limits(OF["npca_accuracy"], values, None, things)
    assert (low[0], high[0]) == pytest.approx((0.025**0.5, 1.0))
    assert np.isnan([low[1:], high[1:]]).all()
    assert limits(OF["fp_per_frame"], values, None, things)[1][1] == pytest.approx(-np.log(0.025) / 20)
    low, high = limits(OF["splits"], values, replicates, things)
    assert (low[0], high[0]) == (1.0, 1.0)


# --- coverage ----------------------------------------------------------------------------------------


def covered(block, logs=300, frames=600):
    """Share of simulated logs whose interval holds the true share of hits, which is a half.

    Hits come in runs, as when the same label stays in view: correlated by a half after one second.
    """
    alike = 0.5**0.1
    noise = np.random.default_rng(7).normal(size=(logs, frames))
    noise[:, 1:] *= np.sqrt(1 - alike**2)
    hits = scipy.signal.lfilter([1.0], [1.0, -alike], noise, axis=1) > 0
    weights = block_draws(steady(frames), block, 0).astype(float)
    low, high = interval((weights @ hits.T) / weights.sum(axis=1, keepdims=True))
    return ((low <= 0.5) & (high >= 0.5)).mean()


def test_blocks_hold_most_of_what_they_say_and_single_frames_hardly_any():
    assert covered(4.0) > 0.75
    assert covered(4.0, frames=3000) > 0.85
    assert covered(0.1) < 0.4


# --- sums of replicates ------------------------------------------------------------------------------


def random_sums(random, frames, configurations):
    found = random.integers(0, 9, (frames, configurations, len(SUMS))) * 0.5
    found[:, :, list(SUMS).index("asked")] = 4  # the same under all configurations
    found[:, :, list(SUMS).index("npca_judged")] = 0
    found[: HELD + 1, :, list(SUMS).index("label_area")] = 2.0  # at first
    return found


def test_replicates_are_sums_of_frames_as_often_as_they_were_drawn():
    random = np.random.default_rng(2)
    frames = random_sums(random, 2 * HELD + 5, 3)
    weights = block_draws(steady(len(frames)), 1.0, 0)
    found = Replicates(3)
    for weight, sums in zip(weights.T, frames, strict=True):
        found.add(weight, sums)
    for name in NAMES:
        expected = np.einsum("bf,fc->bc", weights, frames[:, :, list(SUMS).index(name)])
        np.testing.assert_allclose(np.broadcast_to(found.total(name), expected.shape), expected, rtol=1e-12)


def log_of(frames, stamps, block, seed, asked=(), hits=None):
    log = LogSums(frames.shape[1], stamps, block, seed)
    none = np.zeros((frames.shape[1], len(asked)), dtype=bool)
    for index, (stamp, sums) in enumerate(zip(stamps.tolist(), frames, strict=True)):
        log.add(stamp, sums, asked, none if hits is None else hits[index])
    return log


def sums_with(frames, configurations=1, **columns):
    found = np.zeros((frames, configurations, len(SUMS)))
    for name, values in ({"frames": 1, "scored_frames": 1} | columns).items():
        found[:, :, list(SUMS).index(name)] = np.reshape(values, (-1, 1))
    return found


def test_there_is_no_interval_below_ten_blocks():
    for frames, known in ((180, False), (200, True)):
        hits = np.random.default_rng(0).integers(0, 4, frames)
        log = log_of(sums_with(frames, asked=4, hits=hits), steady(frames), 2.0, 0)
        low, high = log.total().limits["hit_rate"][:, 0]
        assert (low < hits.mean() / 4 < high) == known
        assert np.isnan([low, high]).all() != known


def test_blocks_without_a_scored_frame_do_not_count():
    """A long log of which a few seconds were labelled."""
    frames = 400
    labelled = np.arange(frames) < 100
    sums = sums_with(
        frames, scored_frames=labelled, asked=4 * labelled, hits=labelled, axis_angles=1, axis_angle_sum=0.5
    )
    total = log_of(sums, steady(frames), 2.0, 0).total()
    assert (total.counted.blocks, total.counted.scored_blocks) == (20, 5)
    assert np.isnan(total.limits["hit_rate"]).all()
    assert total.limits["axis_angle"][:, 0].tolist() == [0.5, 0.5]


def test_a_rate_of_one_is_no_surer_than_its_labels():
    frames, asked = 400, (AskedLabel("a", 2.0, 0.5, True), AskedLabel("b", 3.0, 0.5, False))
    sums = sums_with(frames, asked=2, hits=2, npca_judged=1, npca_right=1)
    total = log_of(sums, steady(frames), 2.0, 0, asked, np.ones((frames, 1, 2), dtype=bool)).total()
    assert total.counted.labels == 2
    assert total.limits["hit_rate"][:, 0] == pytest.approx([0.025**0.5, 1.0])
    assert total.limits["npca_accuracy"][:, 0] == pytest.approx([0.025, 1.0])
    assert total.limits["fp_per_frame"][:, 0] == pytest.approx([0.0, -np.log(0.025) / 20])


def all_of(logs):
    found = AllSums(logs[0].shape[1])
    for seed, frames in enumerate(logs):
        log = log_of(frames, steady(len(frames)), 2.0, [1, seed])
        for sums in frames:
            found.sums += sums
        found.include(log, log.total())
    return found.total()


def test_of_few_logs_blocks_are_drawn_and_of_several_whole_logs():
    """Within each log nothing differs, only from log to log: then blocks claim to be sure."""
    logs = [sums_with(200, asked=4, hits=hits) for hits in (0, 1, 2, 3, 4)]
    few, several = all_of(logs[:4]), all_of(logs)
    assert few.limits["hit_rate"][:, 0].tolist() == pytest.approx([0.375, 0.375])
    low, high = several.limits["hit_rate"][:, 0]
    assert low < 0.3 < 0.5 < 0.7 < high
    assert several.counted.blocks == 5
    one = all_of(logs[1:2])
    assert one.limits["hit_rate"][:, 0].tolist() == [0.25, 0.25]


def test_the_draws_are_the_same_for_every_configuration():
    random = np.random.default_rng(4)
    frames = random_sums(random, 300, 1)
    twice = np.concatenate([frames, frames], axis=1)
    total = log_of(twice, steady(300), 2.0, 0).total()
    for of in total.limits.values():
        np.testing.assert_array_equal(of[:, 0], of[:, 1])


def test_an_interval_holds_its_figure():
    random = np.random.default_rng(5)
    frames = random_sums(random, 600, 2)
    total = log_of(frames, steady(600), 2.0, 0).total()
    here = dict(zip(SUMS, total.sums.T, strict=True))
    for metric in METRICS:
        low, high = total.limits[metric.name]
        value = figure(metric, here)
        known = ~np.isnan(low)
        assert (known == ~np.isnan(high)).all()
        assert known.all() or metric.name.startswith("npca_accuracy")
        assert ((low <= value) & (value <= high))[known].all(), metric.name


def test_every_count_of_a_metric_is_known():
    things = {"labels": 1, "judged": 1, "blocks": 1}
    for metric in METRICS:
        limits(metric, np.array([0.0]), None, things)
    assert intervals.needed(METRICS) == NAMES
    assert HitCounts(1).asked.keys() == {"range", "width"}
