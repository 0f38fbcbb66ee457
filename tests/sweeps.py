"""Sweeps in processes of their own, and what they leave behind."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

FILES = (
    *("summary.csv", "frames.csv", "labels.csv", "gaps.csv", "hits.csv", "approaches.csv"),
    *("config.yaml", "manifest.json"),
)
GRID = ("-p", "delta_r=1.03,1.05", "-p", "n_o=0,1", "-p", "pl_th=0.05,0.1", "--gaps")
# Long enough to be killed in the middle.
MANY = (
    "-p",
    "delta_r=" + ",".join(f"{1.02 + step / 1000}" for step in range(60)),
    "-p",
    "n_o=0,1,2",
    "-p",
    "pl_th=0.05,0.1",
)


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES if (folder / name).exists()}


def parts_of(folder: Path) -> dict[str, int]:
    """Of each part, when it was written."""
    return {path.name: path.stat().st_mtime_ns for path in (folder / "parts").glob("*.npz.zst")}


def begun(*arguments: object, **options: object) -> "subprocess.Popen[str]":
    """A sweep in a process group of its own."""
    command = [sys.executable, "-m", "gapeval", "sweep", *map(str, arguments)]
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True, **options
    )


def wait_for(condition: Callable[[], bool], process: "subprocess.Popen[str]") -> None:
    while not condition():
        assert process.poll() is None, f"it ended too early: {process.communicate()}"
        time.sleep(0.01)


def workers_of(process: "subprocess.Popen[str]") -> list[int]:
    """The processes that it has spawned to evaluate."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
            command = (path.parent / "cmdline").read_bytes()
        except (OSError, IndexError):
            continue
        if parent == process.pid and b"spawn_main" in command:
            found.append(int(path.parent.name))
    return found


def alive(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
