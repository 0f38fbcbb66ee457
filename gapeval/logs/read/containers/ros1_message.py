"""The headers of messages in ROS 1 bags."""

from gapeval.logs.read.container import Raw
from gapeval.logs.read.containers.ros1_records import Op, RecordError, header_fields, number, time

# A message's header as roscpp and rosbag write it, and as rosbags does; then its fields are at these places.
_FIELDS = {
    (b"\x09\x00\x00\x00conn=", b"\x04\x00\x00\x00op=\x02\x0d\x00\x00\x00time="): (9, 13, 30),
    (b"\x04\x00\x00\x00op=\x02\x09\x00\x00\x00conn=", b"\x0d\x00\x00\x00time="): (17, 21, 30),
}
_USUAL = 38  # bytes of such a header


def message_head(head: Raw) -> tuple[int, int] | None:
    """Connection and bag time by the header of a record in a chunk; None where it is not a message's.

    Raises RecordError.
    """
    if len(head) == _USUAL:
        content = bytes(head)
        for (first, second), (conn, middle, when) in _FIELDS.items():
            if content.startswith(first) and content[middle:when] == second:
                seconds = int.from_bytes(content[when : when + 4], "little")
                nanoseconds = int.from_bytes(content[when + 4 :], "little")
                owner = int.from_bytes(content[conn : conn + 4], "little")
                return owner, seconds * 1_000_000_000 + nanoseconds
    return message_head_of(header_fields(head))


def message_head_of(fields: dict[bytes, bytes]) -> tuple[int, int] | None:
    """The same by the header's fields."""
    op = number(fields, b"op", 1)
    if op == Op.CONNECTION:
        return None
    if op != Op.MESSAGE:
        raise RecordError(f"a record of kind {op} in a chunk")
    return number(fields, b"conn", 4), time(fields, b"time")
