"""PointCloud2 read one point at a time."""

import struct
from typing import Any


def cloud_points(message: Any) -> tuple[list[tuple[float, ...]], int] | None:
    """The points of a decoded PointCloud2 one by one, and how many were left out; None for one that lies.

    message: with the fields of sensor_msgs/PointCloud2.
    """
    codes = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
    data, step = bytes(message.data), message.point_step
    row = message.row_step if message.height > 1 and message.row_step else message.width * step
    count = message.height * message.width
    if step < 1 or row < message.width * step or not 0 < count <= len(data):
        return None
    readers = []
    for name in "xyz":
        found = [f for f in message.fields if f.name == name][:1]
        if not found or found[0].datatype not in codes:
            return None
        reader = struct.Struct((">" if message.is_bigendian else "<") + codes[found[0].datatype])
        if found[0].offset + reader.size > step:
            return None
        readers.append((found[0].offset, reader))
    kept, left_out = [], 0
    for i in range(message.height):
        for j in range(message.width):
            start = i * row + j * step
            if start + step > len(data):
                return None
            point = tuple(float(reader.unpack_from(data, start + at)[0]) for at, reader in readers)
            if any(point) and all(abs(value) <= 1e12 for value in point):
                kept.append(point)
            else:
                left_out += 1
    return kept, left_out
