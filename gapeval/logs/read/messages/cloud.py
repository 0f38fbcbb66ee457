"""Points packed into bytes in any legal layout, as sensor_msgs/PointCloud2 has them -> points."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gapeval.frame import FloatArray, Transform

# sensor_msgs/PointField: datatype -> (name, numpy's code)
DATATYPES = {
    1: ("int8", "i1"),
    2: ("uint8", "u1"),
    3: ("int16", "i2"),
    4: ("uint16", "u2"),
    5: ("int32", "i4"),
    6: ("uint32", "u4"),
    7: ("float32", "f4"),
    8: ("float64", "f8"),
}
FARTHEST = 1e12  # m; what claims to be farther away is no measurement, and may overflow float32
BLOCK = 8192  # points that are transformed at a time, so that their float64 copies stay in the cache

EMPTY = "empty cloud"
NO_POINT = "no finite point"
LIES = "header lies about its size"
NO_FIELDS = "no usable x, y, z fields"
NO_TIME = "no time for each point"


class UnreadableCloudError(Exception):
    """A cloud that holds no points, or whose header contradicts its data.

    reason: one of the constants above; detail: what is wrong with this cloud.
    """

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


@dataclass(frozen=True, slots=True)
class PackedField:
    """A field of each point, as sensor_msgs/PointField; datatype: one of DATATYPES, else unknown."""

    name: str
    offset: int
    datatype: int
    count: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class PackedCloud:
    """A cloud as it stands in its message, with the fields of sensor_msgs/PointCloud2; nothing is checked.

    stamp: [ns]; frame: of the message; data: bytes. pose: frame<-points, None where they are in the frame.
    time_origin: absolute time [ns] that the times of points count from, None where that is not said.
    """

    stamp: int
    frame: str
    height: int
    width: int
    fields: tuple[PackedField, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: NDArray[Any]
    pose: Transform | None = None
    time_origin: int | None = None


@dataclass(frozen=True, slots=True)
class Coordinate:
    """Where one number is in a point: byte offset, and numpy's type with its byte order."""

    offset: int
    dtype: np.dtype[Any]


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the points are in a message's data, checked against its length."""

    height: int
    width: int
    point_step: int
    row_step: int
    coordinates: tuple[Coordinate, Coordinate, Coordinate]


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """The points of one cloud, in its own frame.

    xyz: (N, 3) float32 or float64 [m], finite; float64 where the message has more than float32 can hold.
    not_finite, zero: points left out for NaN or infinity, and for being exactly (0, 0, 0).
    """

    xyz: NDArray[Any]
    not_finite: int
    zero: int


def cloud_layout(message: Any) -> Layout:
    """The layout of a decoded PointCloud2, in Python's integers, before anything is allocated.

    Raises UnreadableCloudError for a header that contradicts itself or the data.
    """
    height, width = int(message.height), int(message.width)
    step, row, size = int(message.point_step), int(message.row_step), len(message.data)
    if height * width == 0:
        raise UnreadableCloudError(EMPTY)
    if step <= 0:
        raise UnreadableCloudError(LIES, f"point_step is {step}")
    if height == 1 or row == 0:
        row = width * step
    if row < width * step:
        raise UnreadableCloudError(LIES, f"row_step {row} < {width} points of {step} bytes")
    needed = (height - 1) * row + width * step
    if needed > size:
        raise UnreadableCloudError(LIES, f"{height} x {width} points need {needed} bytes, it has {size}")
    return Layout(height, width, step, row, _coordinates(message, step))


def cloud_points(message: Any) -> Points:
    """The finite points of a PackedCloud or decoded PointCloud2, row by row. is_dense is not believed.

    Raises UnreadableCloudError with a reason where there are none.
    """
    return kept_points(message)[0]


def kept_points(message: Any) -> tuple[Points, NDArray[np.bool_]]:
    """The finite points, and which of all points they are: (height * width,)."""
    layout = cloud_layout(message)
    data = cloud_bytes(message)
    points, kept = _finite(_adjacent_floats(data, layout) if _is_plain(layout) else _any_fields(data, layout))
    if not len(points.xyz):
        dropped = f"{points.not_finite} NaN or infinite, {points.zero} at exactly (0, 0, 0)"
        raise UnreadableCloudError(NO_POINT, dropped)
    return points, kept


def column(message: Any, found: Any) -> NDArray[Any]:
    """The values (height * width,) of one field, the first of each point where it has several."""
    layout = cloud_layout(message)
    place = _coordinate(found, ">" if message.is_bigendian else "<", layout.point_step)
    return _strided(cloud_bytes(message), layout, place.dtype, place.offset).reshape(-1)


