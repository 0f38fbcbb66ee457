"""The parts of the bench, from logs to figures. A time is in ms unless its unit says otherwise."""

import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench_compare import drawn, write_results
from bench_figures import Figure, Finding, Skipped, figure
from bench_logs import CONTAINERS, GRID, ONE, Grid, Kind, Log, cut, simulated_log, stacked
from bench_process import Took, gapeval_took
from bench_reading import compared, written
from numpy.typing import NDArray

import gapeval
from gapeval.config import Configuration, load_config
from gapeval.detection import Detection, detect_each
from gapeval.detection.surface import CellTable, Reach, cell_table, polar_points, reach_of, within_box
from gapeval.frame import FloatArray, Frame
from gapeval.logs.read import Recording, read_frames, read_recording
from gapeval.results.part import make_part
from gapeval.scoring.metrics import SUMS
from gapeval.share import Share
from gapeval.sweep.evaluation import Question, evaluate
from gapeval.sweep.units import Task, Unit, split
from gapeval.traversability import assess_each

TWICE: Grid = {**GRID, "pl_th": (0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4)}  # 480 configurations
THOUSAND: Grid = {
    "k": (4, 5, 6, 7),
    "delta_r": GRID["delta_r"],
    "n_o": range(5),
    "pl_th": (0.05, 0.075, 0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4),
}
LINEAR = 0.99  # R2 from which on cost is called linear
THREADS = "OMP_NUM_THREADS"
FLAT = 1.1  # cost per configuration in the largest grid against one of half the size

OF_READING = (("<=", 40.0), ("<=", 10.0))

