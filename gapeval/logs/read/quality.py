"""How well the pose at a stamp is known: by the log's covariance, and by how far apart its poses are."""

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray, PoseQuality, rotation_matrices
from gapeval.logs.read.transforms import (
    Bracket,
    Stamps,
    Transforms,
    compose,
    conjugate,
    inverse,
    product,
    rotation_vectors,
)


def pose_quality(
    pose: Transforms, between: Bracket, widest: Stamps, covariances: NDArray[np.float64] | None
) -> FloatArray:
    """(n, 4): what PoseQuality holds, in its order.

    pose: fixed<-robot at n stamps, between: the samples on either side. widest: (n,) ns, gaps of all
    transforms that the clouds came by. covariances: (n, 6, 6) in the fixed frame, as ROS has them.

    A pose that is interpolated is wrong by no more than the nearer sample differs from it, or so: that is
    added, as a standard deviation, to what the log says itself.
    """
    change = np.minimum(_change(between.before, pose), _change(pose, between.after))
    variance = change**2
    if covariances is not None:
        variance = variance + np.nan_to_num(_variances(pose, covariances), nan=0.0)
    return np.column_stack([np.maximum(between.width, widest) / 1e9, np.sqrt(variance)])


def quality_at(table: FloatArray, index: int) -> PoseQuality:
    """One row of it."""
    return PoseQuality(*table[index].tolist())


def nearest_covariances(
    stamps: Stamps, sampled: Stamps, covariances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Of the sample nearest to each stamp (n,): (n, 6, 6)."""
    right = np.clip(np.searchsorted(sampled, stamps), 1, max(len(sampled) - 1, 1))
    right = np.minimum(right, len(sampled) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(stamps - sampled[left] <= sampled[right] - stamps, left, right)
    return covariances[nearer]


def _change(one: Transforms, other: Transforms) -> FloatArray:
    """Roll, pitch [rad] and height [m] from one to the other, (n, 3), in the first one's frame."""
    turn = rotation_vectors(product(conjugate(one.quaternion), other.quaternion))
    step = compose(inverse(one), other).translation
    return np.abs(np.column_stack([turn[:, 0], turn[:, 1], step[:, 2]]))


def _variances(pose: Transforms, covariances: NDArray[np.float64]) -> FloatArray:
    """Of roll, pitch and height (n, 3), in the robot frame."""
    turn = rotation_matrices(pose.quaternion)
    place = np.einsum("nji,njk,nkl->nil", turn, covariances[:, :3, :3], turn)
    attitude = np.einsum("nji,njk,nkl->nil", turn, covariances[:, 3:, 3:], turn)
    return np.column_stack([attitude[:, 0, 0], attitude[:, 1, 1], place[:, 2, 2]])
