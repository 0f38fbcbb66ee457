"""rosbag2 folders: `metadata.yaml` and the files it names, each opened by itself."""

from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import yaml

from gapeval.errors import LogError
from gapeval.logs.read import compression
from gapeval.logs.read.container import (
    Container,
    Message,
    Source,
    Topic,
    in_time_order,
    library_errors,
    merged_topics,
    ros2_type,
    whole_heads,
)

METADATA = "metadata.yaml"
KIND = "rosbag2"

OpenFile = Callable[[Path], AbstractContextManager[Container]]


@dataclass(frozen=True, slots=True)
class Part:
    """One file; start, end: bag times [ns], None where they are not known without unpacking it."""

    path: Path
    start: int | None
    end: int | None


@contextmanager
def open_rosbag2_folder(path: Path, open_file: OpenFile) -> Iterator[Container]:
    """A rosbag2 folder. Raises LogError where metadata.yaml is missing or wrong, or a file of it is missing.

    Parts that are compressed as a whole are unpacked one at a time, and only when their time has come.
    """
    advice = f"`ros2 bag reindex {path.name}` writes {METADATA} anew, or give one of the folder's files"
    if not (path / METADATA).is_file():
        raise LogError(f"{path}: a folder without {METADATA} is no rosbag2 log; {advice}")
    with library_errors(path / METADATA, "file", advice):
        information = _information(path / METADATA)
        parts = _parts(path, information)
        topics = [_topic(item) for item in information["topics_with_message_count"]]
        storage = str(information["storage_identifier"])
    for part in parts:
        if not part.path.is_file():
            raise LogError(f"{path}: {part.path.name} is missing, though {METADATA} names it; {advice}")
    notices: tuple[str, ...] = ()
    if not any(_is_compressed(part.path) for part in parts):
        parts, topics, notices = _looked_into(parts, topics, open_file)
    yield Container(
        kind=f"{KIND} {storage}",
        topics=merged_topics(topics),
        start=min((part.start for part in parts if part.start is not None), default=None),
        end=max((part.end for part in parts if part.end is not None), default=None),
        messages=partial(_messages, parts, open_file),
        heads=whole_heads(partial(_messages, parts, open_file)),
        notices=notices,
    )


def _information(path: Path) -> dict[str, Any]:
    information = yaml.safe_load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
    if not isinstance(information, dict):
        raise ValueError("no rosbag2_bagfile_information")
    mode = str(information.get("compression_mode") or "").lower()
    form = information.get("compression_format") or ""
    if mode not in ("", "none") and form != "zstd":
        raise LogError(f"{path}: compressed with {form!r}; gapeval reads zstd: use `ros2 bag convert`")
    return information


def _parts(folder: Path, information: dict[str, Any]) -> list[Part]:
    spans = {}
    for item in information.get("files") or []:
        start = int(item["starting_time"]["nanoseconds_since_epoch"])
        if item["message_count"]:
            spans[PurePath(item["path"]).name] = (start, start + int(item["duration"]["nanoseconds"]))
    # Old versions write the folder's name in front of the file's, new ones do not.
    names = [PurePath(name).name for name in information["relative_file_paths"]]
    return [Part(folder / name, *spans.get(name, (None, None))) for name in names]


def _topic(item: dict[str, Any]) -> Topic:
    metadata = item["topic_metadata"]
    count, form = int(item["message_count"]), str(metadata["serialization_format"])
    return Topic(str(metadata["name"]), ros2_type(str(metadata["type"])), count, form)


def _is_compressed(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == compression.MAGIC


def _looked_into(
    parts: list[Part], topics: list[Topic], open_file: OpenFile
) -> tuple[list[Part], list[Topic], tuple[str, ...]]:
    """Parts and topics as the files themselves have them, which metadata.yaml may not say or say wrongly."""
    found: list[Topic] = []
    spans: list[Part] = []
    notices: list[str] = []
    for part in parts:
        with open_file(part.path) as container:
            found += container.topics
            spans.append(replace(part, start=container.start, end=container.end))
            notices += [f"{part.path.name}: {notice}" for notice in container.notices]
    counts = {topic.name: topic.count for topic in merged_topics(found)}
    for topic in topics:
        if counts.get(topic.name, 0) != topic.count:
            files = counts.get(topic.name, 0)
            notices.append(f"{topic.name}: {METADATA} says {topic.count} messages, its files hold {files}")
    return spans, found, tuple(notices)


def _messages(
    parts: list[Part], open_file: OpenFile, names: Collection[str], start: int | None, stop: int | None
) -> Iterator[Message]:
    sources = []
    for part in parts:
        if start is not None and part.end is not None and part.end < start:
            continue
        if stop is not None and part.start is not None and part.start >= stop:
            continue
        read = partial(_part_messages, part.path, open_file, names, start, stop)
        sources.append(Source(0 if part.start is None else part.start, read))
    return in_time_order(sources)


def _part_messages(
    path: Path, open_file: OpenFile, names: Collection[str], start: int | None, stop: int | None
) -> Iterator[Message]:
    with open_file(path) as container:
        yield from container.messages(names, start, stop)
