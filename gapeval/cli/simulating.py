"""Simulate a log for a command: progress while rays are cast, one line on what was written."""

from pathlib import Path

from gapeval.cli.reading import progress_bar, say
from gapeval.report.text import counted
from gapeval.simulate.casting import has_embree
from gapeval.simulate.simulation import UNVARIED, Simulation, simulation, write_simulation
from gapeval.simulate.variation import Variation


def simulate_log(
    scene: str,
    sensor: str,
    frames: int | None,
    seed: int,
    container: str,
    folder: Path,
    variation: Variation = UNVARIED,
) -> tuple[Simulation, Path, Path]:
    """The simulation, its log and its labels."""
    if not has_embree():
        say("embreex is not installed here: casting rays by trimesh alone, which takes minutes per cloud")
    simulated = simulation(scene, sensor, frames, seed, variation)
    with progress_bar(f"simulate {scene}", simulated.frames, "clouds") as bar:
        log, labels = write_simulation(simulated, folder, container, bar.update)
    varied = "".join(f", {name} {value}" for name, value in variation.about.items())
    say(
        f"{log}: {counted(simulated.frames, 'cloud')} by {sensor}, seed {seed}{varied}; "
        f"{labels}: {counted(len(simulated.labels), 'label')}"
    )
    return simulated, log, labels
