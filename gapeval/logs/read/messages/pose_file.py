"""Text files of poses, known by their columns: TUM (time, pose) and KITTI (upper 3 x 4 of a matrix)."""

from collections.abc import Sequence
from decimal import Decimal, DecimalException
from pathlib import Path

import numpy as np

from gapeval.errors import LogError
from gapeval.frame import FloatArray
from gapeval.logs.read.messages.cloud import FARTHEST
from gapeval.logs.read.messages.measurement import StampedPose

PARENT = "map"
CALIBRATION = "calib.txt"  # of KITTI, beside the poses
TUM, KITTI = 8, 12  # columns
NO_UNIT = 0.1  # how far from 1 the length of a quaternion may be
NO_ROTATION = 1e-2  # how far from orthonormal a matrix may be
LATEST = 1 << 62  # ns


def read_pose_file(
    path: Path, stamps: Sequence[int] | None = None, calibration: Path | None = None
) -> list[StampedPose]:
    """The poses of a file, in its order, in the frame `map`; they do not name what they are poses of.

    stamps: [ns] of the poses, which a KITTI file does not have. calibration: a KITTI calib.txt; with it,
    poses are of the laser and not of the camera. Raises LogError for what is neither TUM nor KITTI.
    """
    rows = _rows(path)
    if not rows:
        raise LogError(f"{path}: holds no pose; give a file of TUM or KITTI poses")
    columns = len(rows[0][1])
    if columns == TUM:
        return [_tum_pose(path, number, words) for number, words in rows]
    if columns != KITTI:
        raise LogError(
            f"{path}: {columns} columns; TUM poses have {TUM} (time x y z qx qy qz qw), KITTI's have {KITTI}"
        )
    if stamps is None:
        raise LogError(f"{path}: KITTI poses have no times; add times.txt with a line for each, or use TUM")
    if len(stamps) != len(rows):
        raise LogError(f"{path}: {len(rows)} poses for {len(stamps)} times; both must be as many")
    laser = np.eye(4) if calibration is None else _laser_calibration(calibration)
    back = np.linalg.inv(laser)
    return [
        _matrix_pose(path, number, stamp, back @ _matrix(path, number, words) @ laser)
        for stamp, (number, words) in zip(stamps, rows, strict=True)
    ]


def is_tum(path: Path) -> bool:
    """Whether the poses of a file have times."""
    rows = _rows(path)
    return bool(rows) and len(rows[0][1]) == TUM


def read_times(path: Path) -> list[int]:
    """The times [ns] of a file with one number of seconds on each line."""
    times = []
    for number, words in _rows(path):
        if len(words) != 1:
            raise LogError(f"{path}: line {number} has {len(words)} columns; it must be one time in seconds")
        times.append(nanoseconds(path, number, words[0]))
    return times


def nanoseconds(path: Path, number: int, text: str) -> int:
    """Seconds as text -> ns, exactly."""
    try:
        stamp = int((Decimal(text) * 1_000_000_000).to_integral_value())
    except (DecimalException, ValueError, OverflowError) as error:
        raise LogError(f"{path}: line {number}: {text[:40]!r} is no time in seconds") from error
    if abs(stamp) >= LATEST:
        raise LogError(f"{path}: line {number}: {text[:40]} s is no time since 1970; TUM has seconds")
    return stamp


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """(number, words) of each line that is neither empty nor a comment."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}; name a file of poses") from error
    except UnicodeDecodeError as error:
        raise LogError(f"{path}: no text; give a file of TUM or KITTI poses") from error
    lines = enumerate(text.splitlines(), start=1)
    return [
        (number, line.replace(",", " ").split())
        for number, line in lines
        if line.strip() and not line.lstrip().startswith("#")
    ]


def _numbers(path: Path, number: int, words: Sequence[str], count: int) -> FloatArray:
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise LogError(f"{path}: line {number} has what is no number: {error}") from error
    if len(values) != count:
        raise LogError(f"{path}: line {number} has {len(values)} columns, where {count} are needed")
    if not (np.abs(values) < FARTHEST).all():
        raise LogError(f"{path}: line {number} has numbers that are not finite, or no place on earth")
    return values


def _tum_pose(path: Path, number: int, words: list[str]) -> StampedPose:
    stamp = nanoseconds(path, number, words[0])
    values = _numbers(path, number, words, TUM)[1:]
    if not values[3:].any():
        raise LogError(f"{path}: line {number} has a quaternion of zeros; it must be x y z qx qy qz qw")
    if abs((length := float(np.linalg.norm(values[3:]))) - 1) > NO_UNIT:
        raise LogError(
            f"{path}: line {number} has a quaternion of length {length:.3g}; it must be of length 1"
        )
    return StampedPose(stamp, PARENT, "", tuple(values.tolist()))


def _matrix(path: Path, number: int, words: Sequence[str]) -> FloatArray:
    matrix = np.eye(4)
    matrix[:3] = _numbers(path, number, words, KITTI).reshape(3, 4)
    turn = matrix[:3, :3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > NO_ROTATION or np.linalg.det(turn) < 0:
        raise LogError(f"{path}: line {number} is no rotation and translation, row by row")
    return matrix


def _matrix_pose(path: Path, number: int, stamp: int, matrix: FloatArray) -> StampedPose:
    return StampedPose(stamp, PARENT, "", (*matrix[:3, 3].tolist(), *quaternion(matrix[:3, :3]).tolist()))


def quaternion(matrix: FloatArray) -> FloatArray:
    """x, y, z, w of a rotation matrix (3, 3): the eigenvector of a form, robust to rounding."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    form = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    found: FloatArray = np.linalg.eigh(form)[1][:, -1]
    return found if found[3] >= 0 else -found


def _laser_calibration(path: Path) -> FloatArray:
    """camera<-laser (4, 4): the line Tr of a KITTI calib.txt."""
    for number, words in _rows(path):
        if words[0].rstrip(":") in ("Tr", "Tr_velo_to_cam", "Tr_velo_cam"):
            return _matrix(path, number, words[1:])
    raise LogError(f"{path}: no line Tr, which says where the laser is; poses would be the camera's")
