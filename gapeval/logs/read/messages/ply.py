"""PLY files: the x, y, z and whatever else there is of each vertex; ascii and both binary orders."""

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from gapeval.logs.read.messages.cloud import LIES, PackedCloud, PackedField, UnreadableCloudError
from gapeval.logs.read.messages.measurement import Head
from gapeval.logs.read.messages.message import UndecodableError

LONGEST_HEADER = 65_536  # bytes
# name of a type -> (its number in sensor_msgs/PointField, bytes)
TYPES = {
    name: (number, size)
    for number, size, *names in (
        (1, 1, "char", "int8"),
        (2, 1, "uchar", "uint8"),
        (3, 2, "short", "int16"),
        (4, 2, "ushort", "uint16"),
        (5, 4, "int", "int32"),
        (6, 4, "uint", "uint32"),
        (7, 4, "float", "float32"),
        (8, 8, "double", "float64"),
    )
    for name in names
}
FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
FLOAT64 = 8


@dataclass(slots=True)
class Element:
    """count: how many there are; properties: (type, name), where a type `list` has no fixed size."""

    name: str
    count: int
    properties: list[tuple[str, str]]

    @property
    def size(self) -> int:
        """Bytes of each. Raises UndecodableError for one of no fixed size."""
        if any(kind not in TYPES for kind, _ in self.properties):
            raise UndecodableError(f"its {self.name} has a list, or a type that PLY does not know")
        return sum(TYPES[kind][1] for kind, _ in self.properties)


def ply_cloud(found: Head, raw: memoryview) -> PackedCloud:
    """Raises UndecodableError for what is no PLY file, UnreadableCloudError for one that is cut."""
    form, elements, length = _header(raw)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise UndecodableError("it has no vertex")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    kinds, step, content = [kind for kind, _ in vertex.properties], vertex.size, raw[length:]
    if form == "ascii":
        data = _from_text(content, sum(element.count for element in before), vertex)
        kinds, step = ["double"] * len(kinds), 8 * len(kinds)
    else:
        skipped = sum(element.size * element.count for element in before)
        data = np.frombuffer(content, np.uint8)[skipped:]
    offsets = (0, *accumulate(TYPES[kind][1] for kind in kinds))
    return PackedCloud(
        stamp=found.stamp,
        frame=found.frame,
        height=1,
        width=vertex.count,
        fields=tuple(
            PackedField(name, offset, TYPES[kind][0])
            for (_, name), kind, offset in zip(vertex.properties, kinds, offsets, strict=False)
        ),
        is_bigendian=form == "binary_big_endian",
        point_step=step,
        row_step=vertex.count * step,
        data=data,
    )


def _header(raw: memoryview) -> tuple[str, list[Element], int]:
    """(format, elements, length of the header)."""
    text = bytes(raw[:LONGEST_HEADER])
    if not text.startswith(b"ply"):
        raise UndecodableError("it does not begin with ply" if text else "it is empty")
    form, elements, start = "", list[Element](), 0
    while (end := text.find(b"\n", start)) >= 0:
        words = text[start:end].decode("ascii", "replace").split()
        start = end + 1
        try:
            if words[:1] == ["format"]:
                form = words[1]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2]), []))
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[1], words[-1]))
        except (IndexError, ValueError) as error:
            raise UndecodableError(f"its header is no PLY's: {' '.join(words)[:60]!r}") from error
        if words == ["end_header"]:
            break
    else:
        raise UndecodableError("its header does not end")
    if form not in FORMATS or any(element.count < 0 for element in elements):
        raise UndecodableError(f"its header is no PLY's: format {form[:40]!r}, or a count below 0")
    return form, elements, start


def _from_text(content: memoryview, skipped: int, vertex: Element) -> NDArray[np.uint8]:
    """Every number as float64; one line for each element."""
    columns = len(vertex.properties)
    lines = bytes(content).split(b"\n")[skipped : skipped + vertex.count]
    words = b" ".join(lines).split()
    if len(words) != vertex.count * columns:
        raise UnreadableCloudError(LIES, f"{vertex.count} points of {columns} numbers, it has {len(words)}")
    try:
        return np.array(words, dtype=np.float64).view(np.uint8)
    except ValueError as error:
        raise UndecodableError(f"it has what is no number: {error}") from error
