"""Measure on simulated logs what docs/ says of the paper's values and of our defaults, and write it there.

Runs the commands that a user would. `scripts/measure` takes about ten minutes on four cores.
"""

import csv
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from documentation import DOCS, with_part

import gapeval.detection
from gapeval.config import Configuration, Detector
from gapeval.frame import Frame
from gapeval.simulate.sensors import SENSORS, Noise
from gapeval.simulate.simulation import clouds, simulation

ROOT = Path(__file__).parent.parent

TUNNEL_SEEDS = range(20)
K, N_O, DELTA_R = range(3, 9), range(4), (1.02, 1.05, 1.1, 1.2, 1.5, 2.0)
PAPER = {"k": "6", "n_o": "1", "delta_r": "1.1", "pl_th": "0.1"}

SEEDS = range(5)
WITH_GAPS = ("tunnel", "barrel", "street", "approach")
WITHOUT = ("plain", "slope")
# What is simulated: rough ground, the laser's shadow filter, noise.
SOURCES = {
    "all": (True, True, True),
    "smooth ground": (False, True, True),
    "no shadow filter": (True, False, True),
    "no noise": (True, True, False),
    "sampling alone": (False, False, False),
}
PLAIN_FRAMES = 5
SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)

Row = dict[str, str]


@dataclass(frozen=True)
class Log:
    """A simulated log with its labels."""

    path: Path
    labels: Path


