"""What the edge of the box does to a gap that it cuts, seen by the paper's rolling laser."""

import numpy as np
import pytest
import shapely

from gapeval.config import Configuration, Detector
from gapeval.detection import detect
from gapeval.frame import Frame, Transform
from gapeval.visibility import domain

LASER = (0.25, 0.0, 0.213)  # in the robot frame, whose ground is at z = 0
TRENCH = shapely.box(2.3, -5.0, 3.5, 5.0)


def rolling_laser(seed: int) -> Frame:
    """One pass of a LMS-151 (541 beams, 131 scans, sigma 1 cm) over flat ground and a trench without echo."""
    random = np.random.default_rng(seed)
    beam, roll = np.meshgrid(
        np.deg2rad(np.arange(-135.0, 135.01, 0.5)), np.deg2rad(np.linspace(-90, 90, 131))
    )
    ray = np.stack([np.cos(beam), np.sin(beam) * np.cos(roll), np.sin(beam) * np.sin(roll)], axis=-1).reshape(
        -1, 3
    )
    ray = ray[ray[:, 2] < -1e-3]
    distance = LASER[2] / -ray[:, 2]
    ray, distance = ray[distance < 20], distance[distance < 20]
    points = np.array(LASER) + ray * (distance + random.normal(0.0, 0.01, len(distance)))[:, None]
    ground = points[(points[:, 0] < TRENCH.bounds[0]) | (points[:, 0] > TRENCH.bounds[2])]
    return Frame(0, ground.astype(np.float32), Transform.of(LASER, [0, 0, 0, 1]))


def coverage_and_false_gaps(edge: str, seed: int) -> tuple[float, int]:
    frame = rolling_laser(seed)
    found = detect(frame, Configuration(detector=Detector(edge=edge)))
    box = domain(0.6, 3.0, LASER[:2], found.plane, frame.sensor, -np.pi / 2, None)
    label = TRENCH.intersection(box)
    false = sum(gap.polygon.intersection(label).area < 0.1 * gap.polygon.area for gap in found.gaps)
    return shapely.union_all(found.gaps.polygons).intersection(label).area / label.area, false


@pytest.mark.parametrize(("edge", "coverage"), [("data", (0.84, 0.89)), ("zero", (0.58, 0.66))])
def test_opening_beyond_the_box_keeps_what_the_box_cuts(edge: str, coverage: tuple[float, float]) -> None:
    """The figures of docs/detector.md: 0.86 against 0.63, the median of ten seeds; no slivers at the rim."""
    found = [coverage_and_false_gaps(edge, seed) for seed in range(10)]
    assert coverage[0] < np.median([share for share, _ in found]) < coverage[1]
    assert [false for _, false in found] == [0] * 10
