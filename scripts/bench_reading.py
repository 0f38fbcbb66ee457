"""Raw messages of a healthy log by gapeval and by rosbags alone, in each kind of file.

The files are written by the real libraries, from the clouds and transforms of the simulated log.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from backports import zstd
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gapeval.logs.read.container import Message
from gapeval.logs.read.containers.opening import open_container

CODECS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
TF = "tf2_msgs/msg/TFMessage"


def raw_messages(path: Path, often: int) -> Iterator[Message]:
    """The messages of a log, again and again, later each time."""
    with open_container(path) as container:
        names = {topic.name for topic in container.topics}
        every = [(topic, when, bytes(raw)) for topic, when, raw in container.messages(names, None, None)]
    length = every[-1][1] - every[0][1] + 100_000_000
    for again in range(often):
        yield from ((topic, when + again * length, raw) for topic, when, raw in every)


def written(folder: Path, ros1: Path, ros2: Path, often: int) -> dict[str, Path]:
    """The same messages in every kind of file. ros1, ros2: logs to take them from; often: how many times."""
    folder.mkdir()
    files = {}
    for codec in ("none", "lz4", "bz2"):
        files[f"bag, {codec}"] = path = folder / f"{codec}.bag"
        writer = Ros1Writer(path)
        if codec != "none":
            writer.set_compression(Ros1Writer.CompressionFormat[codec.upper()])
        _write(writer, Stores.ROS1_NOETIC, raw_messages(ros1, often))
    for mode in (None, CompressionMode.MESSAGE):
        name = "db3" if mode is None else "db3, zstd"
        made = folder / name.replace(", ", "-")
        writer2 = Ros2Writer(made, version=9, storage_plugin=StoragePlugin.SQLITE3)
        if mode is not None:
            writer2.set_compression(mode, CompressionFormat.ZSTD)
        _write(writer2, Stores.ROS2_HUMBLE, raw_messages(ros2, often))
        files[name] = next(made.glob("*.db3"))
    for codec, compression in CODECS.items():
        files[f"mcap, {codec}"] = path = folder / f"{codec}.mcap"
        _write_mcap(path, compression, raw_messages(ros2, often))
    return files


def _write(writer: Any, stores: Stores, messages: Iterator[Message]) -> None:
    store = get_typestore(stores)
    if TF not in store.fielddefs:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    connections: dict[str, Any] = {}
    with writer:
        for topic, when, raw in messages:
            if topic.name not in connections:
                connections[topic.name] = writer.add_connection(topic.name, topic.type, typestore=store)
            writer.write(connections[topic.name], when, raw)


def _write_mcap(path: Path, compression: CompressionType, messages: Iterator[Message]) -> None:
    writer = McapWriter(str(path), compression=compression)
    writer.start(profile="ros2", library="")
    channels: dict[str, int] = {}
    for topic, when, raw in messages:
        if topic.name not in channels:
            schema = writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            channels[topic.name] = writer.register_channel(topic.name, "cdr", schema)
        writer.add_message(channels[topic.name], when, bytes(raw), when)
    writer.finish()


def by_gapeval(path: Path, topic: str) -> int:
    """Bytes of all messages of a topic."""
    with open_container(path) as container:
        return sum(len(raw) for _, _, raw in container.messages([topic], None, None))


def by_rosbags(path: Path, topic: str, kind: str) -> int:
    """The same by rosbags alone, which leaves it to others to decompress messages one by one."""
    reader: Any
    if kind.startswith("bag"):
        reader = Ros1Reader(path)
    else:
        reader = Sqlite3Reader(path) if kind.startswith("db3") else McapReader(path)
    reader.open()
    try:
        connections = [one for one in reader.connections if one.topic == topic]
        found = (raw for _, _, raw in reader.messages(connections))
        return sum(len(zstd.decompress(raw)) if kind == "db3, zstd" else len(raw) for raw in found)
    finally:
        reader.close()


def took(call: Callable[[], object]) -> float:
    """Wall clock [ms]: threads are to pay."""
    begun = time.perf_counter()
    call()
    return (time.perf_counter() - begun) * 1e3


def compared(
    files: dict[str, Path], topic: str, rounds: int
) -> Iterator[tuple[str, list[float], list[float]]]:
    """(kind, ms of gapeval, ms of rosbags), both in turn."""
    for kind, path in files.items():
        if by_gapeval(path, topic) != by_rosbags(path, topic, kind):
            raise AssertionError(f"{path}: not the same messages")
        ours, theirs = [], []
        for _ in range(rounds):
            ours.append(took(lambda path=path: by_gapeval(path, topic)))
            theirs.append(took(lambda path=path, kind=kind: by_rosbags(path, topic, kind)))
        yield kind, ours, theirs
