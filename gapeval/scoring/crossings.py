"""What Algorithm 2 says of gaps, against what the labels say."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gapeval.detections import METHODS, Crossing, Method
from gapeval.frame import FloatArray
from gapeval.ragged import IndexArray, sums
from gapeval.scoring.metrics import OF_CROSSINGS
from gapeval.scoring.scene import Scene

# Of each gap, what is known of crossing it; empty where nothing is.
CrossingsOf = Sequence[Mapping[Method, Crossing]]


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """Which gaps can be crossed, under many configurations, by one method; (N,) of each.

    configuration: its place among all; gap: its place in that. length [m], yaw [rad]: of the way.
    """

    configuration: IndexArray
    gap: IndexArray
    traversable: NDArray[np.bool_]
    length: FloatArray
    yaw: FloatArray


def verdicts_of_one(method: Method, crossings: CrossingsOf) -> Verdicts:
    """Those of one set of gaps, of which some may not be known."""
    gaps = [gap for gap, known in enumerate(crossings) if method in known]
    found = [crossings[gap][method] for gap in gaps]
    return Verdicts(
        np.zeros(len(gaps), dtype=np.intp),
        np.array(gaps, dtype=np.intp),
        np.array([crossing.traversable for crossing in found], dtype=np.bool_),
        np.array([crossing.length for crossing in found], dtype=np.float64),
        np.array([crossing.yaw for crossing in found], dtype=np.float64),
    )


def count_gaps(counts: Sequence[int], verdicts: Mapping[Method, Verdicts]) -> dict[str, FloatArray]:
    """The sums that need no labels: gaps, which can be crossed, and how far npca and pca agree; (C,)."""
    number = len(counts)
    columns = {"frames": np.ones(number), "gaps": np.array(counts, dtype=np.float64)}
    for method, of in verdicts.items():
        columns[f"traversable_{method}"] = sums(of.traversable, of.configuration, number)
    npca, pca = verdicts["npca"], verdicts["pca"]
    most = max(counts, default=0) + 1
    _, one, other = np.intersect1d(
        npca.configuration * most + npca.gap, pca.configuration * most + pca.gap, return_indices=True
    )
    owner, angles = npca.configuration[one], axial_angle(npca.yaw[one], pca.yaw[other])
    columns["axis_angles"] = sums(np.ones(len(owner)), owner, number)
    columns["axis_angle_sum"] = sums(angles, owner, number)
    return columns


# What is told of the crossing of one gap; the errors against its label: length signed, yaw axial [rad].
DETAILS = (
    *(f"{method}_{name}" for method in METHODS for name in ("traversable", "length_error", "yaw_error")),
    "axis_angle",
)


def judge_crossings(
    best: IndexArray, scene: Scene, verdicts: Mapping[Method, Verdicts]
) -> tuple[dict[str, FloatArray], FloatArray]:
    """What the labels say of the crossing of the gap that overlaps each of them best: sums, and one by one.

    best: (C, A), -1 where no gap does. Details: (C, A, len(DETAILS)), NaN where undefined.
    """
    number = len(best)
    columns = {name: np.zeros(number) for name in OF_CROSSINGS}
    details = np.full((*best.shape, len(DETAILS)), np.nan)
    yaws = {method: np.full(best.shape, np.nan) for method in METHODS}
    for method, of in verdicts.items():
        most = max(int(best.max(initial=0)), int(of.gap.max(initial=0))) + 1
        key = of.configuration * most + of.gap
        first = DETAILS.index(f"{method}_traversable")
        for label, (placed, gap) in enumerate(zip(scene.asked, best.T, strict=True)):
            hit = np.flatnonzero(gap >= 0)
            row = np.intersect1d(key, hit * most + gap[hit], return_indices=True)[1]
            owner = of.configuration[row]
            told = details[:, label, first : first + 3]
            told[owner, 0] = of.traversable[row]
            yaws[method][owner, label] = of.yaw[row]
            if (can := placed.label.traversable) is not None:
                columns[f"{method}_judged"][owner] += 1
                columns[f"{method}_right"][owner] += of.traversable[row] == can
            if (length := placed.label.length) is not None:
                told[owner, 1] = of.length[row] - length
                columns[f"{method}_lengths"][owner] += 1
                columns[f"{method}_length_error_sum"][owner] += np.abs(told[owner, 1])
            if placed.yaw is not None:
                told[owner, 2] = axial_angle(of.yaw[row], placed.yaw)
                columns[f"{method}_yaws"][owner] += 1
                columns[f"{method}_yaw_error_sum"][owner] += told[owner, 2]
    details[:, :, -1] = axial_angle(yaws["npca"], yaws["pca"])
    return columns, details


def axial_angle(one: FloatArray, other: FloatArray | float) -> FloatArray:
    """Angle between two axes [rad], 0 ... pi/2."""
    difference = np.abs(one - other) % np.pi
    angle: FloatArray = np.minimum(difference, np.pi - difference)
    return angle