def run(*arguments: object) -> None:
    subprocess.run(
        [sys.executable, "-m", "gapeval", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL
    )


def simulated(folder: Path, scene: str, sensor: str, seed: int) -> Log:
    run("simulate", scene, "--sensor", sensor, "--seed", seed, "-o", folder)
    return Log(folder / f"{scene}.mcap", folder / "labels.geojson")


def swept(folder: Path, logs: Sequence[Log], config: str, **grid: Iterable[object]) -> None:
    """A sweep of a grid around a file of configs/, whose own grid has one value of each."""
    options: list[object] = []
    for log in logs:
        options += [log.path, "--labels", log.labels]
    for key, values in grid.items():
        options += ["-p", f"{key}={','.join(map(str, values))}"]
    run("sweep", *options, "--config", ROOT / "configs" / config, "-o", folder)


def rows(file: Path) -> list[Row]:
    with file.open(newline="") as opened:
        return list(csv.DictReader(opened))


def table(head: Sequence[str], body: Iterable[Sequence[object]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def figure(text: str, digits: int = 2) -> str:
    return f"{float(text):.{digits}f}" if text else "-"


def part(page: str, name: str, content: str) -> str:
    return with_part(page, name, content + "\n", script="measure")


# The tunnel


def tunnel(work: Path) -> str:
    """docs/tunnel.md."""
    logs = [simulated(work / f"tunnel{seed}", "tunnel", "lms151", seed) for seed in TUNNEL_SEEDS]
    pictures(work, logs[0])
    swept(work / "tunnel", logs, "paper.yaml", k=K, n_o=N_O, delta_r=DELTA_R)
    summary = rows(work / "tunnel" / "summary.csv")
    overall = [row for row in summary if row["log"] == "all"]
    complete = Counter(
        row["configuration"] for row in summary if row["log"] != "all" and row["hit_rate"] == "1.0"
    )
    page = (DOCS / "tunnel.md").read_text(encoding="utf-8")
    parts = [tunnel_grid(overall, complete, n_o) for n_o in N_O]
    page = part(page, "grid", "\n\n".join(parts))
    page = part(page, "paper", papers_rows(overall, complete))
    page = part(page, "labels", hits_by_label(work / "tunnel", overall))
    page = part(page, "barrel", barrel(work))
    page = part(page, "empty", empty_cells())
    return part(page, "sources", sources_of_false_gaps())


def pictures(work: Path, log: Log) -> None:
    """docs/tunnel.png and docs/stages.png: the first frame at the paper's values."""
    drawn = ["--picture", DOCS / "tunnel.png", "--stages", DOCS / "stages.png", "--labels", log.labels]
    run("detect", log.path, "-o", work / "d.geojson", "--config", ROOT / "configs" / "paper.yaml", *drawn)


def tunnel_grid(overall: Sequence[Row], complete: Counter[str], n_o: int) -> str:
    """hit rate, false gaps per frame, and layouts without a miss, at each k and delta_r."""
    found = {(int(row["k"]), int(row["n_o"]), float(row["delta_r"])): row for row in overall}

    def cell(k: int, delta_r: float) -> str:
        row = found[k, n_o, delta_r]
        return (
            f"{figure(row['hit_rate'])} / {figure(row['fp_per_frame'], 1)} / {complete[row['configuration']]}"
        )

    body = [[k, *(cell(k, delta_r) for delta_r in DELTA_R)] for k in K]
    return f"### n_o {n_o}\n\n" + table(["k", *(f"delta_r {delta_r}" for delta_r in DELTA_R)], body)


def papers_rows(overall: Sequence[Row], complete: Counter[str]) -> str:
    """The metrics that matter at the paper's values, and beside them with other n_o."""
    names = ("hit_rate", "fp_per_frame", "coverage", "over_area", "pq", "splits", "merges")
    names += ("npca_accuracy", "npca_length_error", "npca_yaw_error")
    body = [
        [row["n_o"], *(figure(row[name], 3) for name in names), complete[row["configuration"]]]
        for row in overall
        if all(row[key] == value for key, value in PAPER.items() if key != "n_o")
    ]
    return table(["n_o", *names, "layouts without a miss, of 20"], body)


def hits_by_label(folder: Path, overall: Sequence[Row]) -> str:
    """Which labels the paper's values hit, by where they are."""
    chosen = next(row for row in overall if all(row[key] == value for key, value in PAPER.items()))
    seen = [
        row
        for row in rows(folder / "labels.csv")
        if row["configuration"] == chosen["configuration"] and row["hit"]
    ]
    body = []
    for label in sorted({row["label"] for row in seen}):
        mine = [row for row in seen if row["label"] == label]
        shares = [float(row["covered_area"]) / float(row["visible_area"]) for row in mine]
        hits = sum(row["hit"] == "true" for row in mine)
        ranges = [float(row["range"]) for row in mine]
        lengths = [float(row["length"]) for row in mine]
        body.append(
            [
                label,
                len(mine),
                f"{hits / len(mine):.2f}",
                f"{np.median(shares):.2f}",
                f"{min(ranges):.2f}-{max(ranges):.2f}",
                f"{min(lengths):.2f}-{max(lengths):.2f}",
            ]
        )
    return table(["gap", "asked for", "hit", "median coverage", "range [m]", "width [m]"], body)


def barrel(work: Path) -> str:
    """The second scenario: what becomes of the small gap ahead."""
    logs = [simulated(work / f"barrel{seed}", "barrel", "lms151", seed) for seed in TUNNEL_SEEDS]
    swept(work / "barrel", logs, "paper.yaml", k=(6, 7, 8), delta_r=(1.05, 1.1))
    labels = rows(work / "barrel" / "labels.csv")
    body = []
    for row in rows(work / "barrel" / "summary.csv"):
        if row["log"] != "all":
            continue
        ahead = [
            label
            for label in labels
            if label["configuration"] == row["configuration"] and label["label"] == "front" and label["hit"]
        ]
        found = sum(int(label["gaps"]) > 0 for label in ahead) / len(ahead)
        hit = sum(label["hit"] == "true" for label in ahead) / len(ahead)
        shares = [float(label["covered_area"]) / float(label["visible_area"]) for label in ahead]
        pieces = np.mean([int(label["gaps"]) for label in ahead if int(label["gaps"])])
        figures = [f"{pieces:.1f}", *(figure(row[name]) for name in ("hit_rate", "fp_per_frame"))]
        body.append(
            [row["k"], row["delta_r"], f"{found:.2f}", f"{hit:.2f}", f"{np.median(shares):.2f}", *figures]
        )
    head = ["k", "delta_r", "gap ahead: found", "hit", "median coverage", "pieces"]
    return table([*head, "hit_rate of all", "fp_per_frame"], body)


def sources_of_false_gaps() -> str:
    """False gaps per frame on `plain`, with parts of the simulation left out."""
    frames = {name: plain_frames(*parts) for name, parts in SOURCES.items()}
    body = []
    for edge in ("data", "zero"):
        for k, delta_r in ((6, 1.1), (6, 1.05), (8, 1.1)):
            detector = Detector(k=k, delta_r=delta_r, edge=edge)
            counts = [
                np.mean([len(found.gaps) for found in detections(frames[name], detector)]) for name in SOURCES
            ]
            body.append([edge, k, delta_r, *(f"{count:.1f}" for count in counts)])
    return table(["edge", "k", "delta_r", *SOURCES], body)


def empty_cells() -> str:
    """Share of the cells in the box that no echo meets, and the regions that they form."""
    body = []
    for rate, r_max in ((1.2, 3.0), (0.6, 3.0), (1.2, 10.0)):
        frames = plain_frames(*SOURCES["sampling alone"], rate)
        for k in (5, 6, 7, 8):
            found = detections(frames, Detector(k=k, n_o=0, r_max=r_max))
            empty = [one.surface.gap.cells.sum() / one.surface.seen.cells.sum() for one in found]
            regions = [len(one.gaps) for one in found]
            body.append([rate, r_max, k, f"{np.mean(empty):.3f}", f"{np.mean(regions):.1f}"])
    return table(["roll [rad/s]", "R [m]", "k", "empty cells", "regions"], body)


def detections(frames: Sequence[Frame], detector: Detector) -> list[gapeval.detection.Detection]:
    configuration = Configuration(detector=detector, robot=SENSORS["lms151"].robot)
    return [gapeval.detect(frame, configuration) for frame in frames]


def plain_frames(rough: bool, filtered: bool, noisy: bool, rate: float = 1.2) -> list[Frame]:
    """`plain` as the rolling laser sees it; rate: of its roll [rad/s]."""
    frames = []
    for seed in SEEDS:
        simulated = simulation("plain", "lms151", PLAIN_FRAMES, seed)
        scene, sensor = simulated.scene, simulated.sensor
        if not rough:
            flat = replace(scene.ground, waves=np.zeros((1, 4)))
            scene = replace(scene, ground=flat)
        pattern = replace(sensor.pattern, rolls=(-np.pi / 2, np.pi / 2, rate / 50))
        if not filtered:
            pattern = replace(pattern, shadow_filter=0.0)
        sensor = replace(sensor, pattern=pattern, noise=sensor.noise if noisy else Noise(0.0))
        for points in clouds(replace(simulated, scene=scene, sensor=sensor)):
            placed = sensor.mount.apply(points.astype(np.float64)).astype(np.float32)
            frames.append(Frame(0, placed, sensor.mount))
    return frames


# What the design left to measurement


def settled(work: Path) -> str:
    """The measured part of docs/detector.md and docs/scoring.md."""
    page = (DOCS / "detector.md").read_text(encoding="utf-8")
    groups = {"edge": ("data", "zero"), "origin": ("sensor", "robot"), "kernel": ("rect", "cross")}
    tables: dict[str, list[list[str]]] = {name: [] for name in (*groups, "uniform")}
    shares: list[list[str]] = []
    for sensor in SENSORS:
        logs = [
            simulated(work / f"{sensor}-{scene}{seed}", scene, sensor, seed)
            for scene in (*WITH_GAPS, *WITHOUT)
            for seed in SEEDS
        ]
        for name, values in {**groups, "uniform": ("area", "kdtree")}.items():
            extra = {"n_o": (1, 2)} if name == "kernel" else {}
            swept(work / name, logs, f"{sensor}.yaml", **{name: values}, **extra)
            overall = [row for row in rows(work / name / "summary.csv") if row["log"] == "all"]
            for row in overall:
                tables[name].append([sensor, *decision_cells(name, row)])
            if name == "edge":
                shares += share_rows(sensor, work / name, overall[0]["configuration"])
    usual = ["sensor", "value", "hit_rate", "fp_per_frame", "coverage", "over_area", "pq"]
    for name in groups:
        head = usual if name != "kernel" else [*usual[:2], "n_o", *usual[2:]]
        page = part(page, name, table(head, tables[name]))
    head = ["sensor", "value", "pca_accuracy", "pca_length_error", "pca_yaw_error", "axis_angle"]
    page = part(page, "uniform", table(head, tables["uniform"]))
    scoring = (DOCS / "scoring.md").read_text(encoding="utf-8")
    head = ["sensor", "asked for", *(f"covered >= {share}" for share in SHARES)]
    (DOCS / "scoring.md").write_text(part(scoring, "hit_coverage", table(head, shares)), encoding="utf-8")
    return page


def decision_cells(name: str, row: Row) -> list[str]:
    if name == "uniform":
        columns = ("pca_accuracy", "pca_length_error", "pca_yaw_error", "axis_angle")
        return [row["uniform"], *(figure(row[column], 3) for column in columns)]
    value = [row[name], row["n_o"]] if name == "kernel" else [row[name]]
    columns = ("hit_rate", "fp_per_frame", "coverage", "over_area", "pq")
    return value + [figure(row[column], 3) for column in columns]


def share_rows(sensor: str, folder: Path, configuration: str) -> list[list[str]]:
    """How much of each asked label is covered: the share of them above some thresholds."""
    covered = np.array(
        [
            float(row["covered_area"]) / float(row["visible_area"])
            for row in rows(folder / "labels.csv")
            if row["configuration"] == configuration and row["hit"]
        ]
    )
    return [[sensor, str(len(covered)), *(f"{(covered >= share).mean():.3f}" for share in SHARES)]]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (DOCS / "tunnel.md").write_text(tunnel(work), encoding="utf-8")
        (DOCS / "detector.md").write_text(settled(work), encoding="utf-8")


if __name__ == "__main__":
    main()
