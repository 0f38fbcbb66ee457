"""The configurations that we ship."""

from pathlib import Path

import pytest
from command import gapeval

from gapeval.config import load_config
from gapeval.simulate.sensors import SENSORS
from gapeval.sweep.grid import configurations

CONFIGS = Path(__file__).parent.parent / "configs"


@pytest.mark.parametrize("path", sorted(CONFIGS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_file_can_be_used(path: Path) -> None:
    assert configurations(load_config(path))


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_sensors_file_is_for_its_robot_and_finds_gaps(sensor: str, tmp_path: Path) -> None:
    """In a layout that the file was not chosen on."""
    path = CONFIGS / f"{sensor}.yaml"
    assert load_config(path).robot == SENSORS[sensor].robot
    gapeval("simulate", "barrel", "--sensor", sensor, "--seed", 77, "--frames", 3, "-o", tmp_path)
    log, labels = tmp_path / "barrel.mcap", tmp_path / "labels.geojson"
    detected = gapeval("detect", log, "-o", tmp_path / "d.geojson", "--config", path)
    assert detected.status == 0
    scored = gapeval("score", tmp_path / "d.geojson", labels)
    (hit_rate,) = (line.split()[1] for line in scored.out.splitlines() if line.startswith("hit_rate"))
    assert float(hit_rate) >= 0.75
