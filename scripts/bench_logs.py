"""What the bench measures on: simulated logs, logs of dense clouds made of them, real logs."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gapeval.config import Configuration, Detector, load_config
from gapeval.detection import pole
from gapeval.frame import Frame
from gapeval.labels import Labels, read_labels
from gapeval.logs.read import Recording, read_frames, read_recording
from gapeval.logs.write import Cloud, Link, Links, Message, write_log
from gapeval.scoring.scene import common_domain
from gapeval.simulate.casting import caster
from gapeval.simulate.log import LABELS, write_simulation
from gapeval.simulate.mesh import static_triangles
from gapeval.simulate.simulation import Simulation, cloud, simulation
from gapeval.sweep.evaluation import Question
from gapeval.sweep.grid import configurations

ROOT = Path(__file__).parent.parent
CONTAINERS = {"mcap": ".mcap", "ros1": ".bag", "ros2": "rosbag2 folder"}
RADII = np.arange(1.0, 30.1, 0.5)  # m, from which r_max is chosen

Grid = Mapping[str, Sequence[object]]
GRID: Grid = {
    "k": (5, 6, 7),
    "delta_r": (1.02, 1.03, 1.05, 1.1, 1.2),
    "n_o": (0, 1, 2, 3),
    "pl_th": (0.05, 0.1, 0.2, 0.3),
}
ONE: Grid = {"k": (6,), "delta_r": (1.05,), "n_o": (1,), "pl_th": (0.1,)}


@dataclass(frozen=True, slots=True)
class Kind:
    """Which simulation, and how dense. points, boxed: of a dense cloud, all and in its box."""

    scene: str = "street"
    sensor: str = "os1-128"
    points: int = 131072
    boxed: int = 40000

    @property
    def config(self) -> Path:
        return ROOT / "configs" / f"{self.sensor}.yaml"


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A log and the frames in it. files: by container, the first is the one that `frames` are of.

    r_max: [m], of every configuration that it is measured with.
    """

    name: str
    about: str
    files: dict[str, Path]
    labels_file: Path
    config: Path
    r_max: float
    frames: tuple[Frame, ...]
    recording: Recording
    labels: Labels

    @property
    def path(self) -> Path:
        return next(iter(self.files.values()))

    def parameters(self, grid: Grid) -> list[str]:
        """A grid as values of `-p`."""
        return [
            f"{key}={','.join(map(str, values))}" for key, values in {**grid, "r_max": [self.r_max]}.items()
        ]

    def grid(self, grid: Grid) -> tuple[Configuration, ...]:
        return configurations(load_config(self.config, self.parameters(grid)))

    def question(self, asked: Sequence[Configuration]) -> Question:
        scoring = load_config(self.config).scoring
        return Question(tuple(asked), scoring, *common_domain(asked, scoring))

    def command(self, grid: Grid, folder: Path, jobs: int) -> list[object]:
        """Arguments of the command that sweeps it."""
        options = [word for text in self.parameters(grid) for word in ("-p", text)]
        log = ["sweep", self.path, "--labels", self.labels_file, "--config", self.config]
        return [*log, *options, "--jobs", jobs, "-o", folder]

    def counts(self) -> dict[str, object]:
        """How many points its clouds have; least, median, most."""
        boxed = [int(in_the_box(frame, self.grid(ONE)[0].detector).sum()) for frame in self.frames]
        return {
            "about": self.about,
            "frames": len(self.frames),
            "r_max": self.r_max,
            "points": _spread([len(frame.points) for frame in self.frames]),
            "dropped": _spread([frame.dropped for frame in self.frames]),
            "in_box": _spread(boxed),
        }


def _spread(counts: Sequence[int]) -> list[int]:
    return [min(counts), int(np.median(counts)), max(counts)]


def in_the_box(frame: Frame, detector: Detector) -> NDArray[np.bool_]:
    """Which points (N,) lie in the sensory box of Section 3.1.1, heights included."""
    x, y = pole(frame, detector.origin)
    points = frame.points
    z_fits = (points[:, 2] >= -detector.z_min) & (points[:, 2] <= detector.z_max)
    near = np.hypot(points[:, 0] - x, points[:, 1] - y) < detector.r_max
    return np.asarray(z_fits & near & (points[:, 0] >= detector.x_min), dtype=np.bool_)


def radius_for(frames: Sequence[Frame], config: Path, boxed: int) -> float:
    """r_max [m] at which about so many points are in the box, in the median over the frames."""
    detector = load_config(config).base.detector

    def off(radius: float) -> float:
        wide = detector.model_copy(update={"r_max": radius})
        return abs(float(np.median([in_the_box(frame, wide).sum() for frame in frames])) - boxed)

    return min((r for r in RADII.tolist() if r > detector.x_min), key=off)


