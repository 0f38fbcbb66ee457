"""The folder of a sweep's parts: what is there already, made from what, and that one sweep writes there."""

import hashlib
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from filelock import FileLock, Timeout

from gapeval.config import Config
from gapeval.errors import GapevalError
from gapeval.files import UNFINISHED, make_folder, write_whole
from gapeval.results.manifest import SCORER
from gapeval.results.part import Part, UnreadablePartError, unpacked
from gapeval.sweep.provenance import code
from gapeval.sweep.units import Span, Task, Unit

PARTS, LOCK, SWEEP, BEGUN = "parts", "lock", "sweep.json", "unfinished"
NAME = re.compile(r"([0-9a-f]{16})-(\d+)-(\d+)-[0-9a-f]{8}\.npz\.zst")


@contextmanager
def locked(folder: Path) -> Iterator[Path]:
    """The folder of the parts of the results in this folder, for one sweep alone. Raises GapevalError."""
    make_folder(folder)
    parts = folder / PARTS
    make_folder(parts)
    try:
        with FileLock(
            parts / LOCK, timeout=0
        ):  # of the system: it goes when its process goes, however it ends
            yield parts
    except Timeout as error:
        raise GapevalError(
            f"{folder}: another sweep writes here; wait for it, or choose another -o"
        ) from error


# --- the sweep ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Input:
    """A log or label file. sha256: of its content when a sweep began; empty where none did."""

    path: Path
    sha256: str = ""


@dataclass(frozen=True, slots=True)
class Order:
    """What a sweep was asked to do, so that it can be asked again."""

    logs: tuple[Input, ...]
    labels: tuple[Input, ...]
    config: Config
    gaps: bool


def write_order(parts: Path, order: Order) -> None:
    """And that it is not done yet."""
    (parts / BEGUN).touch()
    document = {
        "logs": [{"path": str(log.path), "sha256": log.sha256} for log in order.logs],
        "labels": [{"path": str(labels.path), "sha256": labels.sha256} for labels in order.labels],
        "config": order.config.to_yaml(),
        "gaps": order.gaps,
    }
    write_whole(parts / SWEEP, json.dumps(document, indent=2).encode())


def note_finished(parts: Path) -> None:
    """The result files are those of the sweep that was begun last."""
    (parts / BEGUN).unlink(missing_ok=True)


def is_unfinished(folder: Path) -> bool:
    """Whether a sweep into it was not finished, so that its files are missing, or those of another."""
    return (folder / PARTS / BEGUN).exists()


def read_order(folder: Path) -> Order:
    """Raises GapevalError where no sweep was begun."""
    path = folder / PARTS / SWEEP
    try:
        document = json.loads(path.read_bytes())
        logs, labels = (
            tuple(Input(Path(item["path"]), str(item["sha256"])) for item in document[key])
            for key in ("logs", "labels")
        )
        config = Config.model_validate(yaml.safe_load(document["config"]))
        if not isinstance(document["gaps"], bool):
            raise ValueError("gaps")
        return Order(logs, labels, config, document["gaps"])
    except FileNotFoundError as error:
        raise GapevalError(f"{folder}: no sweep was begun here: {path} is missing; name its logs") from error
    except (OSError, ValueError, KeyError, AttributeError, TypeError, yaml.YAMLError) as error:
        raise GapevalError(f"{path}: cannot be used; name the logs again, without --resume") from error


# --- whose a part is ---------------------------------------------------------------------------------


def keys(task: Task, config: Config, log_digests: Sequence[str]) -> tuple[str, ...]:
    """Of each log: what decides its parts but the configurations, which are known by their ids."""
    reading: dict[str, Any] = json.loads(config.log.model_dump_json(exclude={"lowest_elevation", "strict"}))
    found = []
    for recording, name, labels, digest in zip(
        task.recordings, task.names, task.labels, log_digests, strict=True
    ):
        decides = {
            "log": digest,
            "name": name,
            "reading": reading,
            "picked": [
                recording.cloud_topic,
                recording.pose_source,
                recording.robot_frame,
                recording.fixed_frame,
                recording.sensor_frame,
                recording.lowest_elevations,
                recording.pose_error and recording.pose_error.model_dump(),
                recording.pose_noise and recording.pose_noise.model_dump(),
            ],
            "stamps": hashlib.sha256(recording.scans.stamps.tobytes()).hexdigest(),
            "labels": None if labels is None else labels.sha256,
            "scoring": json.loads(config.scoring.model_dump_json(exclude={"block"})),
            "domain": [task.question.domain.model_dump(), task.question.origin, task.question.plane],
            "scorer": SCORER,
            "code": code(),
        }
        found.append(hashlib.sha256(json.dumps(decides, sort_keys=True).encode()).hexdigest()[:16])
    return tuple(found)


# --- what is there -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class There:
    """Of each span, the parts that serve it; and the units that are not there."""

    paths: dict[Span, list[Path]]
    missing: tuple[Unit, ...]


def look(parts: Path, task: Task, keys: Sequence[str], spans: Iterable[Span]) -> There:
    """Read all parts that may serve, one at a time. One that cannot be read is not there."""
    candidates: dict[tuple[str, int, int], list[Path]] = defaultdict(list)
    for path in sorted(parts.iterdir()):
        if named := NAME.fullmatch(path.name):
            candidates[named[1], int(named[2]), int(named[3])].append(path)
    wanted = [configuration.id for configuration in task.question.configurations]
    paths: dict[Span, list[Path]] = {}
    missing = []
    for span in spans:
        lacking = dict.fromkeys(wanted)
        paths[span] = []
        for path in candidates[keys[span.recording], span.first, span.last]:
            try:
                part = read_part(path)
            except UnreadablePartError:
                continue
            if (part.key, part.first, part.last) != (keys[span.recording], span.first, span.last):
                continue  # another, under the name of this one
            if lacking.keys() & set(part.ids) and (part.gaps or not task.question.keep_gaps):
                paths[span].append(path)
                for name in part.ids:
                    lacking.pop(name, None)
        if lacking:
            missing.append(Unit(span, tuple(i for i, name in enumerate(wanted) if name in lacking)))
    return There(paths, tuple(missing))


def read_part(path: Path) -> Part:
    """Raises UnreadablePartError."""
    try:
        return unpacked(path.read_bytes())
    except OSError as error:
        raise UnreadablePartError(f"{path}: {error.strerror}") from error


def write_part(parts: Path, task: Task, key: str, unit: Unit, content: bytes) -> Path:
    """Raises GapevalError where it cannot be written."""
    ids = ",".join(task.question.configurations[index].id for index in unit.configurations)
    which = hashlib.sha256(f"{task.question.keep_gaps} {ids}".encode()).hexdigest()[:8]
    path = parts / f"{key}-{unit.span.first}-{unit.span.last}-{which}.npz.zst"
    write_whole(path, content)
    return path


def remove_others(parts: Path, keys: Sequence[str]) -> None:
    """Parts whose inputs are gone, and what a killed sweep was writing."""
    for path in parts.iterdir():
        named = NAME.fullmatch(path.name.removesuffix(UNFINISHED))
        if named and (named[1] not in keys or path.name.endswith(UNFINISHED)):
            path.unlink(missing_ok=True)
