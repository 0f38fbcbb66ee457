"""How radial bins match the spacing of echoes (Section 4.2.1, Fig. 9): on ground without gaps."""

from collections.abc import Sequence

import numpy as np

from gapeval.config import Configuration
from gapeval.detection import pole
from gapeval.detection.spacing import bin_match
from gapeval.frame import FloatArray, Frame
from gapeval.logs.read import Recording
from gapeval.scoring.scene import common_plane, plane_of
from gapeval.simulate.rings import ring_growth
from gapeval.simulate.sensors import SENSORS
from gapeval.studies.cases import Given, Planned
from gapeval.studies.estimates import Estimate, of_logs
from gapeval.studies.frames import Advance, Tell, usable_frames
from gapeval.studies.rows import Row, about_configuration, conditions_of
from gapeval.sweep.grid import configurations
from gapeval.visibility import domain, lowest_ray

BINS = "bins"  # what these rows are told by


def bin_rows(planned: Planned, opened: Sequence[Recording], advance: Advance, tell: Tell) -> list[Row]:
    """For all scenes together, under each combination of conditions: a row for each configuration.

    bin_ratio: a row's width to the distance of echoes there; bin_mismatch: |log2| of it; bin_filled: share of
    the cells that hold an echo; ring_growth: of the distances between the sensor's rings, where it has rings;
    box_seen: share of the box's ground that a single scan can see, were nothing in the way.
    """
    found = configurations(planned.config)
    rings = Estimate(_ring_growth(planned))
    rows = []
    for keys, cases in conditions_of(planned, by_scene=False):
        measured = np.array([_measured(opened[case], found, advance, tell) for case in cases.tolist()])
        for index, configuration in enumerate(found):
            filled, ratio, seen = measured[:, index].T
            figures = {
                "bin_ratio": of_logs(ratio, np.mean),
                "bin_mismatch": of_logs(np.log2(ratio), lambda logs, **axis: np.abs(np.mean(logs, **axis))),
                "bin_filled": of_logs(filled, np.mean),
                "ring_growth": rings,
                "box_seen": of_logs(seen, np.mean),
            }
            about = {**keys, "by": BINS, **about_configuration(configuration)}
            rows.append(Row(about, figures, {"logs": len(cases)}))
    return rows


def _measured(
    recording: Recording, found: Sequence[Configuration], advance: Advance, tell: Tell
) -> FloatArray:
    """Share of cells filled, ratio of bins, share of the box seen: means over the frames of a log, (C, 3).

    Frames of which one is not known are left out of it; NaN where all are.
    """
    each = []
    for frame in usable_frames(recording, advance, tell):
        matches = [bin_match(frame, configuration) for configuration in found]
        seen = [box_seen(frame, configuration) for configuration in found]
        each.append([(match.filled, match.ratio, share) for match, share in zip(matches, seen, strict=True)])
    values = np.array(each, dtype=np.float64).reshape(-1, len(found), 3)
    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, values, 0.0).sum(axis=0) / known.sum(axis=0))


def box_seen(frame: Frame, configuration: Configuration) -> float:
    """Share of the sensory box's ground that is neither below the lowest ray nor out of the field of view."""
    params, sensor = configuration.detector, configuration.sensor
    plane = plane_of(frame, common_plane([configuration]), configuration.robot)
    box = params.x_min, params.r_max, pole(frame, params.origin), plane
    whole = domain(*box, frame.sensor, -np.pi / 2, None).area
    seen = domain(*box, frame.sensor, lowest_ray(sensor, frame), sensor.fov).area
    return float(seen / whole) if whole else np.nan


def _ring_growth(planned: Planned) -> float | None:
    """Of the simulated sensor; that of a log's own is not known."""
    if any(isinstance(case.source, Given) for case in planned.cases):
        return None
    detector = planned.config.detector
    return ring_growth(SENSORS[planned.run.sensor], detector.x_min, detector.r_max)
