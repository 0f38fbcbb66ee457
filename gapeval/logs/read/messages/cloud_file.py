"""Clouds that were files: PCD, PLY, and the bare float32 of KITTI."""

import numpy as np

from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages.cloud import LIES, PackedCloud, PackedField, UnreadableCloudError
from gapeval.logs.read.messages.file_message import PCD, PLY, body
from gapeval.logs.read.messages.measurement import Head
from gapeval.logs.read.messages.pcd import pcd_cloud
from gapeval.logs.read.messages.ply import ply_cloud

KITTI_FIELDS = tuple(PackedField(name, 4 * i, 7) for i, name in enumerate(("x", "y", "z", "intensity")))
KITTI_STEP = 16  # bytes


def packed_cloud(topic: Topic, raw: Raw) -> PackedCloud:
    """Raises UndecodableError for a file of another format, UnreadableCloudError for one that is cut."""
    found, content = body(raw)
    readers = {PCD: pcd_cloud, PLY: ply_cloud}
    return readers.get(topic.serialization, kitti_cloud)(found, content)


def kitti_cloud(found: Head, content: memoryview) -> PackedCloud:
    """Four float32 for every point: x, y, z, intensity."""
    if len(content) % KITTI_STEP:
        raise UnreadableCloudError(LIES, f"{len(content)} bytes are no whole points of {KITTI_STEP}")
    return PackedCloud(
        stamp=found.stamp,
        frame=found.frame,
        height=1,
        width=len(content) // KITTI_STEP,
        fields=KITTI_FIELDS,
        is_bigendian=False,
        point_step=KITTI_STEP,
        row_step=len(content),
        data=np.frombuffer(content, np.uint8),
    )
