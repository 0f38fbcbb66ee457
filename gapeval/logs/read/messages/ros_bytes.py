"""Headers and transforms of ROS straight from their bytes, faster than by decoding all fields.

Only for topics whose definitions have these fields as ROS itself has them, and in its order.
"""

from functools import lru_cache
from struct import Struct
from typing import NamedTuple

from gapeval.logs.read.container import Raw
from gapeval.logs.read.messages.measurement import Head, StampedTransform

SMALLEST = 72  # bytes of a TransformStamped whose names are empty, at least


class NotSuchBytesError(Exception):
    """Bytes that are not what they are said to be."""


class Form(NamedTuple):
    """How a serialization writes its fields.

    order: of bytes, as struct has it. stamp: seconds, nanoseconds, length of the name of the frame.
    prefix: bytes before the first field, from which alignment counts; is_aligned: whether it is at all;
    terminator: bytes at the end of a string; slack: bytes that may follow the last field.
    """

    order: str
    stamp: Struct
    length: Struct
    values: Struct
    prefix: int
    is_aligned: bool
    terminator: int
    slack: int

    def aligned(self, position: int, to: int) -> int:
        return position + (self.prefix - position) % to if self.is_aligned else position


_ROS1 = Form("<", Struct("<4xiII"), Struct("<I"), Struct("<7d"), 0, False, 0, 0)
_LITTLE = Form("<", Struct("<iII"), Struct("<I"), Struct("<7d"), 4, True, 1, 3)
_BIG = Form(">", Struct(">iII"), Struct(">I"), Struct(">7d"), 4, True, 1, 3)


def header_at(raw: Raw, serialization: str) -> tuple[int, str, int, Form]:
    """(stamp [ns], frame, position after it, how to read on) of the std_msgs/Header that a message begins
    with; what follows it may be cut off. Raises NotSuchBytesError.
    """
    form = _form(raw, serialization)
    return *_header(raw, form.prefix, form), form


def read_head(raw: Raw, serialization: str) -> Head:
    """The header alone. Raises NotSuchBytesError."""
    form = _form(raw, serialization)
    stamp, frame, _ = _header(raw, form.prefix, form)
    return Head(stamp, frame)


def read_transforms(raw: Raw, serialization: str) -> list[StampedTransform]:
    """All of a tf2_msgs/TFMessage. Raises NotSuchBytesError."""
    form = _form(raw, serialization)
    size, position = len(raw), form.prefix + 4
    if size < position:
        raise NotSuchBytesError("it is cut")
    (count,) = form.length.unpack_from(raw, form.prefix)
    if count * SMALLEST > size:
        raise NotSuchBytesError(f"{count} transforms in {size} bytes")
    found = []
    for _ in range(count):
        stamp, parent, position = _header(raw, form.aligned(position, 4), form)
        position = form.aligned(position, 4)
        if position + 4 > size:
            raise NotSuchBytesError("it is cut")
        (length,) = form.length.unpack_from(raw, position)
        child, position = _name(raw, position + 4, length, form)
        position = form.aligned(position, 8)
        if position + 56 > size:
            raise NotSuchBytesError("it is cut")
        found.append(StampedTransform(stamp, parent, child, form.values.unpack_from(raw, position)))
        position += 56
    if size - position > form.slack:
        raise NotSuchBytesError(f"{size - position} bytes too long")
    return found


def _form(raw: Raw, serialization: str) -> Form:
    if serialization == "ros1":
        return _ROS1
    kind = bytes(raw[:2])
    if kind == b"\0\1":
        return _LITTLE
    if kind == b"\0\0" and len(raw) >= 4:
        return _BIG
    raise NotSuchBytesError("it does not begin like CDR" if len(raw) >= 4 else "it is cut")


def _header(raw: Raw, position: int, form: Form) -> tuple[int, str, int]:
    """(stamp, frame, position after it) of the header at a position."""
    after = position + form.stamp.size
    if after > len(raw):
        raise NotSuchBytesError("it is cut in its header")
    seconds, nanoseconds, length = form.stamp.unpack_from(raw, position)
    frame, after = _name(raw, after, length, form)
    return seconds * 1_000_000_000 + nanoseconds, frame, after


def _name(raw: Raw, position: int, length: int, form: Form) -> tuple[str, int]:
    end = position + length
    if end > len(raw) or length < form.terminator:
        raise NotSuchBytesError(f"a name of {length} bytes does not fit")
    name = bytes(raw[position : end - form.terminator])
    if form.terminator and raw[end - 1] != 0:
        raise NotSuchBytesError("a name does not end")
    return _text(name), end


@lru_cache(maxsize=256)
def _text(name: bytes) -> str:
    """A frame's name without the leading slash of old ROS 1 logs."""
    try:
        return name.decode().lstrip("/")
    except UnicodeDecodeError as error:
        raise NotSuchBytesError(f"a name is not text: {name[:40]!r}") from error
