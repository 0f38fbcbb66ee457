"""Variations of scenes: what is varied varies, and nothing else does."""

import json
import math
from dataclasses import fields

import numpy as np
import pytest
import shapely
from command import gapeval
from hypothesis import given
from hypothesis import strategies as st
from simulated import FACTS, raster

from gapeval.errors import ConfigError
from gapeval.simulate.layouts import SCENES
from gapeval.simulate.sensors import SENSORS
from gapeval.simulate.simulation import clouds, simulation
from gapeval.simulate.variation import Variation, varied_scene

ROBOTS = ("lms151", "vlp16")


def same(one, other, *but):
    """Whether two scenes or grounds are equal in all fields but these."""
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name in but:
            continue
        if isinstance(a, np.ndarray):
            assert a.tobytes() == b.tobytes(), field.name
        elif field.name == "ground":
            same(a, b)
        else:
            assert repr(a) == repr(b), field.name


# Nothing varied


@pytest.mark.parametrize("sensor", ROBOTS)
@pytest.mark.parametrize("scene", SCENES)
def test_a_variation_by_default_changes_nothing(scene, sensor):
    """The ground, the stops and the sensor are those of the layout, and `about` says no more than ever."""
    plain, spelled = (
        simulation(scene, sensor, 3, 4),
        simulation(scene, sensor, 3, 4, Variation(0.01, None, True, 1)),
    )
    chosen = SENSORS[sensor]
    for made in (plain, spelled):
        assert made.about == {"scene": scene, "sensor": sensor, "frames": 3, "seed": 4}
        assert made.sensor == chosen
        same(made.scene, SCENES[scene].build(np.random.default_rng([4, 0]), chosen, 3))


@pytest.mark.parametrize("sensor", ROBOTS)
def test_options_that_change_nothing_give_the_same_bytes(tmp_path, sensor):
    made = {}
    for name, options in {"plain": (), "spelled": ("--roughness", 0.01, "--density", 1)}.items():
        folder = tmp_path / name
        done = gapeval("simulate", "barrel", "--sensor", sensor, "--frames", 1, *options, "-o", folder)
        assert done.status == 0, done.err
        made[name] = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert made["plain"] == made["spelled"]
    about = json.loads(made["plain"]["labels.geojson"])["simulated"]
    assert list(about) == ["scene", "sensor", "frames", "seed"]


# Roughness


@given(st.floats(0, 0.1))
def test_the_ground_is_as_rough_as_is_asked(roughness):
    usual = simulation("street", "lms151", 8, 2).scene
    varied = varied_scene(usual, "street", Variation(roughness=roughness))
    same(usual, varied, "ground")
    same(usual.ground, varied.ground, "waves")
    x, y = np.meshgrid(np.arange(-8, 8, 0.21), np.arange(-8, 8, 0.21))
    places = np.stack([x, y], axis=-1)
    np.testing.assert_allclose(
        varied.ground.height(places), usual.ground.height(places) * roughness / 0.01, atol=1e-12
    )
    assert varied.ground.height(places).std() == pytest.approx(roughness, rel=0.25, abs=1e-12)


def test_echoes_of_ground_without_roughness_lie_on_the_plane():
    made = simulation("plain", "vlp16", 1, 0, Variation(roughness=0.0))
    (points,) = clouds(made)
    heights = made.pose(0).apply(made.sensor.mount.apply(points.astype(np.float64)))[:, 2]
    distance = np.linalg.norm(points, axis=1)
    # 8 mm of noise along a ray that comes 0.6 m down.
    expected = 0.008 * 0.6 / distance
    assert (heights / expected).std() == pytest.approx(1.0, abs=0.03)


# Slope


@given(st.floats(0, 45))
def test_the_ramp_is_as_steep_as_is_asked(angle):
    usual = simulation("slope", "lms151", 6, 1)
    varied = simulation("slope", "lms151", 6, 1, Variation(slope=angle))
    same(usual.scene, varied.scene, "ground")
    same(usual.scene.ground, varied.scene.ground, "profile")
    rise = math.tan(math.radians(angle))
    x = np.array([-5.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.5, 20.0])
    level = varied.scene.ground.level(x)
    np.testing.assert_allclose(level, rise * np.array([0, 0, 1, 3, 3, 3, 0.5, 0]), atol=1e-9)


def test_a_robot_on_the_ramp_pitches_with_it():
    made = simulation("slope", "lms151", 29, 1, Variation(slope=25))
    (on,) = np.flatnonzero(np.abs(made.scene.stops[:, 0] - 4.5) < 0.25)[:1]
    forward = made.pose(int(on)).matrix[:, 0]
    assert math.degrees(math.asin(forward[2])) == pytest.approx(25, abs=0.3)


# Obstacles


