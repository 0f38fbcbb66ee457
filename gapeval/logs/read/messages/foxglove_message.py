"""Raw messages of Foxglove's types -> objects with the fields of its schemas, from protobuf, JSON or ROS."""

import base64
import json
from collections.abc import Callable
from functools import lru_cache
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

from gapeval.errors import LogError
from gapeval.logs.read.container import Raw, Topic
from gapeval.logs.read.messages.message import SERIALIZATIONS, UndecodableError, decode

CLOUD, SCAN, POSE = "PointCloud", "LaserScan", "PoseInFrame"
TRANSFORM, TRANSFORMS = "FrameTransform", "FrameTransforms"
TYPES = (CLOUD, SCAN, POSE, TRANSFORM, TRANSFORMS)
PACKAGES = ("foxglove.", "foxglove_msgs/msg/")
PROTOBUF, JSON = "protobuf", "json"


def foxglove_type(topic: Topic) -> str | None:
    """Which of TYPES a topic is of; None if of none, or in an encoding that nobody can read."""
    package = PACKAGES[topic.serialization in SERIALIZATIONS]
    name = topic.type.removeprefix(package)
    readable = topic.serialization in (PROTOBUF, JSON, *SERIALIZATIONS)
    return name if readable and topic.type.startswith(package) and name in TYPES else None


def check_extra(topic: Topic) -> None:
    """Raises LogError where the topic needs a library that is not installed."""
    if topic.serialization == PROTOBUF and find_spec("google.protobuf") is None:
        raise LogError(
            f"{topic.name} is {topic.type} as protobuf, which needs an extra: pip install 'gapeval[foxglove]'"
        )


def decode_foxglove(topic: Topic, raw: Raw) -> Any:
    """Numbers may be missing where they are zero, and messages in it None. Raises UndecodableError."""
    if topic.serialization in SERIALIZATIONS:
        return decode(topic, raw)
    try:
        if topic.serialization == JSON:
            return json.loads(bytes(raw), object_hook=lambda values: SimpleNamespace(**values))
        return _parser(topic.type, topic.schema)(bytes(raw))
    except LogError:
        raise
    except (Exception, RecursionError) as error:
        # ValueError, DecodeError of protobuf, ...
        text = " ".join(str(error).strip("\"'").split())
        raise UndecodableError(text[:200] or type(error).__name__) from error


def data_bytes(data: Any) -> Any:
    """The bytes of a field that holds bytes, which are base64 in JSON. Raises ValueError."""
    return base64.b64decode(data, validate=True) if isinstance(data, str) else data


@lru_cache(maxsize=32)
def _parser(kind: str, schema: bytes) -> Callable[[bytes], Any]:
    """Made from the descriptors that the log itself has, in a pool of their own."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    message = message_factory.GetMessageClass(pool.FindMessageTypeByName(kind))
    return message.FromString
