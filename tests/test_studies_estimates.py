"""Figures and intervals of tallies, against plain loops over draws."""

import numpy as np
import pytest

from gapeval.config import Scoring
from gapeval.results.tally import SEED
from gapeval.scoring.intervals import block_draws, log_draws
from gapeval.scoring.metrics import SUMS
from gapeval.studies.estimates import estimates, of_logs
from gapeval.studies.tally import COLUMN, Tally

BLOCK = Scoring().block


def tally(frames_of_cases: dict[int, int], hits: float = 0.5) -> Tally:
    """Ten labels asked for in each frame, of two configurations, and some false gaps."""
    number = sum(frames_of_cases.values())
    random = np.random.default_rng(7)
    sums = np.zeros((number, 2, len(SUMS)))
    for name in ("frames", "scored_frames"):
        sums[..., COLUMN[name]] = 1
    sums[..., COLUMN["asked"]] = 10
    sums[..., COLUMN["hits"]] = random.binomial(10, hits, (number, 2))
    sums[..., COLUMN["false_gaps"]] = random.integers(1, 9, (number, 2))
    case = np.repeat(list(frames_of_cases), list(frames_of_cases.values()))
    stamps = np.concatenate([np.arange(count) * int(BLOCK * 0.6e9) for count in frames_of_cases.values()])
    labels = tuple(frozenset({f"{one} a", f"{one} b"}) for one in case.tolist())
    return Tally(sums, case.astype(np.intp), stamps.astype(np.int64), labels)


def naive(of: Tally, weights: np.ndarray, above: str, below: str, configuration: int) -> list[float]:
    """A figure in each draw. weights: (B, F)."""
    found = []
    for draw in weights:
        top = bottom = 0.0
        for frame, weight in enumerate(draw.tolist()):
            top += weight * of.sums[frame, configuration, COLUMN[above]]
            bottom += weight * of.sums[frame, configuration, COLUMN[below]]
        found.append(top / bottom)
    return found


def of_whole_logs(of: Tally) -> np.ndarray:
    cases = sorted(set(of.case.tolist()))
    draws = log_draws(len(cases), SEED)
    return np.stack([draws[:, cases.index(case)] for case in of.case.tolist()], axis=1)


def of_blocks(of: Tally) -> np.ndarray:
    cases = sorted(set(of.case.tolist()))
    parts = [block_draws(of.stamps[of.case == case], BLOCK, [SEED, at]) for at, case in enumerate(cases)]
    return np.concatenate(parts, axis=1)


@pytest.mark.parametrize(
    ("frames", "drawn"),
    [
        ({3: 2, 5: 1, 6: 3, 8: 2, 9: 1}, of_whole_logs),  # a scene's part of a run: not from 0, not in a row
        ({4: 20}, of_blocks),
        ({4: 12, 7: 14}, of_blocks),  # neither has ten blocks of its own
    ],
)
def test_draws_are_of_whole_logs_or_of_blocks_of_each(frames, drawn) -> None:
    of = tally(frames)
    weights = drawn(of)
    found = list(estimates(of, Scoring(), {"fp_per_frame"}))
    assert len(found) == 2
    for configuration, (figures, counts) in enumerate(found):
        for name, above, below in (
            ("hit_rate", "hits", "asked"), ("fp_per_frame", "false_gaps", "scored_frames")
        ):  # fmt: skip
            one = figures[name]
            each = naive(of, weights, above, below, configuration)
            totals = of.sums[:, configuration].sum(axis=0)
            assert one.value == pytest.approx(totals[COLUMN[above]] / totals[COLUMN[below]])
            assert [one.low, one.high] == pytest.approx(np.quantile(each, [0.025, 0.975]))
            if name == "fp_per_frame":
                np.testing.assert_allclose(one.draws, each)
            else:
                assert one.draws is None
        assert counts["logs"] == len(frames)
        assert counts["frames"] == sum(frames.values())


@pytest.mark.parametrize("frames", [{0: 3}, {0: 3, 1: 2, 2: 1, 5: 2}])
def test_too_few_logs_and_blocks_give_no_interval_and_no_draws(frames) -> None:
    for figures, _ in estimates(tally(frames), Scoring(), {"hit_rate"}):
        one = figures["hit_rate"]
        assert one.value is not None
        assert (one.low, one.high, one.draws) == (None, None, None)


@pytest.mark.parametrize(("hits", "value"), [(0.0, 0.0), (1.0, 1.0)])
def test_all_or_nothing_goes_by_the_number_of_different_labels(hits, value) -> None:
    """Two in each of three logs, however often they are seen."""
    for figures, _ in estimates(tally({2: 3, 3: 2, 5: 1}, hits), Scoring(), ()):
        one = figures["hit_rate"]
        tail = 0.025 ** (1 / 6)
        assert one.value == value
        assert [one.low, one.high] == pytest.approx([tail, 1] if value else [0, 1 - tail])


def test_no_event_goes_by_the_number_of_logs_or_blocks() -> None:
    for frames in ({0: 2, 1: 3, 2: 1, 3: 4, 4: 1}, {0: 4, 1: 2}):
        of = tally(frames)
        of.sums[..., COLUMN["false_gaps"]] = 0
        blocks = sum(
            len({int(stamp // (BLOCK * 1e9)) for stamp in of.stamps[of.case == case].tolist()})
            for case in frames
        )
        number = 5 if len(frames) == 5 else blocks
        for figures, _ in estimates(of, Scoring(), ()):
            one = figures["fp_per_frame"]
            assert (one.value, one.low) == (0, 0)
            assert one.high == pytest.approx(-np.log(0.025) / number)


def test_figures_of_logs_have_an_interval_from_five_on() -> None:
    values = np.array([1.0, 2.0, 4.0, 8.0, 16.0])
    assert of_logs(values[:4], np.mean).low is None
    found = of_logs(values, np.mean)
    chosen = np.random.default_rng(SEED).integers(0, 5, (5, 500))
    each = [values[chosen[:, draw]].mean() for draw in range(500)]
    assert (found.value, found.low, found.high) == pytest.approx((6.2, *np.quantile(each, [0.025, 0.975])))


def test_no_event_goes_by_what_was_labelled() -> None:
    of = tally({0: 12})
    of.sums[..., COLUMN["false_gaps"]] = 0
    of.sums[1:, :, COLUMN["scored_frames"]] = 0
    for figures, _ in estimates(of, Scoring(), ()):
        assert figures["fp_per_frame"].high == pytest.approx(-np.log(0.025))
