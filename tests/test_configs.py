"""The starting configurations of the simulated sensors."""

from pathlib import Path

import pytest
from command import gapeval

from gapeval.config import load_config
from gapeval.simulate.sensors import SENSORS

CONFIGS = Path(__file__).parent.parent / "configs"


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_sensors_file_is_for_its_robot_and_finds_gaps(sensor: str, tmp_path: Path) -> None:
    """In a layout that the file was not chosen on."""
    path = CONFIGS / f"{sensor}.yaml"
    assert load_config(path).robot == SENSORS[sensor].robot
    gapeval("simulate", "tunnel", "--sensor", sensor, "--seed", 77, "--frames", 3, "-o", tmp_path)
    log, labels = tmp_path / "tunnel.mcap", tmp_path / "labels.geojson"
    detected = gapeval("detect", log, "-o", tmp_path / "d.geojson", "--config", path)
    assert detected.status == 0
    scored = gapeval("score", tmp_path / "d.geojson", labels)
    (hit_rate,) = (line.split()[1] for line in scored.out.splitlines() if line.startswith("hit_rate"))
    assert float(hit_rate) >= 0.75