Image = NDArray[Any]
Times = Mapping[str, Sequence[float]]


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is measured. frames: of each log; repetitions: of each frame; rounds: of whole processes.

    clouds: of the log that whole processes sweep, and of the short one whose time is taken off.
    points: N_P in (g); sizes: of grids there.
    """

    frames: int
    repetitions: int
    rounds: int
    clouds: tuple[int, int]
    workers: tuple[int, ...]
    points: tuple[int, ...]
    sizes: tuple[int, ...]
    grid: Grid
    large: Grid  # for memory
    compared: tuple[int, int]  # frames and configurations in (j)


FULL = Effort(
    frames=8,
    repetitions=2,
    rounds=3,
    clouds=(80, 16),
    workers=(1, 2, 4),
    points=(10_000, 30_000, 100_000, 300_000, 1_000_000),
    sizes=(1, 10, 30, 60, 120, 240, 480),
    grid=GRID,
    large=THOUSAND,
    compared=(1000, 1000),
)
QUICK = Effort(
    frames=2,
    repetitions=1,
    rounds=1,
    clouds=(12, 4),
    workers=(1, 2, 4),
    points=(10_000, 30_000, 100_000),
    sizes=(1, 10, 60, 120, 240),
    grid=GRID,
    large=GRID,
    compared=(100, 1000),
)


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """What is measured on, and how much. folder: for whatever a part writes."""

    logs: tuple[Log, ...]
    kind: Kind
    effort: Effort
    folder: Path

    @property
    def simulated(self) -> Log:
        return self.logs[0]

    def samples(self, log: Log, often: int = 1) -> Iterator[Frame]:
        """Its frames, all of them again and again; `often` for what takes little time."""
        for _ in range(often * self.effort.repetitions):
            yield from log.frames[: self.effort.frames]


@dataclass(frozen=True, slots=True)
class Clock:
    """What a call took [ms]: wall clock, and CPU, which is less where other programs use the cores."""

    wall: float
    cpu: float


def clocked(call: Callable[[], object]) -> Clock:
    wall, cpu = time.perf_counter(), time.process_time()
    call()
    return Clock((time.perf_counter() - wall) * 1e3, (time.process_time() - cpu) * 1e3)


# (a) One configuration


def one_configuration(bench: Bench) -> Iterator[Finding]:
    for log in bench.logs:
        (asked,) = log.grid(ONE)
        times: dict[str, list[float]] = defaultdict(list)
        stages: dict[str, list[float]] = defaultdict(list)
        detect_and_assess(log.frames[0], asked, Share())
        for frame in bench.samples(log, often=5):
            share = Share()
            both = clocked(partial(detect_and_assess, frame, asked, share))
            times["wall"].append(both.wall)
            times["cpu"].append(both.cpu)
            add_stages(stages, share.spent, both.wall)
        yield figure("a", log.name, "detect + assess", "ms", times["wall"], ("<=", 2.5))
        yield figure("a", log.name, "detect + assess, CPU", "ms", times["cpu"])
        yield from stage_figures("a", log, stages, "ms", 1.0)


def detect_and_assess(frame: Frame, asked: Configuration, share: Share) -> None:
    (found,) = detect_each(frame, [asked], share)
    assess_each([(found, asked.robot, asked.crossing)], share)


def add_stages(stages: dict[str, list[float]], spent: Mapping[str, Sequence[float]], whole: float) -> None:
    """One more sample [ms] of each step, and of what is in none."""
    for name, seconds in spent.items():
        stages[name].append(sum(seconds) * 1e3)
    stages[REST].append(whole - sum(map(sum, spent.values())) * 1e3)


REST = "in no step"


def stage_figures(part: str, log: Log, stages: Times, unit: str, scale: float) -> Iterator[Figure]:
    """Steps in the order in which they are done, with their share of the whole."""
    whole = sum(map(sum, stages.values()))
    for name, samples in stages.items():
        note = f"{sum(samples) / whole:.1%} of the whole"
        scaled = [sample * scale for sample in samples]
        yield figure(part, log.name, name if name == REST else f"step {name}", unit, scaled, note=note)


# (b) and (c) A grid


def whole_grid(bench: Bench) -> Iterator[Finding]:
    for log in bench.logs:
        asked = log.grid(bench.effort.grid)
        whole = log.question(asked)
        groups = {
            f"{key} {value} alone": log.question([c for c in asked if getattr(c.detector, key) == value])
            for key in ("n_o", "k")
            for value in bench.effort.grid[key]
        }
        times: dict[str, list[float]] = defaultdict(list)
        stages: dict[str, list[float]] = defaultdict(list)
        gaps = gaps_each(log, whole)
        for frame in bench.samples(log):
            singly = clocked(partial(assess_singly, frame, asked))
            together, spent = evaluated(log, frame, whole)
            add_both(times, together, singly, len(asked))
            add_stages(stages, spent, together.wall)
            for name, group in groups.items():
                times[name].append(evaluated(log, frame, group)[0].wall / len(group.configurations))
        head = partial(figure, "b", log.name)
        note = f"evaluate, {len(asked)} configurations, {np.mean(list(gaps.values())):.1f} gaps each"
        yield head("together", "ms/config", times["together"], ("<=", 0.25), ("<=", 0.1), note=note)
        yield head("together, CPU", "ms/config", times["together, CPU"])
        yield head("one by one", "ms/config", times["singly"], note="detect and assess, no scoring")
        yield head("one by one / together", "", times["ratio"], (">=", 6), note="with scoring in the divisor")
        yield head("one by one / together, CPU", "", times["ratio, CPU"])
        for name, group in groups.items():
            found = np.mean([gaps[one] for one in group.configurations])
            note = f"{len(group.configurations)} configurations, {found:.1f} gaps each"
            yield head(name, "ms/config", times[name], note=note)
        yield from stage_figures("b", log, stages, "us/config", 1e3 / len(asked))


def evaluated(log: Log, frame: Frame, question: Question) -> tuple[Clock, dict[str, list[float]]]:
    """What it took, and the seconds of each step."""
    spent: dict[str, list[float]] = {}

    def call() -> None:
        spent.update(evaluate(frame, question, log.labels, log.recording.robot_frame)[1])

    return clocked(call), spent


def gaps_each(log: Log, question: Question) -> dict[Configuration, float]:
    """How many gaps each configuration finds in a frame, in the mean."""
    column = list(SUMS).index("gaps")
    found = [
        evaluate(frame, question, log.labels, log.recording.robot_frame)[0].sums[:, column]
        for frame in log.frames
    ]
    return dict(zip(question.configurations, np.mean(found, axis=0).tolist(), strict=True))


def add_both(times: dict[str, list[float]], together: Clock, singly: Clock, asked: int) -> None:
    """One more sample of a grid evaluated together and one by one, per configuration."""
    times["together"].append(together.wall / asked)
    times["together, CPU"].append(together.cpu / asked)
    times["singly"].append(singly.wall / asked)
    times["ratio"].append(singly.wall / together.wall)
    times["ratio, CPU"].append(singly.cpu / together.cpu)


def assess_singly(frame: Frame, asked: Sequence[Configuration]) -> None:
    for one in asked:
        gapeval.assess(gapeval.detect(frame, one), one.robot, one.crossing)


def detection_alone(bench: Bench) -> Iterator[Finding]:
    for log in bench.logs:
        asked = log.grid(bench.effort.grid)
        times: dict[str, list[float]] = defaultdict(list)
        stages: dict[str, list[float]] = defaultdict(list)
        detect_each(log.frames[0], asked, Share())
        for frame in bench.samples(log):
            singly = clocked(partial(detect_singly, frame, asked))
            share = Share()
            together = clocked(partial(detect_each, frame, asked, share))
            add_both(times, together, singly, len(asked))
            add_stages(stages, share.spent, together.wall)
        yield figure("c", log.name, "together", "ms/config", times["together"], note="detect_each")
        yield figure("c", log.name, "together, CPU", "ms/config", times["together, CPU"])
        yield figure("c", log.name, "one by one", "ms/config", times["singly"], note="detect")
        yield figure("c", log.name, "one by one / together", "", times["ratio"])
        yield figure("c", log.name, "one by one / together, CPU", "", times["ratio, CPU"])
        yield from stage_figures("c", log, stages, "us/config", 1e3 / len(asked))


def detect_singly(frame: Frame, asked: Sequence[Configuration]) -> None:
    for one in asked:
        gapeval.detect(frame, one)


# (d) The floor


def floor(bench: Bench) -> Iterator[Finding]:
    for log in bench.logs:
        asked = log.grid(bench.effort.grid)
        times: list[Clock] = []
        for frame in bench.samples(log, often=2):
            share = Share()
            found = detect_each(frame, asked, share)
            margin = max(2 * one.detector.n_o for one in asked)
            reach = reach_of({of.surface.grid for of in found}, margin)
            tables = [
                share(bare_table, table_of(frame, one, of, margin, reach, share))
                for one, of in zip(asked, found, strict=True)
            ]
            seen = [of.surface.seen.cells.astype(np.uint8) for of in found]
            images: list[Image] = []
            images_of = (bare_image(*of, margin) for of in zip(tables, seen, asked, strict=True))
            times.append(clocked(partial(images.extend, images_of)))
            for of, image in zip(found, images, strict=True):
                if not np.array_equal(of.surface.gap.cells, image != 0):
                    raise AssertionError("the floor finds other cells than the detector")
        wall, cpu = ([getattr(of, name) / len(asked) for of in times] for name in ("wall", "cpu"))
        yield figure("d", log.name, "together", "ms/config", wall, note="nothing shared but cell tables")
        yield figure("d", log.name, "together, CPU", "ms/config", cpu)


def table_of(
    frame: Frame, asked: Configuration, found: Detection, margin: int, reach: Reach, share: Share
) -> CellTable:
    """The cell table behind a detection, from the same share."""
    params, grid = asked.detector, found.surface.grid
    box = params.z_min, params.z_max, asked.robot.body
    return share(cell_table, share(polar_points, frame, grid.origin, found.plane, *box, reach), grid, margin)


def bare_table(table: CellTable) -> tuple[Image, Image]:
    """A table as OpenCV takes it: |t| of each cell, and the largest t of it and of those before it, which
    turns the shade behind an obstacle into a threshold."""
    return np.ascontiguousarray(table.least), np.maximum.accumulate(table.highest, axis=0)


def bare_image(table: tuple[Image, Image], seen: Image, asked: Configuration, margin: int) -> Image:
    """Thresholds, opening and contours of one configuration."""
    params, (least, highest) = asked.detector, table
    empty = cv2.compare(least, params.pl_th, cv2.CMP_GT)
    gap = cv2.bitwise_and(empty, cv2.compare(highest, params.pl_th, cv2.CMP_LE))
    if params.n_o > 0:
        element = cv2.getStructuringElement(cv2.MORPH_RECT, (3, 3))
        gap = cv2.morphologyEx(gap, cv2.MORPH_OPEN, element, iterations=params.n_o)
    image = np.ascontiguousarray(within_box(gap, margin)) & seen
    cv2.findContours(image, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return image


# (e) Reading


def reading(bench: Bench) -> Iterator[Finding]:
    with one_core() as pinned:
        for log in bench.logs[:1] + bench.logs[2:]:  # a dense log has one container
            yield from containers(bench, log, pinned)
        yield from whole_sweep_and_reading(bench, pinned)


def containers(bench: Bench, log: Log, pinned: str) -> Iterator[Finding]:
    asked = log.question(log.grid(bench.effort.grid))
    for container, path in log.files.items():
        recording = read_recording(path, load_config(log.config).log)
        clouds = len(recording.scans)
        task = Task((recording,), (path.name,), (log.labels,), asked, keys=("bench",))
        times: dict[str, list[float]] = defaultdict(list)
        for _ in range(2 * bench.effort.repetitions):
            alone, swept = read_and_sweep(task)
            times["read"].append(alone.wall / clouds)
            times["read, CPU"].append(alone.cpu / clouds)
            times["ratio"].append(swept.wall / alone.wall)
            times["ratio, CPU"].append(swept.cpu / alone.cpu)
        name = CONTAINERS[container]
        yield figure("e", log.name, f"{name}: read and decode", "ms/cloud", times["read"])
        note = f"{len(asked.configurations)} configurations, rows included / read_frames of it, {pinned}"
        yield figure("e", log.name, f"{name}: sweep / reading", "", times["ratio"], *OF_READING, note=note)
        yield figure("e", log.name, f"{name}: read and decode, CPU", "ms/cloud", times["read, CPU"])
        yield figure("e", log.name, f"{name}: sweep / reading, CPU", "", times["ratio, CPU"])


def read_and_sweep(task: Task) -> tuple[Clock, Clock]:
    """To read all clouds of one recording; to read and evaluate them, rows of results included."""
    (recording,) = task.recordings
    every = tuple(range(len(task.question.configurations)))

    def sweep() -> None:
        for span in split(task):
            make_part(task, Unit(span, every), lambda: False)

    return clocked(lambda: read_all(recording)), clocked(sweep)


def read_all(recording: Recording) -> None:
    for _ in read_frames(recording, 0, len(recording.scans)):
        pass


def whole_sweep_and_reading(bench: Bench, pinned: str) -> Iterator[Finding]:
    """Figures of a process that a user would start."""
    log, _ = swept_logs(bench)
    clouds = len(log.recording.scans)
    times: dict[str, list[float]] = defaultdict(list)
    for _ in range(bench.effort.rounds):
        alone = clocked(lambda: read_all(log.recording))
        start = gapeval_took("sweep", "--help")
        swept = swept_in_processes(bench, log, bench.effort.grid, jobs=1)
        less = (swept.seconds - start.seconds) * 1e3
        times["reading"].append(alone.wall / clouds)
        times["sweep"].append(less / clouds)
        times["start"].append(start.seconds * 1e3)
        times["ratio"].append(less / alone.wall)
        times["ratio, CPU"].append((swept.cpu - start.cpu) * 1e3 / alone.cpu)
    head = partial(figure, "e", f"simulated, {clouds} clouds")
    yield head(".mcap: read and decode", "ms/cloud", times["reading"])
    yield head("gapeval sweep --help", "ms", times["start"])
    note = "wall time of the process less that of --help, by clouds; imports and files are in it"
    yield head("gapeval sweep --jobs 1", "ms/cloud", times["sweep"], note=note)
    yield head("process / reading", "", times["ratio"], *OF_READING, note=f"that / reading, {pinned}")
    yield head("process / reading, CPU", "", times["ratio, CPU"])


@contextmanager
def one_core() -> Iterator[str]:
    """This process and those that it starts, on one core where that can be asked for; says which it was."""
    if not hasattr(os, "sched_setaffinity"):
        yield "one process, not pinned"
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    try:
        yield "pinned to one core"
    finally:
        os.sched_setaffinity(0, allowed)


@cache
def swept_logs(bench: Bench) -> tuple[Log, Log]:
    """The long log and the short one that whole processes sweep."""
    made = [
        simulated_log(
            bench.folder / f"{clouds}-clouds", bench.kind, clouds, ["mcap"], bench.simulated.r_max, limit=1
        )
        for clouds in bench.effort.clouds
    ]
    return made[0], made[1]


def swept_in_processes(
    bench: Bench, log: Log, grid: Grid, jobs: int, environment: Mapping[str, str] = os.environ
) -> Took:
    """A sweep as a user would start it."""
    with tempfile.TemporaryDirectory(dir=bench.folder) as results:
        return gapeval_took(*log.command(grid, Path(results), jobs), environment=environment)


# (f) Workers


def workers(bench: Bench) -> Iterator[Finding]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    long, short = swept_logs(bench)
    lengths = len(short.recording.scans), len(long.recording.scans)
    note = f"slope from {lengths[0]} to {lengths[1]} clouds"
    found: dict[str, list[tuple[Took, Took]]] = defaultdict(list)
    for _ in range(bench.effort.rounds):
        for name, (jobs, environment) in ways_to_sweep(bench).items():
            some, all_of_it = (
                swept_in_processes(bench, log, bench.effort.grid, jobs, environment) for log in (short, long)
            )
            found[name].append((some, all_of_it))
    further = lengths[1] - lengths[0]
    wall = {n: np.array([(b.seconds - a.seconds) / further for a, b in f]) for n, f in found.items()}
    cpu = {n: np.array([(b.cpu - a.cpu) / further for a, b in f]) for n, f in found.items()}
    for name, (jobs, _) in ways_to_sweep(bench).items():
        head = partial(figure, "f", "simulated")
        yield head(name, "ms/cloud", wall[name] * 1e3, note=note)
        yield head(f"{name}: CPU", "ms/cloud", cpu[name] * 1e3, note=note)
        start = [some.seconds for some, _ in found[name]] - wall[name] * lengths[0]
        yield head(f"{name}: start-up", "s", start, note=f"{lengths[0]} clouds less their slope")
        if jobs == 1:
            continue
        speed_up = wall[ALONE] / wall[name]
        yield head(f"{name}: speed-up", "", speed_up)
        targets = [(">=", 0.85)] if jobs == 4 and cores >= 4 else []
        yield head(f"{name}: efficiency", "", speed_up / jobs, *targets)
        about = "CPU / wall / workers; less than 1 where they wait, or others use the cores"
        yield head(f"{name}: cores in use", "", cpu[name] / wall[name] / jobs, note=about)
        about = "more than 1 where they are in each other's way"
        yield head(f"{name}: CPU against one worker", "", cpu[name] / cpu[ALONE], note=about)


ALONE = "1 worker"


def ways_to_sweep(bench: Bench) -> dict[str, tuple[int, Mapping[str, str]]]:
    """Number of workers and environment: each number, and the most of them without THREADS, as they come."""
    ways: dict[str, tuple[int, Mapping[str, str]]] = {ALONE: (1, os.environ)}
    ways |= {f"{jobs} workers": (jobs, os.environ) for jobs in bench.effort.workers if jobs > 1}
    most = max(bench.effort.workers)
    free = {name: value for name, value in os.environ.items() if name != THREADS}
    return ways | {f"{most} workers, {THREADS} unset": (most, free)}


# (g) Growth


def growth(bench: Bench) -> Iterator[Finding]:
    yield from growth_with_points(bench)
    yield from growth_with_grid(bench)


def growth_with_points(bench: Bench) -> Iterator[Finding]:
    log, sizes = bench.simulated, bench.effort.points
    (asked,) = log.grid(ONE)
    full = stacked(log, bench.kind, stop=0, least=max(sizes))
    frames = {points: cut(full, points) for points in sizes}
    times: dict[int, list[float]] = defaultdict(list)
    for _ in range(5 * bench.effort.repetitions):
        for points, frame in frames.items():
            times[points].append(clocked(partial(detect_and_assess, frame, asked, Share())).wall)
    for points, samples in times.items():
        note = f"{len(gapeval.detect(frames[points], asked).gaps)} gaps"  # a thin cloud has more of them
        yield figure("g", log.name, f"N_P {points:,}: detect + assess", "ms", samples, note=note)
    medians = np.array([np.median(times[points]) for points in sizes])
    slope, offset, r2 = straight_line(np.array(sizes, dtype=np.float64), medians)
    off = np.abs(medians / (offset + slope * np.array(sizes)) - 1).max()
    yield figure("g", log.name, "straight line: R2", "", [r2], (">=", LINEAR))
    yield figure("g", log.name, "straight line: offset", "ms", [offset])
    yield figure("g", log.name, "straight line: slope", "ns/point", [slope * 1e6])
    yield figure("g", log.name, "farthest from it, of itself", "", [off])


def straight_line(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Slope, offset and R2 of the least squares."""
    slope, offset = np.polyfit(x, y, 1).tolist()
    rest = float(((y - offset - slope * x) ** 2).sum())
    return slope, offset, 1 - rest / float(((y - y.mean()) ** 2).sum())


