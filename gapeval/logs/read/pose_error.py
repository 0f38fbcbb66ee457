"""Poses made wrong on purpose: what errors of the robot's attitude do (Section 4.5 of the paper)."""

import numpy as np

from gapeval.config import LogSection, PoseError, PoseNoise
from gapeval.frame import FloatArray
from gapeval.logs.read.transforms import Stamps, Transforms

NO_ERROR, NO_NOISE = PoseError(), PoseNoise()
UNSIGNED = 2**64  # a generator's seed cannot be negative


def errors_asked(settings: LogSection) -> tuple[PoseError | None, PoseNoise | None]:
    """The error and the noise that change anything; None for all else."""
    error, noise = settings.pose_error, settings.pose_noise
    silent = noise is None or noise.model_copy(update={"seed": NO_NOISE.seed}) == NO_NOISE
    return None if error == NO_ERROR else error, None if silent else noise


def error_of(stamps: Stamps, error: PoseError | None, noise: PoseNoise | None) -> Transforms | None:
    """What a robot that errs in its attitude and height makes of its own frame at stamps (n,) [ns]: wrong
    robot<-robot, (n,); None where it does not err.

    As where a cloud is assembled in the fixed frame and comes back by another pose: the points move, the
    sensor on the robot does not.
    """
    if error is None and noise is None:
        return None
    amount = np.zeros((len(stamps), 3))
    if error is not None:
        amount += (error.roll, error.pitch, error.height)
    if noise is not None:
        amount += _drawn(stamps, noise.seed) * (noise.roll, noise.pitch, noise.height)
    return _wrong(amount)


def _drawn(stamps: Stamps, seed: int) -> FloatArray:
    """Three standard normal numbers for each stamp, (n, 3), which depend on nothing else."""
    drawn = [np.random.default_rng([seed, int(stamp) % UNSIGNED]).normal(size=3) for stamp in stamps]
    return np.array(drawn).reshape(-1, 3)


def _wrong(amount: FloatArray) -> Transforms:
    """wrong robot<-robot, of roll, pitch [rad] and height [m], (n, 3): about x, then about y, then up."""
    roll, pitch, height = amount.T
    a, b = np.sin(roll / 2), np.cos(roll / 2)
    c, d = np.sin(pitch / 2), np.cos(pitch / 2)
    level = np.zeros(len(amount))
    return Transforms(np.column_stack([level, level, height]), np.column_stack([a * d, b * c, -a * c, b * d]))
