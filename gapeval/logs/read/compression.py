"""zstd as rosbag2 uses it: around whole files, or around single messages."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from gapeval.logs.read.container import Raw, library_errors

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = b"\x28\xb5\x2f\xfd"


def decompressed(data: Raw) -> Raw:
    """A message as it was before rosbag2 compressed it; CDR never begins with zstd's magic."""
    return zstd.decompress(data) if data[:4] == MAGIC else data


@contextmanager
def decompressed_file(path: Path) -> Iterator[Path]:
    """A copy of a zstd file without its compression, in a temporary folder that is gone afterwards."""
    with TemporaryDirectory(prefix="gapeval-") as folder:
        # Named like the original, since error lines name it.
        copy = Path(folder, path.name.removesuffix(".zstd"))
        with (
            library_errors(path, "zstd file", "record it again, or unpack it with `zstd -d`"),
            zstd.open(path, "rb") as source,
            copy.open("wb") as target,
        ):
            shutil.copyfileobj(source, target, 1 << 20)
        yield copy
