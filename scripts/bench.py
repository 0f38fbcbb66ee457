"""Measure what evaluation costs: one configuration, a grid, reading, workers, growth, memory.

All in one run, on simulated logs and, where GAPEVAL_DATA is set, on a real one. `scripts/bench` takes about
eight minutes; `--quick` one. One thread per process, as in a sweep.
"""

import json
import os
import platform
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
from bench_figures import PARTS, Finding, as_json, lines
from bench_logs import CONTAINERS, ONE, Kind, dense_log, real_log, simulated_log
from bench_parts import FULL, PART, QUICK, THREADS, Bench, Effort

from gapeval.sweep.executor import one_thread


def chosen(_: click.Context, __: click.Parameter, text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    if wrong := [name for name in names if name not in PARTS]:
        raise click.BadParameter(f"{wrong[0]}: no such part; there are {', '.join(PARTS)}")
    return [name for name in PARTS if name in names]


@click.command(help=__doc__, epilog="; ".join(f"{name}: {about}" for name, about in PARTS.items()))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), default=Path("bench.json"), show_default=True
)
@click.option("--quick", is_flag=True, help="Few frames and repetitions.")
@click.option(
    "--only", callback=chosen, default=",".join(PARTS), metavar="A,B,...", help="Parts; default: all."
)
def main(output: Path, quick: bool, only: list[str]) -> None:
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        bench = prepared(Path(folder), Kind(), QUICK if quick else FULL)
        head = header(bench)
        click.echo("\n".join(header_lines(head)))
        found = measured(bench, only)
    whole = {"header": head} | as_json(found) | {"seconds": time.perf_counter() - begin}
    output.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    click.echo(f"\n{time.perf_counter() - begin:.0f} s; {output}")


def prepared(folder: Path, kind: Kind, effort: Effort) -> Bench:
    """All logs: as simulated, dense, and the real one if there is one."""
    frames = effort.frames
    simulated = simulated_log(folder / "simulated", kind, frames, list(CONTAINERS), None, frames)
    real = real_log(frames)
    logs = (simulated, dense_log(folder / "dense", kind, simulated, frames), *([real] if real else []))
    return Bench(logs, kind, effort, folder)


def measured(bench: Bench, parts: list[str]) -> list[Finding]:
    """Every part in turn, printed as it is done."""
    one_thread()
    everything: list[Finding] = []
    for part in parts:
        found = list(PART[part](bench))
        click.echo("\n".join(lines(part, found)))
        click.echo(f"  load after it: {load()}")
        everything += found
    return everything


def header(bench: Bench) -> dict[str, Any]:
    """What was measured on what."""
    packages = ("numpy", "opencv-python-headless", "shapely", "gapeval")
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "load": load(),
        "system": platform.platform(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        THREADS: os.environ.get(THREADS),
        "logs": {log.name: log.counts() for log in bench.logs},
        "one": {key: list(values) for key, values in ONE.items()},
        "grid": {key: list(values) for key, values in bench.effort.grid.items()},
        "real": "measured"
        if len(bench.logs) > 2
        else "skipped: GAPEVAL_DATA is not set, or has no os1_street",
    }


def header_lines(head: dict[str, Any]) -> list[str]:
    found = [
        f"{head['cpu']}, {head['cores']} cores, load before {head['load']}, {head['system']}",
        f"python {head['python']}, numpy {head['numpy']}, opencv {head['opencv-python-headless']}, "
        f"shapely {head['shapely']}, gapeval {head['gapeval']}, {THREADS}={head[THREADS]}",
    ]
    for name, log in head["logs"].items():
        found.append(f"{name}: {log['about']}; {log['frames']} frames, r_max {log['r_max']:g} m")
        found.append(
            "  least, median and most of a frame: "
            + ", ".join(f"{what} {'/'.join(map(str, log[what]))}" for what in ("points", "in_box", "dropped"))
        )
    if head["real"] != "measured":
        found.append(f"real: {head['real']}")
    found.append("each figure: median [5 - 95 %] over repetitions and frames, n of them")
    return found


def load() -> str:
    """Programs that want a core, in the last minute; this one is among them."""
    return f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"


def cpu_name() -> str:
    """As Linux has it; elsewhere what Python knows."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.machine()


if __name__ == "__main__":
    main()
