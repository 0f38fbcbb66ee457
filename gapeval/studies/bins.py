"""How radial bins match the spacing of echoes (Section 4.2.1, Fig. 9): on ground without gaps."""

from collections.abc import Callable, Sequence

import numpy as np

from gapeval.config import Config, Configuration
from gapeval.detection.spacing import bin_match
from gapeval.frame import FloatArray, Frame
from gapeval.logs.read import Recording, read_frames
from gapeval.simulate.rings import ring_growth
from gapeval.simulate.sensors import SENSORS
from gapeval.studies.cases import Planned
from gapeval.studies.estimates import Estimate, of_logs
from gapeval.studies.rows import Row, about_configuration, conditions_of
from gapeval.sweep.grid import configurations

BINS = "bins"  # what these rows are told by


def bin_rows(planned: Planned, opened: Sequence[Recording], advance: Callable[[int], object]) -> list[Row]:
    """For all scenes together, under each combination of conditions: a row for each configuration.

    bin_ratio: a row's width to the distance of echoes there; bin_mismatch: |log2| of it; bin_filled: share of
    the cells that hold an echo; ring_growth: of the distances between the sensor's rings, where it has rings.
    """
    found = configurations(planned.config)
    rings = Estimate(_ring_growth(planned.run.sensor, planned.config))
    rows = []
    for keys, cases in conditions_of(planned, by_scene=False):
        measured = np.array([_measured(opened[case], found, advance) for case in cases.tolist()])
        for index, configuration in enumerate(found):
            filled, ratio = measured[:, index].T
            figures = {
                "bin_ratio": of_logs(ratio, np.mean),
                "bin_mismatch": of_logs(np.log2(ratio), lambda logs, **axis: np.abs(np.mean(logs, **axis))),
                "bin_filled": of_logs(filled, np.mean),
                "ring_growth": rings,
            }
            about = {**keys, "by": BINS, **about_configuration(configuration)}
            rows.append(Row(about, figures, {"logs": len(cases)}))
    return rows


def _measured(
    recording: Recording, found: Sequence[Configuration], advance: Callable[[int], object]
) -> FloatArray:
    """Share of cells filled and ratio of bins, means over the frames of a log, (C, 2)."""
    each = []
    for frame in read_frames(recording, 0, len(recording.scans)):
        if isinstance(frame, Frame):
            matches = [bin_match(frame, configuration) for configuration in found]
            each.append([(match.filled, match.ratio) for match in matches])
        advance(1)
    return np.asarray(np.mean(np.array(each).reshape(-1, len(found), 2), axis=0))


def _ring_growth(sensor: str, config: Config) -> float | None:
    return ring_growth(SENSORS[sensor], config.detector.x_min, config.detector.r_max)
