"""How long a configuration alone takes (Section 4.8): one thread, one frame at a time, nothing shared."""

from collections.abc import Sequence

import numpy as np

from gapeval.config import Configuration
from gapeval.frame import FloatArray, Frame
from gapeval.logs.read import Recording
from gapeval.studies.cases import Planned
from gapeval.studies.estimates import Estimate, of_frames
from gapeval.studies.frames import Advance, Tell, usable_frames
from gapeval.studies.rows import Row, about_configuration, conditions_of
from gapeval.sweep.alone import seconds_alone
from gapeval.sweep.executor import one_thread
from gapeval.sweep.grid import configurations

REPEATS = 3  # of which the first, that fills caches, does not count


def time_rows(planned: Planned, opened: Sequence[Recording], advance: Advance, tell: Tell) -> list[Row]:
    """For all scenes together, under each combination of conditions: a row for each configuration [s]."""
    one_thread()
    found = configurations(planned.config)
    rows = []
    for keys, cases in conditions_of(planned, by_scene=False):
        taken: list[list[float]] = []
        points: list[int] = []
        for case in cases.tolist():
            for frame in usable_frames(opened[case], advance, tell):
                points.append(len(frame.points))
                taken.append([alone(frame, configuration) for configuration in found])
        if not taken:
            continue
        seconds = np.array(taken).reshape(len(taken), len(found))
        number = float(np.median(points))
        for index, configuration in enumerate(found):
            figures = {"points": Estimate(number), **figures_of(seconds[:, index])}
            rows.append(
                Row(
                    {**keys, "points": number, **about_configuration(configuration)},
                    figures,
                    {"frames": len(points)},
                )
            )
    return rows


def alone(frame: Frame, configuration: Configuration) -> float:
    """Seconds, on average over the times that it was done again."""
    taken = [seconds_alone(frame, configuration) for _ in range(REPEATS)]
    return float(np.mean(taken[1:]))


def figures_of(each: FloatArray) -> dict[str, Estimate]:
    """Of the times of frames (F,), drawn anew by frames."""
    return {
        "median": of_frames(each, np.median),
        "p95": of_frames(each, lambda one, **axis: np.quantile(one, 0.95, **axis)),
        "mean": of_frames(each, np.mean),
        "least": Estimate(float(each.min())),
        "most": Estimate(float(each.max())),
    }
