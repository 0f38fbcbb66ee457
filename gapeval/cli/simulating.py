"""Simulate a log for a command: progress while rays are cast, one line on what was written."""

from pathlib import Path

from gapeval.cli.reading import progress_bar, say
from gapeval.report.text import counted
from gapeval.simulate.casting import has_embree
from gapeval.simulate.log import write_simulation
from gapeval.simulate.scans import joint_of, scan_stamps
from gapeval.simulate.simulation import STANDING, UNVARIED, Simulation, Taking, simulation
from gapeval.simulate.turns import turn_stamps
from gapeval.simulate.variation import Variation


def simulate_log(
    scene: str,
    sensor: str,
    frames: int | None,
    seed: int,
    container: str,
    folder: Path,
    variation: Variation = UNVARIED,
    taking: Taking = STANDING,
) -> tuple[Simulation, Path, Path]:
    """The simulation, its log and its labels."""
    if not has_embree():
        say("embreex is not installed here: casting rays by trimesh alone, which takes minutes per cloud")
    simulated = simulation(scene, sensor, frames, seed, variation, taking)
    with progress_bar(
        f"simulate {scene}", simulated.frames, "stops" if taking != STANDING else "clouds"
    ) as bar:
        log, labels = write_simulation(simulated, folder, container, bar.update)
    varied = "".join(f", {name} {value}" for name, value in variation.about.items())
    say(
        f"{log}: {_measured(simulated)} by {sensor}, seed {seed}{varied}; "
        f"{labels}: {counted(len(simulated.labels), 'label')}"
    )
    return simulated, log, labels


def _measured(simulated: Simulation) -> str:
    """How much of what is in the log."""
    if simulated.taking.scans:
        passes, scans = len(joint_of(simulated).begins), len(scan_stamps(simulated))
        return f"{counted(scans, 'scan')} in {passes} pass{'es' if passes > 1 else ''}"
    return counted(len(turn_stamps(simulated)) if simulated.taking.moving else simulated.frames, "cloud")
