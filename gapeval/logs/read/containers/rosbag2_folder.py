"""rosbag2 folders: `metadata.yaml` and the files it names, each opened by itself."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import yaml

from gapeval.errors import LogError
from gapeval.logs.read.container import (
    Container,
    Loss,
    Message,
    Source,
    Topic,
    in_time_order,
    library_errors,
    merged_topics,
    printable,
    ros2_type,
)
from gapeval.logs.read.containers import compression, mcap_records, sqlite_file
from gapeval.logs.read.containers.losses import MISSING_PART, UNREADABLE_PART, Losses

METADATA = "metadata.yaml"
KIND = "rosbag2"
MAGICS = (sqlite_file.MAGIC, mcap_records.MAGIC, compression.MAGIC)

OpenFile = Callable[[Path], AbstractContextManager[Container]]
Read = Callable[[Container], Iterator[Message]]


@dataclass(frozen=True, slots=True)
class Part:
    """One file; start, end: bag times [ns], None where they are not known without unpacking it."""

    path: Path
    start: int | None = None
    end: int | None = None


@dataclass(slots=True)
class _Folder:
    """What a folder says it holds. topics: None where nothing but its files says that."""

    path: Path
    open_file: OpenFile
    parts: list[Part]
    topics: list[Topic] | None = None
    storage: str = ""
    notices: list[str] = field(default_factory=list)
    losses: Losses = field(default_factory=Losses)


@contextmanager
def open_rosbag2_folder(path: Path, open_file: OpenFile) -> Iterator[Container]:
    """A rosbag2 folder; without a usable metadata.yaml, the files in it. Raises LogError where none is read.

    Parts that are compressed as a whole are unpacked one at a time, and only when their time has come.
    """
    folder = _folder(path, open_file)
    if folder.topics is None or not any(_is_compressed(part.path) for part in folder.parts):
        _look_into(folder)
    parts = folder.parts
    yield Container(
        kind=f"{KIND} {folder.storage}".rstrip(),
        topics=merged_topics(folder.topics or ()),
        start=min((part.start for part in parts if part.start is not None), default=None),
        end=max((part.end for part in parts if part.end is not None), default=None),
        messages=lambda names, start, stop: _in_order(
            folder, start, stop, lambda container: container.messages(names, start, stop)
        ),
        heads=lambda names, whole, start, stop: _in_order(
            folder, start, stop, lambda container: container.heads(names, whole, start, stop)
        ),
        notices=tuple(folder.notices),
        losses=folder.losses.found,
    )


def _folder(path: Path, open_file: OpenFile) -> _Folder:
    files = _log_files(path)
    notice = f"there is no {METADATA}, so the folder's files were looked into"
    if (path / METADATA).is_file():
        try:
            information = _information(path / METADATA)
            parts = _parts(path, information)
            topics = [_topic(item) for item in information["topics_with_message_count"]]
            folder = _Folder(
                path, open_file, parts, topics, printable(str(information["storage_identifier"]))
            )
            return _without_missing(folder, files)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, yaml.YAMLError):
            notice = f"{METADATA} is damaged, so the folder's files were looked into"
    elif not files:
        advice = "give a rosbag2 folder, or a log's file"
        raise LogError(f"{path}: a folder without {METADATA} and without any log; {advice}")
    if not files:
        raise LogError(f"{path}: there is no log beside {METADATA}; give a rosbag2 folder, or a log's file")
    return _Folder(path, open_file, [Part(file) for file in files], notices=[notice])


def _log_files(path: Path) -> list[Path]:
    """The storages of rosbag2 in a folder, by name; of one and its compressed copy the former."""
    with library_errors(path, "folder", "copy it anew"):
        files = [
            file for file in sorted(path.iterdir()) if file.is_file() and _magic(file).startswith(MAGICS)
        ]
    names = {file.name for file in files}
    return [
        file for file in files if not file.name.endswith(".zstd") or file.name[: -len(".zstd")] not in names
    ]


def _without_missing(folder: _Folder, files: list[Path]) -> _Folder:
    """The parts that are there; where one is missing, files that are not named may be it."""
    missing = [part.path for part in folder.parts if not part.path.is_file()]
    if not missing:
        return folder
    named = {part.path.name for part in folder.parts}
    other = [Part(file) for file in files if file.name not in named]
    if not other:
        for file in missing:
            folder.losses.add(Loss(file.name, MISSING_PART))
    parts = [part for part in folder.parts if part.path not in missing] + other
    if not parts:
        raise LogError(
            f"{folder.path}: {missing[0].name} is missing, though {METADATA} names it; copy it anew"
        )
    notices = [f"{METADATA} does not name {part.path.name}, which was read instead" for part in other]
    return replace(folder, parts=parts, topics=None, notices=notices)


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
    if not names or not all(names):
        raise ValueError("no file is named")
    return [Part(folder / name, *spans.get(name, (None, None))) for name in dict.fromkeys(names)]


def _topic(item: dict[str, Any]) -> Topic:
    metadata = item["topic_metadata"]
    count, form = int(item["message_count"]), str(metadata["serialization_format"])
    kind = ros2_type(printable(str(metadata["type"])))
    return Topic(printable(str(metadata["name"])), kind, count, printable(form))


def _is_compressed(path: Path) -> bool:
    return _magic(path).startswith(compression.MAGIC)


def _magic(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(16)


def _look_into(folder: _Folder) -> None:
    """Parts and topics as the files themselves have them, which metadata.yaml may not say or say wrongly."""
    found: list[Topic] = []
    spans: list[Part] = []
    kinds: list[str] = []
    errors: list[LogError] = []
    for part in folder.parts:
        try:
            with folder.open_file(part.path) as container:
                found += container.topics
                spans.append(replace(part, start=container.start, end=container.end))
                kinds.append(container.kind)
                folder.notices += [f"{part.path.name}: {notice}" for notice in container.notices]
                for loss in container.losses:
                    folder.losses.add(loss)
        except LogError as error:
            errors.append(error)
            _lose(folder, part)
    if not spans:
        raise errors[0]
    counts = {topic.name: topic.count for topic in merged_topics(found)}
    # Where something was lost, that is the reason, and told.
    for topic in () if folder.losses.found else folder.topics or ():
        if counts.get(topic.name, 0) != topic.count:
            files = counts.get(topic.name, 0)
            if files < topic.count:
                lacking = f"fewer messages on {topic.name} than {METADATA} says"
                folder.losses.add(Loss(folder.path.name, lacking, messages=topic.count - files))
                continue
            folder.notices.append(
                f"{topic.name}: {METADATA} says {topic.count} messages, its files hold {files}"
            )
    folder.parts, folder.topics = spans, found
    folder.storage = folder.storage or kinds[0].removeprefix(KIND).strip().lower()


def _lose(folder: _Folder, part: Part) -> None:
    size = part.path.stat().st_size
    folder.losses.add(Loss(part.path.name, UNREADABLE_PART, size, None, part.start, part.end))


def _in_order(folder: _Folder, start: int | None, stop: int | None, read: Read) -> Iterator[Message]:
    sources = []
    for part in folder.parts:
        if start is not None and part.end is not None and part.end < start:
            continue
        if stop is not None and part.start is not None and part.start >= stop:
            continue
        messages = partial(_part_messages, folder, part, read)
        sources.append(Source(0 if part.start is None else part.start, messages))
    return in_time_order(sources)


def _part_messages(folder: _Folder, part: Part, read: Read) -> Iterator[Message]:
    try:
        with folder.open_file(part.path) as container:
            try:
                yield from read(container)
            finally:
                for loss in container.losses:
                    folder.losses.add(loss)
    except LogError:
        _lose(folder, part)
