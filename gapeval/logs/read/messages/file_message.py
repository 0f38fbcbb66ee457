"""Clouds and poses that are files, as messages: with a stamp and a frame in front."""

from struct import Struct

from gapeval.logs.read.container import Raw
from gapeval.logs.read.messages.measurement import Head, StampedPose
from gapeval.logs.read.messages.message import UndecodableError

PCD, PLY, KITTI, POSES = "pcd", "ply", "kitti", "poses"
CLOUDS = (PCD, PLY, KITTI)
_HEAD = Struct("<qHH")  # stamp [ns], bytes of two names
_VALUES = Struct("<7d")


def with_head(stamp: int, frame: str, body: bytes, child: str = "") -> bytes:
    """A message; frame: that of the cloud, or the parent of a pose."""
    names = frame.encode(), child.encode()
    return b"".join([_HEAD.pack(stamp, *map(len, names)), *names, body])


def pose_message(pose: StampedPose) -> bytes:
    return with_head(pose.stamp, pose.parent, _VALUES.pack(*pose.values), pose.child)


def head(raw: Raw) -> Head:
    return _parts(raw)[0]


def body(raw: Raw) -> tuple[Head, memoryview]:
    """What stands in the file, without a copy."""
    found, _, rest = _parts(raw)
    return found, rest


def pose(raw: Raw) -> StampedPose:
    found, child, rest = _parts(raw)
    if len(rest) != _VALUES.size:
        raise UndecodableError(f"a pose of {len(rest)} bytes")
    return StampedPose(found.stamp, found.frame, child, _VALUES.unpack(rest))


def _parts(raw: Raw) -> tuple[Head, str, memoryview]:
    if len(raw) < _HEAD.size:
        raise UndecodableError("it is cut")
    stamp, first, second = _HEAD.unpack_from(raw)
    begin, end = _HEAD.size + first, _HEAD.size + first + second
    view = memoryview(raw)
    frame, child = bytes(view[_HEAD.size : begin]).decode(), bytes(view[begin:end]).decode()
    return Head(stamp, frame), child, view[end:]
