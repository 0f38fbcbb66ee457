"""PCD files: ascii, binary and binary_compressed."""

from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from gapeval.frame import Transform
from gapeval.logs.read.messages.cloud import FARTHEST, LIES, PackedCloud, PackedField, UnreadableCloudError
from gapeval.logs.read.messages.lzf import lzf_decompressed
from gapeval.logs.read.messages.measurement import Head
from gapeval.logs.read.messages.message import UndecodableError

LONGEST_HEADER = 65_536  # bytes
DATATYPES = {
    ("I", 1): 1,
    ("U", 1): 2,
    ("I", 2): 3,
    ("U", 2): 4,
    ("I", 4): 5,
    ("U", 4): 6,
    ("F", 4): 7,
    ("F", 8): 8,
}
FLOAT64 = 8
HERE = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # VIEWPOINT has w before x, y, z


@dataclass(frozen=True, slots=True)
class PcdHeader:
    """sizes: bytes of a number of each field; counts: numbers in it; data: how the points are written, which
    begin at byte `length`; viewpoint: x, y, z, w, x, y, z.
    """

    names: tuple[str, ...]
    sizes: tuple[int, ...]
    types: tuple[str, ...]
    counts: tuple[int, ...]
    width: int
    height: int
    viewpoint: tuple[float, ...]
    data: str
    length: int

    @property
    def widths(self) -> tuple[int, ...]:
        """Bytes of each field."""
        return tuple(size * count for size, count in zip(self.sizes, self.counts, strict=True))


def pcd_header(raw: memoryview) -> PcdHeader:
    """Raises UndecodableError for what is no header of a PCD file."""
    entries, length = _entries(raw)
    try:
        names = tuple(entries["FIELDS"])
        sizes, types = tuple(map(int, entries["SIZE"])), tuple(entries["TYPE"])
        counts = tuple(map(int, entries.get("COUNT", ["1"] * len(names))))
        (width,) = map(int, entries.get("WIDTH", entries.get("POINTS", [])))
        (height,) = map(int, entries.get("HEIGHT", ["1"]))
        (points,) = map(int, entries.get("POINTS", [str(width * height)]))
        (data,) = entries["DATA"]
        viewpoint = tuple(map(float, entries.get("VIEWPOINT", [str(value) for value in HERE])))
    except (KeyError, ValueError) as error:
        raise UndecodableError(f"its header is no PCD's: {error}") from error
    if not len(names) == len(sizes) == len(types) == len(counts):
        raise UndecodableError("its header has not as many FIELDS, SIZE, TYPE and COUNT")
    if min((*sizes, *counts), default=0) < 1 or width < 0 or height < 0:
        raise UndecodableError("its header has sizes or counts below 1")
    if points != width * height:
        raise UndecodableError(f"its header says {points} points, and {width} x {height}")
    if len(viewpoint) != len(HERE):
        raise UndecodableError(f"its VIEWPOINT has {len(viewpoint)} numbers")
    return PcdHeader(names, sizes, types, counts, width, height, viewpoint, data, length)


def viewpoint_pose(header: PcdHeader) -> Transform | None:
    """What VIEWPOINT does to the points; None where it changes nothing."""
    if header.viewpoint == HERE:
        return None
    x, y, z, qw, qx, qy, qz = header.viewpoint
    try:
        if not all(abs(value) < FARTHEST for value in header.viewpoint):
            raise ValueError("it is too far away")
        return Transform.of((x, y, z), (qx, qy, qz, qw))
    except ValueError as error:
        raise UndecodableError(f"its VIEWPOINT is no pose: {error}") from error


def pcd_cloud(found: Head, raw: memoryview) -> PackedCloud:
    """Raises UndecodableError for what is no PCD file, UnreadableCloudError for one that is cut."""
    header = pcd_header(raw)
    pose, content = viewpoint_pose(header), raw[header.length :]
    if header.data == "ascii":
        fields, step, data = _from_text(header, content)
    else:
        step = sum(header.widths)
        offsets = (0, *accumulate(header.widths))
        fields = tuple(
            PackedField(name, offset, DATATYPES.get((kind, size), 0), count)
            for name, offset, kind, size, count in zip(
                header.names, offsets, header.types, header.sizes, header.counts, strict=False
            )
        )
        data = (
            _compressed(header, content) if header.data == "binary_compressed" else _binary(header, content)
        )
    return PackedCloud(
        stamp=found.stamp,
        frame=found.frame,
        height=header.height,
        width=header.width,
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=header.width * step,
        data=data,
        pose=pose,
    )


def _entries(raw: memoryview) -> tuple[dict[str, list[str]], int]:
    """The lines of the header by their first words, and its length."""
    text = bytes(raw[:LONGEST_HEADER])
    entries: dict[str, list[str]] = {}
    start = 0
    while (end := text.find(b"\n", start)) >= 0:
        words = text[start:end].decode("ascii", "replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            # COLUMNS is what old files call FIELDS.
            name = words[0].upper().replace("COLUMNS", "FIELDS")
            entries[name] = words[1:]
            if name == "DATA":
                return entries, start
    raise UndecodableError("it has no PCD header" if text else "it is empty")


def _binary(header: PcdHeader, content: memoryview) -> NDArray[np.uint8]:
    if header.data != "binary":
        raise UndecodableError(f"its DATA is {header.data[:40]!r}")
    return np.frombuffer(content, np.uint8)


def _compressed(header: PcdHeader, content: memoryview) -> NDArray[np.uint8]:
    """All of the first field, then all of the second ...; put back point by point."""
    points, widths = header.width * header.height, header.widths
    if len(content) < 8:
        raise UnreadableCloudError(LIES, "its data is cut")
    packed, unpacked = (int.from_bytes(content[i : i + 4], "little") for i in (0, 4))
    if packed > len(content) - 8:
        raise UnreadableCloudError(LIES, f"{packed} compressed bytes, it has {len(content) - 8}")
    if unpacked != points * sum(widths):
        raise UnreadableCloudError(LIES, f"{points} points of {sum(widths)} bytes, it has {unpacked}")
    try:
        columns = np.frombuffer(lzf_decompressed(content[8 : 8 + packed], unpacked), np.uint8)
    except ValueError as error:
        raise UnreadableCloudError(LIES, str(error)) from error
    rows = np.empty((points, sum(widths)), np.uint8)
    for first, last in pairwise((0, *accumulate(widths))):
        rows[:, first:last] = columns[points * first : points * last].reshape(points, -1)
    return rows.reshape(-1)


def _from_text(
    header: PcdHeader, content: memoryview
) -> tuple[tuple[PackedField, ...], int, NDArray[np.uint8]]:
    """Every number as float64."""
    points, columns = header.width * header.height, sum(header.counts)
    words = bytes(content).split()
    if len(words) < points * columns:
        raise UnreadableCloudError(LIES, f"{points} points of {columns} numbers, it has {len(words)}")
    try:
        numbers = np.array(words[: points * columns], dtype=np.float64)
    except ValueError as error:
        raise UndecodableError(f"it has what is no number: {error}") from error
    offsets = (0, *accumulate(8 * count for count in header.counts))
    fields = tuple(
        PackedField(name, offset, FLOAT64, count)
        for name, offset, count in zip(header.names, offsets, header.counts, strict=False)
    )
    return fields, 8 * columns, numbers.view(np.uint8)
