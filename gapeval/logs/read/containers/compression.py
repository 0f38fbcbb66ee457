"""Compressed chunks, and zstd as rosbag2 uses it: around whole files, or around single messages.

What is compressed is never believed: nothing larger than it can be is allocated.
"""

import bz2
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

from gapeval.logs.read.container import Raw, library_errors

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = b"\x28\xb5\x2f\xfd"


_PIECE = 1 << 20  # bytes that are read or written together
MOST_GROWTH = 1000  # times its size that a file may become, on top of what a single chunk may be
LARGEST = 1 << 30  # bytes of a chunk or message; recorders close chunks at a few MB
# How many times its size anything can become: in lz4 a byte stands for at most 255; a block of zstd has at
# most 128 KiB and at least 4 bytes. bz2 has no limit below a million.
GROWTH = {"lz4": 256, "zstd": 1 << 15, "bz2": 1 << 20}


class BombError(Exception):
    """More bytes are promised than can be in there, or than any log has in one piece."""


class DamagedError(Exception):
    """What does not decompress, or not to as many bytes as it says."""


def decompressed_chunk(data: Raw, compression: str, size: int) -> Raw:
    """A chunk of `size` bytes. Raises BombError before any allocation, or DamagedError.

    compression: a key of GROWTH, or `none` or nothing.
    """
    if compression in ("", "none"):
        if len(data) != size:
            raise DamagedError
        return data
    if size > LARGEST or size > GROWTH[compression] * len(data) + 64:
        raise BombError
    decompressor = _DECOMPRESSORS[compression]()
    try:
        # One byte more shows whether there is more than what was said, and is all that is made of it.
        content: bytes = decompressor.decompress(data, max_length=size + 1)
    except Exception as error:
        # RuntimeError, OSError, EOFError, ZstdError ...: each codec has its own.
        raise DamagedError from error
    if len(content) != size:
        raise DamagedError
    return content


_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "lz4": LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
    "bz2": bz2.BZ2Decompressor,
}


def decompressed(data: Raw) -> Raw:
    """A message as it was before rosbag2 compressed it; CDR never begins with zstd's magic.

    Raises BombError or DamagedError.
    """
    if data[:4] != MAGIC:
        return data
    try:
        declared = zstd.get_frame_info(data).decompressed_size
    except Exception as error:
        raise DamagedError from error
    limit = min(GROWTH["zstd"] * len(data), LARGEST)
    if declared is not None and declared > limit:
        raise BombError
    decompressor = zstd.ZstdDecompressor()
    try:
        content = decompressor.decompress(data, max_length=limit if declared is None else declared)
    except Exception as error:
        raise DamagedError from error
    if not decompressor.eof:
        raise DamagedError
    return content


@contextmanager
def decompressed_file(path: Path) -> Iterator[tuple[Path, int | None]]:
    """A copy of a zstd file without its compression, in a temporary folder that is gone afterwards.

    And how many bytes of the file were left when it stopped making sense, None where it is whole. Raises
    LogError where nothing can be decompressed.
    """
    with TemporaryDirectory(prefix="gapeval-") as folder:
        # Named like the original, since error lines name it.
        copy = Path(folder, path.name.removesuffix(".zstd"))
        with library_errors(path, "zstd file", "record it again"):
            left = _decompress(path, copy)
        yield copy, left


def _decompress(path: Path, copy: Path) -> int | None:
    """None where the file is whole, else the bytes behind the place where it stops making sense."""
    size = path.stat().st_size
    limit, written = MOST_GROWTH * size + LARGEST, 0
    with path.open("rb") as raw, zstd.open(raw, "rb") as source, copy.open("wb") as target:
        while written <= limit:
            try:
                # Not read(), which would throw away what it has when it runs into the damage.
                content = source.read1(_PIECE)
            except (EOFError, zstd.ZstdError) as error:
                if not written:
                    raise ValueError("nothing of it can be decompressed") from error
                break
            if not content:
                return None
            written += target.write(content)
        return size - raw.tell()