def growth_with_grid(bench: Bench) -> Iterator[Finding]:
    """Grids of many sizes, all drawn at random from the same 480 configurations, so that their mix is one."""
    log, sizes = bench.simulated, bench.effort.sizes
    every = log.grid(TWICE)
    random = np.random.default_rng(0)
    times: dict[int, list[float]] = defaultdict(list)
    for frame in bench.samples(log):
        order = random.permutation(len(every))
        for size in sizes:
            asked = log.question([every[index] for index in order[:size]])
            times[size].append(evaluated(log, frame, asked)[0].wall / size)
    for size, samples in times.items():
        yield figure("g", log.name, f"{size} configurations", "ms/config", samples)
    half = max(size for size in sizes if size <= max(sizes) / 2)
    against = [large / small for large, small in zip(times[max(sizes)], times[half], strict=True)]
    yield figure("g", log.name, f"{max(sizes)} / {half}, per configuration", "", against, ("<=", FLAT))


# (h) Memory


def memory(bench: Bench) -> Iterator[Finding]:
    for log in bench.logs[1:]:
        grids = {len(log.grid(grid)): grid for grid in (bench.effort.grid, bench.effort.large)}
        for size, grid in grids.items():
            for jobs in (1, max(bench.effort.workers)):
                peak = swept_in_processes(bench, log, grid, jobs).peak / 1e6
                name = f"{size} configurations, {jobs} worker{'s' * (jobs > 1)}"
                note = f"largest of its processes; {len(log.recording.scans)} clouds"
                yield figure("h", log.name, name, "MB", [peak], ("<", 500), note=note)