@pytest.mark.parametrize("sensor", ROBOTS)
@pytest.mark.parametrize("scene", SCENES)
def test_without_obstacles_walls_stay_and_all_else_is_equal(scene, sensor):
    low = {"tunnel": 14, "barrel": 1}.get(scene, 0)  # a wreck of six prisms and eight lumps; a barrel
    for seed in range(5):
        usual = simulation(scene, sensor, 8, seed)
        varied = simulation(scene, sensor, 8, seed, Variation(obstacles=False))
        same(usual.scene, varied.scene, "solids", "passing")
        assert usual.drive.stamps.tolist() == varied.drive.stamps.tolist()
        assert len(usual.scene.solids) - len(varied.scene.solids) == low
        assert all(solid.top > 2.0 for solid in varied.scene.solids)
        assert not any(varied.scene.passing_at(stop) for stop in range(8))
        assert varied.about == usual.about | {"obstacles": False}


@pytest.mark.parametrize("scene", ["tunnel", "barrel", "street"])
def test_rays_that_met_no_obstacle_measure_the_same_without_them(scene):
    """The noise of a ray does not depend on what others hit."""
    stop = 2  # where people pass
    usual, varied = (simulation(scene, "os1-64", 3, 7, Variation(obstacles=there)) for there in (True, False))
    with_, without = (raster(FACTS["os1-64"], list(clouds(made))[stop]) for made in (usual, varied))
    differs = (with_.ranges != without.ranges) & np.isfinite(with_.ranges)
    assert differs.sum() > 100
    pose = usual.pose(stop)
    places = pose.apply(usual.sensor.mount.apply(with_.rays[differs] * with_.ranges[differs][:, None]))
    things = [s for s in (*usual.scene.solids, *usual.scene.passing_at(stop)) if s.top < 2.0]
    near = shapely.distance(shapely.points(places[:, :2]), shapely.union_all([s.outline for s in things]))
    assert near.max() < 0.06  # 10 mm of noise
    assert (with_.ranges[differs] < without.ranges[differs] + 0.06).all()


# Density


@pytest.mark.parametrize(("density", "scans"), [(0.5, 65), (2, 262), (3.0, 393)])
def test_a_rolling_sensor_has_so_many_times_the_scans(density, scans):
    made = simulation("plain", "lms151", 1, 0, Variation(density=density))
    rays = made.sensor.pattern.directions(0.25)
    assert rays.shape == (scans, 541, 3)
    roll = np.arctan2(rays[:, 0, 2], rays[:, 0, 1])
    np.testing.assert_allclose(np.abs(np.diff(np.unwrap(roll))), 0.024 / density, rtol=1e-9)
    usual = simulation("plain", "lms151", 1, 0)
    assert made.drive.stamps.tolist() == usual.drive.stamps.tolist()
    (many,), (few,) = clouds(made), clouds(usual)
    assert len(many) / len(few) == pytest.approx(density, rel=0.02)


@pytest.mark.parametrize("density", [0.25, 2, 2.5])
@pytest.mark.parametrize("sensor", [name for name in SENSORS if name != "lms151"])
def test_a_spinning_sensor_has_so_many_times_the_columns(sensor, density):
    made = simulation("plain", sensor, 1, 0, Variation(density=density))
    rays = made.sensor.pattern.directions(0.25)
    facts = FACTS[sensor]
    assert rays.shape == (facts.rings, facts.columns * density, 3)
    step = np.diff(np.unwrap(np.arctan2(rays[0, :, 1], rays[0, :, 0])))
    np.testing.assert_allclose(step, 2 * np.pi / facts.columns / density, rtol=1e-9)
    usual = SENSORS[sensor].pattern.directions(0.25)
    np.testing.assert_allclose(rays[:, 0, 2], usual[:, 0, 2])


# What cannot be


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--roughness", -0.01), "roughness -0.01: must be from 0 to 0.1 m"),
        (("--roughness", "nan"), "roughness nan"),
        (("--slope", 50), "slope 50: must be from 0 to 45"),
        (("--slope", 10), "scene plain has no ramp; choose scene slope"),
        (("--density", 0), "density 0: must be more than 0"),
        (("--density", "inf"), "density inf"),
        (("--density", 1e-6), "density 1e-06: leaves no ray"),
    ],
)
def test_what_cannot_be_varied_is_one_line(tmp_path, options, says):
    done = gapeval("simulate", "plain", *options, "-o", tmp_path / "out")
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert says in done.err
    assert not (tmp_path / "out").exists()


def test_another_variation_is_another_simulation(tmp_path):
    options = ("simulate", "barrel", "--sensor", "vlp16", "--frames", 1, "-o", tmp_path)
    varied = (*options, "--without-obstacles", "--roughness", 0.02, "--density", 0.5)
    done = gapeval(*varied)
    assert done.status == 0
    assert "seed 0, roughness 0.02, obstacles False, density 0.5;" in done.err
    about = json.loads((tmp_path / "labels.geojson").read_text())["simulated"]
    assert about == {
        "scene": "barrel",
        "sensor": "vlp16",
        "frames": 1,
        "seed": 0,
        "roughness": 0.02,
        "obstacles": False,
        "density": 0.5,
    }
    assert gapeval(*varied).status == 0
    refused = gapeval(*options)
    assert refused.status == 1
    assert "holds another simulation" in refused.err


def test_values_out_of_range_are_config_errors():
    for values in ({"roughness": 0.2}, {"slope": -1}, {"density": 101}, {"density": math.nan}):
        with pytest.raises(ConfigError):
            Variation(**values)
