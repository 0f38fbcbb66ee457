"""Run a command and say what it took. A program of its own, and a small one: a process begins with the peak
memory of the one that started it, so the bench, which holds many clouds, must not start what it measures.

    python bench_process.py COMMAND ...      prints seconds, CPU seconds and peak memory as JSON
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

UNIT_OF_PEAK = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss [bytes]


@dataclass(frozen=True, slots=True)
class Took:
    """What a command and its processes took: wall clock [s], CPU of all together [s], memory of the largest
    of them at its peak [bytes]."""

    seconds: float
    cpu: float
    peak: int


def took(*command: object, environment: Mapping[str, str] = os.environ) -> Took:
    """Run a command to its end. Raises RuntimeError with what it said last, if it fails."""
    words = [sys.executable, str(Path(__file__).resolve()), *map(str, command)]
    done = subprocess.run(words, capture_output=True, text=True, env=environment)
    if done.returncode != 0:
        said = done.stderr.strip().rpartition("\n")[2]
        raise RuntimeError(f"{' '.join(map(str, command))}: {said}")
    return Took(**json.loads(done.stdout))


def gapeval_took(*arguments: object, environment: Mapping[str, str] = os.environ) -> Took:
    return took(sys.executable, "-m", "gapeval", *arguments, environment=environment)


def main(command: Sequence[str]) -> int:
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begin
    peak = used.ru_maxrss * UNIT_OF_PEAK
    print(json.dumps({"seconds": seconds, "cpu": used.ru_utime + used.ru_stime, "peak": peak}))
    return os.waitstatus_to_exitcode(status)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
