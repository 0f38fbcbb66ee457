"""The bytes of a file by their place, never more than there are."""

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import BinaryIO

from gapeval.errors import LogError

PIECE = 1 << 20  # bytes that are looked at together
GLANCE = 8192  # bytes that are read for a few: as cheap, and small messages stand behind each other


class CutError(Exception):
    """Bytes that lie behind the end of the file."""


@dataclass(frozen=True, slots=True)
class RawFile:
    """An open file of which any thread may read any part. size: [bytes], when it was opened."""

    path: Path
    size: int
    stream: BinaryIO
    lock: Lock

    def read(self, offset: int, length: int) -> bytes:
        """Bytes at an offset. Raises CutError, before any allocation, where there are not as many."""
        if length < 0 or offset < 0 or offset + length > self.size:
            raise CutError(f"byte {offset + length} of {self.size}")
        with self.lock:
            self.stream.seek(offset)
            data = self.stream.read(length)
        if len(data) != length:
            raise CutError(f"byte {offset + length}, though there were {self.size}")
        return data

    def upto(self, offset: int, length: int) -> bytes:
        """Bytes at an offset, fewer where the file ends."""
        return self.read(offset, max(min(length, self.size - offset), 0))

    def pieces(self, start: int, stop: int) -> Iterator[bytes]:
        """The bytes [start, stop), a piece at a time."""
        for offset in range(start, stop, PIECE):
            yield self.read(offset, min(PIECE, stop - offset))


@dataclass(slots=True)
class Window:
    """Bytes of a stretch of a file that is looked at here and there, mostly onwards.

    stop: its end; origin: what places are counted from; start, data: what was read last.
    """

    file: RawFile
    stop: int
    origin: int = 0
    start: int = 0
    data: bytes = b""

    def at(self, offset: int, length: int) -> memoryview:
        """So many bytes at a place, fewer where the stretch ends."""
        offset += self.origin
        length = max(min(length, self.stop - offset), 0)
        if not self.start <= offset <= offset + length <= self.start + len(self.data):
            self.start, self.data = (
                offset,
                self.file.upto(offset, min(max(length, GLANCE), self.stop - offset)),
            )
        return memoryview(self.data)[offset - self.start : offset - self.start + length]


def checksum(file: RawFile, start: int, stop: int) -> int:
    """CRC-32 of the bytes [start, stop)."""
    found = 0
    for piece in file.pieces(start, stop):
        found = zlib.crc32(piece, found)
    return found


@contextmanager
def raw_file(path: Path) -> Iterator[RawFile]:
    """Opens a file. Raises LogError where that cannot be."""
    try:
        # Unbuffered: a buffer would read ahead what a seek then throws away.
        stream = path.open("rb", buffering=0)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from error
    with stream:
        yield RawFile(path, stream.seek(0, os.SEEK_END), stream, Lock())
