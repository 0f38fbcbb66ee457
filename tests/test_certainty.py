"""The weight of a gap: what an uncertain pose leaves of it."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval import detect
from gapeval.config import Configuration, Detector
from gapeval.detection.certainty import weights
from gapeval.frame import Frame, PoseQuality, Transform

RANDOM = settings(deadline=None, derandomize=True, max_examples=60)
PIT = shapely.box(2.0, -1.0, 3.0, 0.5)


def gaps(*polygons):
    array = np.empty(len(polygons), dtype=object)
    array[:] = polygons
    return array


def weight_of(polygon, pl_th=0.1, **quality):
    perfect = {"gap": 0.1, "roll": 0, "pitch": 0, "height": 0}
    (found,) = weights(gaps(polygon), PoseQuality(**(perfect | quality)), pl_th)
    return found


def deviations():
    return st.floats(0.001, 0.3)


@RANDOM
@given(deviations(), deviations(), deviations(), st.floats(0.02, 0.5), st.integers(0, 2**32 - 1))
def test_weight_is_how_often_the_plane_is_right_where_it_is_worst(roll, pitch, height, pl_th, seed):
    """Drawn errors of the pose, each corner by itself."""
    expected = 1.0
    rng = np.random.default_rng(seed)
    errors = rng.normal(0, (roll, pitch, height), (20000, 3))
    for x, y in shapely.get_coordinates(PIT)[:-1]:
        off = errors[:, 2] + y * errors[:, 0] - x * errors[:, 1]
        expected = min(expected, float((np.abs(off) <= pl_th).mean()))
    assert weight_of(PIT, pl_th, roll=roll, pitch=pitch, height=height) == pytest.approx(expected, abs=0.02)


def test_one_standard_deviation_is_two_thirds():
    assert weight_of(PIT, height=0.1) == pytest.approx(0.6827, abs=1e-4)
    assert weight_of(PIT, pitch=0.1 / 3) == pytest.approx(0.6827, abs=1e-4)  # its far edge is at x = 3
    assert weight_of(PIT, roll=0.1) == pytest.approx(0.6827, abs=1e-4)  # it reaches to y = -1
    assert weight_of(PIT, height=0.06, pitch=0.08 / 3) == pytest.approx(0.6827, abs=1e-4)


def test_a_pose_without_error_leaves_all():
    assert weight_of(PIT) == 1.0


def test_farther_and_less_sure_and_stricter_is_less():
    usual = weight_of(PIT, pitch=0.05)
    assert weight_of(shapely.box(3.0, -1.0, 4.0, 0.5), pitch=0.05) < usual
    assert weight_of(PIT, pitch=0.06) < usual
    assert weight_of(PIT, 0.08, pitch=0.05) < usual
    ring = shapely.box(2, -1, 3, 1).difference(shapely.box(2.4, -0.2, 2.6, 0.2))
    assert weight_of(ring, pitch=0.05) == usual


def test_what_is_not_known_has_no_weight():
    assert weights(gaps(PIT, PIT), None, 0.1) == [None, None]
    for name in ("roll", "pitch", "height"):
        assert weight_of(PIT, **{name: math.nan}) is None
    assert weight_of(PIT, gap=math.nan) == 1.0
    assert weights(gaps(), PoseQuality(0, 0, 0, 0), 0.1) == []


def test_each_gap_of_a_detection_has_its_own():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 4, 0.02), np.arange(-3, 3, 0.02)))
    kept = ~(((x > 1.2) & (x < 1.7) & (abs(y) < 0.3)) | ((x > 2.2) & (x < 2.8) & (y > 0.5) & (y < 1.2)))
    points = np.column_stack([x, y, 0 * x])[kept].astype(np.float32)
    quality = PoseQuality(0.1, 0.02, 0.03, 0.01)
    frame = Frame(0, points, Transform.of([0.2, 0, 0.6], [0, 0, 0, 1]), quality=quality)
    found = detect(frame, Configuration(detector=Detector(k=6, n_o=0))).gaps.polygons
    each = weights(found, quality, 0.1)
    assert len(each) > 1
    for polygon, weight in zip(found, each, strict=True):
        places = shapely.get_coordinates(polygon).tolist()
        sigma = max(math.sqrt(0.01**2 + (y * 0.02) ** 2 + (x * 0.03) ** 2) for x, y in places)
        assert weight == pytest.approx(math.erf(0.1 / sigma / math.sqrt(2)), rel=1e-12)