# (i) For scale


def patchwork(bench: Bench) -> Iterator[Finding]:
    try:
        import pypatchworkpp
    except ImportError:
        yield Skipped("i", "pypatchworkpp is not installed here")
        return
    for log in bench.logs:
        (asked,) = log.grid(ONE)
        parameters = pypatchworkpp.Parameters()
        parameters.verbose = False
        parameters.enable_RNR = False  # wants intensities
        parameters.sensor_height = float(log.frames[0].sensor.translation[2] - asked.robot.ground_z)
        method = pypatchworkpp.patchworkpp(parameters)
        times = []
        for frame in bench.samples(log, often=5):
            points = (frame.points - frame.sensor.translation).astype(np.float32)
            times.append(clocked(partial(method.estimateGround, points)).wall)
        note = "ground segmentation only, the whole cloud, without reflected noise removal"
        yield figure("i", log.name, "estimateGround", "ms", times, note=note)


# (j) Comparing


def comparing(bench: Bench) -> Iterator[Finding]:
    frames, grid = bench.effort.compared
    sides = {share: bench.folder / f"compared-{share}" for share in (0.02, 0.0)}
    for share, folder in sides.items():
        write_results(folder, drawn(frames, grid, share))
    # From worse to better: nothing is a regression, and the command ends well.
    for name, base in (("all rows changed", sides[0.02]), ("no row changed", sides[0.0])):
        spent = [gapeval_took("compare", base, sides[0.0]) for _ in range(bench.effort.rounds)]
        what = f"{grid} configurations x {frames} frames, {name}"
        yield figure("j", "", what, "s", [one.seconds for one in spent], ("<=", 5))
        yield figure("j", "", f"{what}: memory", "MB", [one.peak / 1e6 for one in spent])


