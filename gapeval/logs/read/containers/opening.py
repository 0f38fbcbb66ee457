"""Any log by its path. Files are known by their first bytes, never by their suffix."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from gapeval.errors import LogError
from gapeval.logs.read.container import Container, Loss, library_errors
from gapeval.logs.read.containers import compression, mcap_index, ros1_index, ros1_records, sqlite_file
from gapeval.logs.read.containers.cloud_folder import is_cloud_folder, open_cloud_folder
from gapeval.logs.read.containers.losses import CUT_COMPRESSED
from gapeval.logs.read.containers.mcap_file import open_mcap_file
from gapeval.logs.read.containers.mcap_records import MAGIC as MCAP
from gapeval.logs.read.containers.raw_file import raw_file
from gapeval.logs.read.containers.ros1_bag import open_ros1_bag
from gapeval.logs.read.containers.rosbag2_folder import METADATA, open_rosbag2_folder
from gapeval.logs.read.containers.sqlite_file import open_sqlite_file

MAGIC_LENGTH = 16
KITTI = "velodyne"  # where the clouds of a KITTI sequence are
KNOWN = "a ROS 1 bag, a rosbag2 folder, a .db3, an MCAP file or a folder of clouds"


def open_container(path: Path) -> AbstractContextManager[Container]:
    """An open log. Raises LogError, in one line, for what is missing, no log, or damaged."""
    if path.is_dir():
        if not (path / METADATA).exists():
            for folder in (path, path / KITTI):
                if folder.is_dir() and is_cloud_folder(folder):
                    return open_cloud_folder(folder)
        return open_rosbag2_folder(path, open_file)
    return open_file(path)


def open_file(path: Path) -> AbstractContextManager[Container]:
    """One file of a log, by itself."""
    magic = _magic(path)
    if magic.startswith(ros1_records.MAGIC):
        return open_ros1_bag(path)
    if magic.startswith(sqlite_file.MAGIC):
        return open_sqlite_file(path)
    if magic.startswith(MCAP):
        return open_mcap_file(path)
    if magic.startswith(compression.MAGIC):
        return _open_compressed(path)
    what = f"starts with {magic[:8]!r}" if magic else "is empty"
    raise LogError(f"{path}: no log: it {what}; give {KNOWN}")


def is_costly_to_open(path: Path) -> bool:
    """Whether a file must be read to its end before anything is found: compressed, or without index."""
    files = [file for file in path.iterdir() if file.is_file()] if path.is_dir() else [path]
    return any(map(_is_costly, files))


def _is_costly(path: Path) -> bool:
    magic = _magic(path)
    if magic.startswith(MCAP):
        with raw_file(path) as file:
            return not mcap_index.is_indexed(file)
    if magic.startswith(ros1_records.MAGIC):
        with raw_file(path) as file:
            return not ros1_index.is_indexed(file)
    return magic.startswith(compression.MAGIC)


@contextmanager
def _open_compressed(path: Path) -> Iterator[Container]:
    with compression.decompressed_file(path) as (copy, left):
        if _magic(copy).startswith(compression.MAGIC):
            raise LogError(f"{path}: compressed more than once; unpack it with `zstd -d`")
        try:
            with open_file(copy) as container:
                # A copy that is cut says so itself.
                if left is not None and not container.losses:
                    container.losses.append(Loss(path.name, CUT_COMPRESSED, left))
                yield container
        except LogError as error:
            # The copy is gone when the line is read.
            raise LogError(str(error).replace(str(copy), str(path))) from error


def _magic(path: Path) -> bytes:
    if not path.exists():
        raise LogError(f"{path}: no such file or folder; give {KNOWN}")
    with library_errors(path, "file", "record it again"), path.open("rb") as file:
        return file.read(MAGIC_LENGTH)
