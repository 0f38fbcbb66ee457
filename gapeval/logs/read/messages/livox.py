"""livox_ros_driver/CustomMsg and livox_ros_driver2/CustomMsg, as a view of their bytes."""

from struct import Struct

import numpy as np

from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages.cloud import PackedCloud, PackedField
from gapeval.logs.read.messages.message import UndecodableError, begins_with_header, is_stock
from gapeval.logs.read.messages.ros_bytes import NotSuchBytesError, header_at

POINT = 19  # bytes: uint32 offset_time, float32 x, y, z, uint8 reflectivity, tag, line
CDR_POINT = 20  # in an array; the last one is not padded
FIELDS = (
    PackedField("offset_time", 0, 6),
    PackedField("x", 4, 7),
    PackedField("y", 8, 7),
    PackedField("z", 12, 7),
    PackedField("reflectivity", 16, 2),
    PackedField("tag", 17, 2),
    PackedField("line", 18, 2),
)
SLACK = 3  # bytes that may follow the last field of CDR


def livox_cloud(topic: Topic, raw: Raw) -> PackedCloud:
    """A CustomMsg; the times of its points count from its timebase. Raises UndecodableError."""
    if not (is_stock(topic) and begins_with_header(topic)):
        raise UndecodableError("its definition is not the one of Livox's drivers")
    try:
        stamp, frame, position, form = header_at(raw, topic.serialization)
    except NotSuchBytesError as error:
        raise UndecodableError(str(error)) from error
    # timebase, point_num, lidar_id, three reserved bytes, length of the array
    fixed = Struct(form.order + "QI4xI")
    position = form.aligned(position, 8)
    if position + fixed.size > len(raw):
        raise UndecodableError("it is cut")
    timebase, _, count = fixed.unpack_from(raw, position)
    position += fixed.size
    step = POINT if topic.serialization == "ros1" else CDR_POINT
    needed = count * step - (step - POINT if count else 0)
    left = len(raw) - position
    if not needed <= left <= needed + (0 if topic.serialization == "ros1" else SLACK):
        raise UndecodableError(f"{count} points need {needed} bytes, it has {left}")
    data = np.frombuffer(raw, np.uint8, needed, position)
    if needed < count * step:
        data = np.append(data, np.zeros(step - POINT, np.uint8))
    return PackedCloud(
        stamp=stamp,
        frame=frame,
        height=1,
        width=count,
        fields=FIELDS,
        is_bigendian=form.order == ">",
        point_step=step,
        row_step=count * step,
        data=data,
        time_origin=timebase,
    )
