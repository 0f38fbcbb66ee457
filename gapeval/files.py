"""Files that are whole or not there: written under another name, renamed when they are finished."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

from gapeval.errors import GapevalError

UNFINISHED = ".part"


def make_folder(folder: Path) -> None:
    """Raises GapevalError if results cannot be written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{os.getpid()}{UNFINISHED}"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise GapevalError(f"{folder}: cannot write here: {error.strerror}; choose another folder") from error


@contextmanager
def whole_files(folder: Path, names: tuple[str, ...]) -> Iterator[dict[str, IO[str]]]:
    """Open files in a folder; only if all goes well do they appear under their names.

    The last appears last and goes first, so that it stands for the others being there, all of one making.
    """
    unfinished = {name: folder / (name + UNFINISHED) for name in names}
    try:
        with ExitStack() as stack:
            yield {
                name: stack.enter_context(path.open("w", encoding="utf-8", newline=""))
                for name, path in unfinished.items()
            }
        (folder / names[-1]).unlink(missing_ok=True)
        for name, path in unfinished.items():
            path.replace(folder / name)
    except OSError as error:
        ours = {str(path) for path in (*unfinished.values(), *(folder / name for name in names))}
        if error.filename is not None and str(error.filename) not in ours:
            raise  # of something else that happened meanwhile
        raise GapevalError(f"{folder}: cannot write: {error.strerror}") from error
    finally:
        for path in unfinished.values():
            path.unlink(missing_ok=True)


@contextmanager
def whole_file(path: Path) -> Iterator[IO[str]]:
    """One file, whole or not there."""
    with whole_files(path.parent, (path.name,)) as files:
        yield files[path.name]


@contextmanager
def whole_stream(path: Path) -> Iterator[IO[bytes]]:
    """One file of bytes that is written piece by piece, whole or not there. Raises GapevalError."""
    unfinished = path.with_name(path.name + UNFINISHED)
    try:
        with unfinished.open("wb") as file:
            yield file
        unfinished.replace(path)
    except OSError as error:
        if error.filename is not None and str(error.filename) not in (str(unfinished), str(path)):
            raise  # of something else that happened meanwhile
        raise GapevalError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """One file of bytes, whole or not there; a link stays one. Raises GapevalError."""
    path = path.resolve()
    unfinished = path.with_name(path.name + UNFINISHED)
    try:
        if path.exists() and not path.is_file():  # a device or a pipe, which must stay what it is
            path.write_bytes(content)
            return
        unfinished.write_bytes(content)
        unfinished.replace(path)
    except OSError as error:
        raise GapevalError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)