def opened(
    name: str, about: str, files: dict[str, Path], labels: Path, config: Path, r_max: float, limit: int
) -> Log:
    """A log whose first frames are in memory."""
    recording = read_recording(next(iter(files.values())), load_config(config).log)
    return Log(
        name, about, files, labels, config, r_max, read(recording, limit), recording, read_labels(labels)
    )


def read(recording: Recording, limit: int) -> tuple[Frame, ...]:
    found = read_frames(recording, 0, min(limit, len(recording.scans)))
    return tuple(frame for frame in found if isinstance(frame, Frame))


def simulated_log(
    folder: Path, kind: Kind, frames: int, containers: Sequence[str], r_max: float | None, limit: int
) -> Log:
    """A log as `gapeval simulate` makes it, once for each container. r_max: None for that of kind.boxed."""
    made = simulation(kind.scene, kind.sensor, frames, seed=0)
    written = {one: write_simulation(made, folder / one, one, lambda: None) for one in containers}
    files = {one: log for one, (log, _) in written.items()}
    labels = folder / containers[0] / LABELS
    about = f"{kind.scene} by {kind.sensor}, as simulated"
    log = opened("simulated", about, files, labels, kind.config, r_max or 1.0, limit)
    return log if r_max is not None else replace(log, r_max=radius_for(log.frames, kind.config, kind.boxed))


def dense_log(folder: Path, kind: Kind, simulated: Log, frames: int) -> Log:
    """Its first frames again, each with just kind.points points, of which kind.boxed are in the box.

    Several measurements of one place are stacked and cut: the same ground, other rays and other noise.
    """
    detector = simulated.grid(ONE)[0].detector
    made = [
        with_counts(stacked(simulated, kind, stop, 2 * kind.points), detector, kind.points, kind.boxed)
        for stop in range(min(frames, len(simulated.frames)))
    ]
    folder.mkdir()
    path = folder / "dense.mcap"
    write_log(path, "mcap", messages(made))
    about = f"{kind.scene} by {kind.sensor}, several measurements of each place stacked and cut"
    files, r_max = {"mcap": path}, simulated.r_max
    return opened("dense", about, files, simulated.labels_file, simulated.config, r_max, frames)


def real_log(limit: int) -> Log | None:
    """The real log in GAPEVAL_DATA, or None."""
    data = os.environ.get("GAPEVAL_DATA")
    folder = Path(data or "") / "os1_street"
    if not data or not folder.is_dir():
        return None
    files = {one: folder / f"os1_street{CONTAINERS[one]}" for one in ("mcap", "ros1")}
    config = ROOT / "configs" / "os1_street.yaml"
    r_max = load_config(config).detector.r_max
    return opened(
        "real", "recorded, os1_street", files, folder / "labels.geojson", config, float(r_max), limit
    )


def measurements(made: Simulation, stop: int) -> Iterator[NDArray[np.float32]]:
    """Clouds without end of one place, in the sensor's frame, each with rays and noise of its own."""
    still = caster(static_triangles(made.scene))
    seed = 1
    while True:
        yield cloud(replace(made, seed=seed), still, stop)
        seed += 1


def stacked(log: Log, kind: Kind, stop: int, least: int) -> Frame:
    """A frame of a simulated log with more measurements of its place, at least so many points."""
    like = log.frames[stop]
    found, clouds = 0, []
    for points in measurements(simulation(kind.scene, kind.sensor, len(log.frames), seed=0), stop):
        clouds.append(points)
        found += len(points)
        if found >= least:
            break
    placed = like.sensor.apply(np.concatenate(clouds).astype(np.float64))
    return replace(like, points=placed.astype(np.float32))


def cut(frame: Frame, points: int) -> Frame:
    """So many of its points, chosen at random, in their order."""
    chosen = np.random.default_rng(0).choice(len(frame.points), points, replace=False)
    return replace(frame, points=frame.points[np.sort(chosen)])


def with_counts(frame: Frame, detector: Detector, points: int, boxed: int) -> Frame:
    """So many of its points, and so many of these in the box; fewer in the box where there are too few."""
    random = np.random.default_rng(0)
    inside = in_the_box(frame, detector)
    within, beyond = np.flatnonzero(inside), np.flatnonzero(~inside)
    kept = min(boxed, len(within))
    chosen = [random.choice(within, kept, replace=False), random.choice(beyond, points - kept, replace=False)]
    return replace(frame, points=frame.points[np.sort(np.concatenate(chosen))])


def messages(frames: Sequence[Frame]) -> Iterator[Message]:
    """Frames as a log has them."""
    first = frames[0]
    yield Links(first.stamp, (Link("base_link", "laser", first.sensor),), is_static=True)
    for frame in frames:
        assert frame.pose is not None
        yield Links(frame.stamp, (Link("map", "base_link", frame.pose),), is_static=False)
        points = frame.sensor.apply_inverse(frame.points.astype(np.float64)).astype(np.float32)
        yield Cloud(frame.stamp, "/points", "laser", points)