def cloud_bytes(message: Any) -> NDArray[Any]:
    data = np.asarray(message.data)
    if data.dtype.itemsize != 1:
        raise UnreadableCloudError(LIES, f"data is of {data.dtype}, not of bytes")
    return data


def transformed(transform: Transform, xyz: NDArray[Any]) -> NDArray[np.float32]:
    """Points (N, 3) of any float type in the target frame, worked out in float64, float32 at the end."""
    matrix = np.hstack([transform.matrix, transform.translation[:, None]])
    out = np.empty(xyz.shape, dtype=np.float32)
    for start in range(0, len(xyz), BLOCK):
        block: FloatArray = xyz[start : start + BLOCK].astype(np.float64)
        out[start : start + BLOCK] = cv2.transform(block[:, None, :], matrix)[:, 0, :]
    return out


def _coordinates(message: Any, step: int) -> tuple[Coordinate, Coordinate, Coordinate]:
    fields: dict[str, Any] = {}
    for found in message.fields:
        fields.setdefault(str(found.name), found)
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise UnreadableCloudError(NO_FIELDS, f"it has {', '.join(fields) or 'none'}")
    order = ">" if message.is_bigendian else "<"
    x, y, z = (_coordinate(fields[name], order, step) for name in "xyz")
    return x, y, z


def _coordinate(found: Any, order: str, step: int) -> Coordinate:
    datatype, offset = int(found.datatype), int(found.offset)
    if datatype not in DATATYPES:
        raise UnreadableCloudError(NO_FIELDS, f"{found.name} is of the unknown datatype {datatype}")
    dtype = np.dtype(order + DATATYPES[datatype][1])
    if offset < 0 or offset + dtype.itemsize > step:
        raise UnreadableCloudError(LIES, f"field {found.name} ends at {offset + dtype.itemsize} of {step}")
    return Coordinate(offset, dtype)


def _is_plain(layout: Layout) -> bool:
    """Whether x, y, z are adjacent little-endian float32, as in nearly every log."""
    first = layout.coordinates[0].offset
    return all(
        c.dtype == np.dtype("<f4") and c.offset == first + 4 * i for i, c in enumerate(layout.coordinates)
    )


def _adjacent_floats(data: NDArray[Any], layout: Layout) -> NDArray[np.float32]:
    # One copy of 12-byte items is three times faster than three copies of columns.
    strided = _strided(data, layout, np.dtype("V12"), layout.coordinates[0].offset)
    return np.ascontiguousarray(strided).view("<f4").reshape(-1, 3)


def _any_fields(data: NDArray[Any], layout: Layout) -> NDArray[Any]:
    is_single = all(c.dtype.kind == "f" and c.dtype.itemsize == 4 for c in layout.coordinates)
    out = np.empty((layout.height * layout.width, 3), dtype=np.float32 if is_single else np.float64)
    # A NaN that signals is NaN like any other.
    with np.errstate(invalid="ignore"):
        for column, coordinate in enumerate(layout.coordinates):
            out[:, column] = _strided(data, layout, coordinate.dtype, coordinate.offset).reshape(-1)
    return out


def _strided(data: NDArray[Any], layout: Layout, dtype: np.dtype[Any], offset: int) -> NDArray[Any]:
    shape, strides = (layout.height, layout.width), (layout.row_step, layout.point_step)
    if layout.row_step == layout.width * layout.point_step:
        shape, strides = (1, layout.height * layout.width), (layout.row_step, layout.point_step)
    return np.ndarray(shape, dtype, data.data, offset, strides)


def _finite(xyz: NDArray[Any]) -> tuple[Points, NDArray[np.bool_]]:
    """Drops what is no measurement. One sum per point finds all candidates, faster than looking at each."""
    with np.errstate(all="ignore"):
        sums = xyz @ np.ones(3, dtype=xyz.dtype)
        keep = np.isfinite(sums)
    candidates = np.flatnonzero(sums == 0)
    zero = candidates[~xyz[candidates].any(axis=1)]
    keep[zero] = False
    kept = xyz if keep.all() else xyz.compress(keep, axis=0)
    if len(kept) and cv2.norm(kept, cv2.NORM_INF) > FARTHEST:
        near = (np.abs(kept) <= FARTHEST).all(axis=1)
        kept, keep[keep] = kept[near], near
    return Points(kept, len(xyz) - len(kept) - len(zero), len(zero)), keep