# (k) Raw messages


def raw_reading(bench: Bench) -> Iterator[Finding]:
    log = bench.simulated
    if not {"ros1", "mcap"} <= set(log.files):
        yield Skipped("k", "the simulated log is not there as a ROS 1 bag and as MCAP")
        return
    folder = bench.folder / "raw"
    files = written(folder, log.files["ros1"], log.files["mcap"], 4 * bench.effort.rounds)
    for kind, ours, theirs in compared(files, log.recording.cloud_topic, 1 + 3 * bench.effort.rounds):
        size = files[kind].stat().st_size / 1e6
        head = partial(figure, "k", log.name)
        yield head(f"{kind}: gapeval", "ms", ours, note=f"{size:.0f} MB")
        yield head(f"{kind}: rosbags", "ms", theirs)
        ratios = [one / other for one, other in zip(ours, theirs, strict=True)]
        yield head(f"{kind}: gapeval / rosbags", "", ratios, ("<=", 1.0))


PART: dict[str, Callable[[Bench], Iterator[Finding]]] = {
    "a": one_configuration,
    "b": whole_grid,
    "c": detection_alone,
    "d": floor,
    "e": reading,
    "f": workers,
    "g": growth,
    "h": memory,
    "i": patchwork,
    "j": comparing,
    "k": raw_reading,
}
