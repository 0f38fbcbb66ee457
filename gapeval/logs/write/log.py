"""The three kinds of log, each whole or not there."""

import shutil
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys.store import Typestore

from gapeval.errors import LogError
from gapeval.files import UNFINISHED
from gapeval.logs.write.message import TF_STATIC, Message, ros1_types, ros2_types, ros_message

# What ROS 2 calls latched: late listeners get the last message.
LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)
DELAY = 2_000_000  # ns from a message's stamp to its recording


def write_log(path: Path, container: str, messages: Iterable[Message]) -> None:
    """Messages in the order of their stamps. Replaces a log of the same name; raises LogError.

    container: one of CONTAINERS.
    """
    with _whole(path) as unfinished:
        _WRITERS[container](unfinished, messages)


def log_path(folder: Path, name: str, container: str) -> Path:
    """What a log is called."""
    return folder / (name + _SUFFIXES[container])


def _write_mcap(path: Path, messages: Iterable[Message]) -> None:
    store = ros2_types()
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="gapeval")
        channels: dict[str, int] = {}
        for message in messages:
            if message.topic not in channels:
                definition, _ = store.generate_msgdef(message.type, ros_version=2)
                schema = writer.register_schema(message.type, "ros2msg", definition.encode())
                channels[message.topic] = writer.register_channel(message.topic, "cdr", schema)
            raw = bytes(store.serialize_cdr(ros_message(store, message), message.type))
            writer.add_message(channels[message.topic], message.stamp + DELAY, raw, message.stamp)
        writer.finish()  # type: ignore[no-untyped-call]


def _write_ros1(path: Path, messages: Iterable[Message]) -> None:
    store = ros1_types()
    with Ros1Writer(path) as writer:
        _write_bag(writer, store, store.serialize_ros1, {"latching": 1}, messages)


def _write_ros2(path: Path, messages: Iterable[Message]) -> None:
    store = ros2_types()
    with Ros2Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        _write_bag(writer, store, store.serialize_cdr, {"offered_qos_profiles": [LATCHED]}, messages)


def _write_bag(
    writer: Any,
    store: Typestore,
    serialize: Callable[[Any, str], Any],
    latched: dict[str, Any],
    messages: Iterable[Message],
) -> None:
    """latched: how a topic is declared whose last message late listeners are to get."""
    connections: dict[str, Any] = {}
    for message in messages:
        if message.topic not in connections:
            options = latched if message.topic == TF_STATIC else {}
            connections[message.topic] = writer.add_connection(
                message.topic, message.type, typestore=store, **options
            )
        raw = serialize(ros_message(store, message), message.type)
        writer.write(connections[message.topic], message.stamp + DELAY, raw)


_WRITERS: dict[str, Callable[[Path, Iterable[Message]], None]] = {
    "mcap": _write_mcap,
    "ros1": _write_ros1,
    "ros2": _write_ros2,
}
_SUFFIXES = {"mcap": ".mcap", "ros1": ".bag", "ros2": ""}
CONTAINERS = tuple(_WRITERS)


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Another place to write under the same name, from which it is moved when all went well."""
    unfinished = path.with_name(path.name + UNFINISHED)
    try:
        _require_log(path)
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir()
        yield unfinished / path.name
        _remove(path)
        (unfinished / path.name).replace(path)
    except (OSError, sqlite3.Error) as error:
        raise LogError(f"{path}: cannot be written: {getattr(error, 'strerror', error)}") from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _require_log(path: Path) -> None:
    """Raises LogError rather than replace a folder that holds anything but a log."""
    if not path.is_dir():
        return
    if others := [file.name for file in path.iterdir() if file.suffix not in (".db3", ".yaml")]:
        raise LogError(f"{path}: holds {others[0]}, which is no part of a log; choose another folder")


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
