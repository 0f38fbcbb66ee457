"""What decides results beside parameters: the code, its libraries and the content of the inputs."""

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Callable
from functools import cache
from importlib.metadata import distribution, version
from pathlib import Path
from typing import BinaryIO

import shapely

LIBRARIES = ("numpy", "opencv-python-headless", "shapely", "scipy", "rosbags", "mcap")
MISSING = "missing"
SAMPLE = 1 << 16  # bytes of each end
LARGE, SAMPLES = 4 << 30, 2048  # bytes from which on a file is not read whole to know it again; samples of it
PACKAGE = Path(__file__).parent.parent
DECIDES_NOTHING = ("cli", "report", "studies", "compare", "simulate")  # of a sweep's results
DECIDES_LOGS = ("simulate", "logs", "labels.py", "frame.py")  # that are simulated


def versions() -> dict[str, str]:
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


@cache
def source() -> str:
    """Digest of our own code, as far as it decides results."""
    return _source(lambda room: room not in DECIDES_NOTHING)


@cache
def revision() -> str | None:
    """The commit of our own code: as pip fetched it, or of the checkout, `+changes` if it has any since.

    None where neither is known.
    """
    fetched = json.loads(distribution("gapeval").read_text("direct_url.json") or "{}")
    if "vcs_info" in fetched:
        return str(fetched["vcs_info"]["commit_id"])
    if not (PACKAGE.parent / ".git").exists():
        return None
    commit, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--", PACKAGE.name)
    return commit and commit + ("+changes" if changes else "")


def _git(*arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "--no-optional-locks", *arguments], cwd=PACKAGE.parent, capture_output=True, text=True
        )
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@cache
def code() -> dict[str, str]:
    """All that must be the same for results to be the same bytes, by name. source: digest of our own code."""
    own = {"gapeval": version("gapeval"), "source": source()}
    return own | versions() | {"GEOS": shapely.geos_version_string, "machine": platform.machine()}


@cache
def simulator() -> dict[str, str]:
    """The same for simulated logs."""
    source = _source(lambda room: room in DECIDES_LOGS)
    return {"source": source, "numpy": version("numpy"), "machine": platform.machine()}


def _source(decides: Callable[[str], bool]) -> str:
    """Digest of our own code in some rooms of the package."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE)
        if decides(place.parts[0]):
            digest.update(f"{place.as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def files_of(path: Path) -> list[Path]:
    """The files of a log, which may be a folder."""
    return sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]


def content_sample(path: Path) -> str:
    """Size, and a digest of the beginning and end of its files: cheap, and different for another log."""
    digest, total = hashlib.sha256(), 0
    try:
        for file in files_of(path):
            with file.open("rb") as stream:
                size = file.stat().st_size
                digest.update(stream.read(SAMPLE))
                stream.seek(max(0, size - SAMPLE))
                digest.update(stream.read(SAMPLE))
            total += size
    except FileNotFoundError:
        return MISSING
    return f"{total} bytes ({digest.hexdigest()[:8]})"


def content_digest(path: Path) -> str:
    """SHA-256 over all bytes of a log; of a file that is large, over samples of it, evenly spread."""
    digest = hashlib.sha256()
    for file in files_of(path):
        with file.open("rb") as stream:
            if file.stat().st_size <= LARGE:
                content = hashlib.file_digest(stream, "sha256").hexdigest()
            else:
                content = _sampled_digest(stream, file.stat())
        digest.update(f"{file.relative_to(path).as_posix()}\0{content}\0".encode())
    return digest.hexdigest()


def _sampled_digest(stream: BinaryIO, about: os.stat_result) -> str:
    """With when it was changed last, since what lies between the samples is not looked at."""
    digest = hashlib.sha256(f"{about.st_size} {about.st_mtime_ns}".encode())
    for number in range(SAMPLES):
        stream.seek((about.st_size - SAMPLE) * number // (SAMPLES - 1))
        digest.update(stream.read(SAMPLE))
    return digest.hexdigest()
