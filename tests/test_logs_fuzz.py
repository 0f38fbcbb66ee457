"""Logs with random damage give messages or one line: no other error, no hang, no memory beyond their size."""

import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from backports import zstd
from command import gapeval
from damage import BARE, bag, db3, mcap, records
from logs_writer import write_records

from gapeval.config import LogSection
from gapeval.errors import LogError
from gapeval.logs.read import describe
from gapeval.logs.read.containers.losses import CUT, INDEX_LIES
from gapeval.logs.read.containers.opening import open_container

LONGEST = 20  # seconds that one small file may take at most; it takes about a hundredth of one
MOST = 300_000  # kB that all of them together may add to what the process holds


def packed(path: Path) -> Path:
    whole = mcap(path.with_suffix(".whole"), "lz4")
    path.write_bytes(zstd.compress(whole.read_bytes()))
    return path


KINDS: dict[str, Callable[[Path], Path]] = {
    "bag": bag,
    "bag-lz4": lambda path: bag(path, "lz4"),
    "bag-bz2": lambda path: bag(path, "bz2"),
    "mcap": mcap,
    "mcap-lz4": lambda path: mcap(path, "lz4"),
    "mcap-zstd": lambda path: mcap(path, "zstd"),
    "mcap-unchunked": lambda path: mcap(path, **{**BARE, "use_chunking": False}),
    "mcap-bare": lambda path: mcap(path, "zstd", **BARE),
    "db3": db3,
    "db3-message": lambda path: write_records(path, records(40), "db3-message"),
    "zstd": packed,
}
CHECKED = ("mcap", "mcap-lz4", "mcap-zstd", "mcap-bare", "zstd")  # whose chunks have a CRC


def damaged(whole: bytes, random: np.random.Generator) -> bytes:
    """The file with a few places flipped, overwritten, cut out, put in or doubled, or without its end."""
    data = bytearray(whole)
    for _ in range(random.integers(1, 5)):
        at = int(random.integers(0, max(len(data), 1)))
        stop = at + int(2 ** random.uniform(0, 10))
        kind = random.integers(0, 7)
        if kind == 0 and data:
            data[min(at, len(data) - 1)] ^= 1 << int(random.integers(0, 8))
        elif kind == 1:
            data[at:stop] = random.bytes(len(data[at:stop]))
        elif kind == 2:
            data[at:stop] = bytes(len(data[at:stop]))
        elif kind == 3:
            del data[at:stop]
        elif kind == 4:
            data[at:at] = random.bytes(stop - at)
        elif kind == 5:
            data[at:at] = data[at:stop]
        elif random.uniform() < 0.3:
            del data[at:]
        else:
            # Numbers that lie: lengths, counts, offsets.
            data[at : at + 8] = (
                bytes([255]) * 8 if random.uniform() < 0.5 else (1 << 33).to_bytes(8, "little")
            )
    return bytes(data)


@contextmanager
def no_hang() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise TimeoutError(f"a file took more than {LONGEST} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def read(path: Path) -> tuple[list[tuple[int, bytes]], set[str]]:
    """Bag times and data of all messages, and why others are lost; heads must say the same."""
    with open_container(path) as container:
        names = {topic.name for topic in container.topics}
        found = [(time, bytes(raw)) for _, time, raw in container.messages(names, None, None)]
        assert container.losses or [time for time, _ in found] == sorted(time for time, _ in found)
        assert all("\n" not in f"{topic.name}{topic.type}{topic.serialization}" for topic in container.topics)
        assert all(loss.reason for loss in container.losses)
        losses = list(container.losses)
        heads = [time for _, time, _ in container.heads(names, (), None, None)]
        # An index that lies shows while messages are read, and is not believed from then on.
        lies = any(loss.reason == INDEX_LIES for loss in losses)
        assert lies or {time for time, _ in found} <= set(heads)
        assert container.losses[: len(losses)] == losses
    return found, {loss.reason for loss in losses}


def read_or_refused(path: Path, call: Callable[[Path], object]) -> object:
    try:
        return call(path)
    except LogError as error:
        text = str(error)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_random_damage(tmp_path, kind):
    whole = KINDS[kind](tmp_path / "whole")
    originals = set(read(whole)[0])
    content, random = whole.read_bytes(), np.random.default_rng(len(kind))
    path = tmp_path / "damaged"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    partial = 0
    for number in range(1000):
        path.write_bytes(damaged(content, random))
        with no_hang():
            result = read_or_refused(path, read)
            if isinstance(result, tuple):
                found, reasons = result
                partial += 0 < len(found) < len(originals)
                # The chunk in which a file ends has no checksum any more.
                assert kind not in CHECKED or CUT in reasons or set(found) <= originals, number
            if number % 5 == 0:
                read_or_refused(path, lambda path: describe(path, LogSection()))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST
    # The damage is neither so small that nothing happens nor so large that nothing is left.
    assert partial > 100


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_random_damage_through_the_command(tmp_path, kind):
    whole = KINDS[kind](tmp_path / "whole").read_bytes()
    random = np.random.default_rng(100 + len(kind))
    path = tmp_path / "damaged"
    for number in range(50):
        path.write_bytes(damaged(whole, random))
        with no_hang():
            result = gapeval("info", path)
        assert result.status in (0, 1)
        assert "Traceback" not in result.err
        if result.status:
            assert result.last_line.startswith("gapeval: ")
        if number == 0:
            done = subprocess.run(
                [sys.executable, "-m", "gapeval", "info", path], capture_output=True, text=True, timeout=60
            )
            assert (done.returncode, done.stdout) == (result.status, result.out)
