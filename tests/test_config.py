"""Parameters: what is refused and how it is said, who wins, the way through YAML, ids and grids."""

import hashlib
import json
import math
import re

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gapeval.config import (
    BlindBelow,
    BodyBox,
    Config,
    Configuration,
    CrossingRules,
    Detector,
    Domain,
    FieldOfView,
    LogSection,
    MinVisible,
    Patch,
    Robot,
    Scoring,
    Sensor,
    StaticTransform,
    dotted_key,
    load_config,
    set_parameter,
)
from gapeval.errors import ConfigError
from gapeval.sweep.grid import configurations, the_one

RANDOM = settings(deadline=None, derandomize=True, max_examples=80)


@pytest.fixture
def load(tmp_path):
    """load_config of a file with this text."""
    path = tmp_path / "c.yaml"

    def loaded(text="", *assignments, **explicit):
        path.write_text(text)
        return load_config(path, assignments, **explicit)

    loaded.path = path
    return loaded


def refusal(action, *arguments, **known):
    with pytest.raises(ConfigError) as caught:
        action(*arguments, **known)
    message = str(caught.value)
    assert "\n" not in message
    return message


# --- what a file may not say -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "key", "remedy"),
    [
        ("detector: {delta_r: 1}", "detector.delta_r", "greater than 1 (got 1)"),
        ("detector: {delta: 1.1}", "detector.delta", "did you mean detector.delta_r?"),
        ("detector: {k: 0}", "detector.k", "greater than or equal to 1 (got 0)"),
        ("detector: {k: six}", "detector.k", "integer"),
        ("detector: {k: 5.5}", "detector.k", "integer"),
        ("detector: {pl_th: .nan}", "detector.pl_th", "got nan"),
        ("detector: {z_min: .nan}", "detector.z_min", "got nan"),
        ("detector: {r_max: .inf}", "detector.r_max", "finite"),
        ("detector: {kernel: disk}", "detector.kernel", "'rect' or 'cross'"),
        ("detector: {x_min: 3.0}", "detector: x_min 3.0", "nothing of r_max 3.0"),
        ("detector: {x_min: 1, r_max: 0.5}", "detector: x_min 1.0", "nothing of r_max 0.5"),
        ("detector: {patch: {dpth: 1}}", "detector.patch.dpth", "no such parameter"),
        ("detector: {patch: 3}", "detector.patch", "valid dictionary"),
        ("detector: 5", "detector", "valid dictionary"),
        ("detector: [k]", "detector", "valid dictionary"),
        ("detector: {7: 1}", "detector.7", "strings"),
        ("detectr: {k: 5}", "detectr", "no such parameter"),
        ("crossing: {rules: ours}", "crossing.rules", "'all' or 'paper'"),
        ("crossing: {d_rr: 1}", "crossing.d_rr", "did you mean crossing.d_r?"),
        (
            "robot: {body: {x: [0, 1], y: [0, 1], z: [0, 1], zz: [0, 1]}}",
            "robot.body.zz",
            "no such parameter",
        ),
        ("robot: {body: {x: [0, 1], y: [0, 1]}}", "robot.body.z", "required"),
        ("robot: {length: -1}", "robot.length", "greater than 0"),
        ("sensor: {blind_zone: {blow: 1}}", "sensor.blind_zone", "blow: no such parameter"),
        ("sensor: {blind_zone: automatic}", "sensor.blind_zone", "'auto' or 'none'"),
        ("sensor: {fov: {azimut: [0, 1]}}", "sensor.fov.azimut", "no such parameter"),
        ("sensor: {fov: {azimuth: [1, 0]}}", "sensor.fov", "azimuth must be [low, high] in radians"),
        ("sensor: {fov: {elevation: [-90, 90]}}", "sensor.fov", "elevation must be [low, high] in radians"),
        ("log: {transforms: [{parent: a, child: b, x: 1}]}", "log.transforms.0.x", "no such parameter"),
        ("log: {min_matched: 2}", "log.min_matched", "less than or equal to 1"),
        ("log: {stamps: bags}", "log.stamps", "'header' or 'bag'"),
        ("log: {lowest_elevation: {a.bag: low}}", "log.lowest_elevation.a.bag", "number"),
        ("scoring: {min_visible: {shar: 1}}", "scoring.min_visible.shar", "no such parameter"),
        ("scoring: {domain: {x_min: 1}}", "scoring.domain.r_max", "required"),
        ("scoring: {iou: 0}", "scoring.iou", "greater than 0"),
        ("grid: {k: []}", "grid.k", "no values; give at least one"),
        ("grid: {k: }", "grid.k", "no values; give at least one"),
        ("grid: {kk: [1]}", "grid.kk", "did you mean detector.k?"),
        ("grid: {detector.kk: [1]}", "grid.detector.kk", "did you mean detector.k?"),
        ("grid: {patch.depth: [1]}", "grid.patch.depth", "no such parameter"),
        ("grid: {robot_frame: [a, b]}", "grid.robot_frame", "only detector and crossing"),
        ("grid: {scoring.iou: [0.5]}", "grid.scoring.iou", "only detector and crossing"),
        ("grid: {ground_z: [0]}", "grid.ground_z", "only detector and crossing"),
        ("grid: {k: [5], detector.k: [6]}", "grid.detector.k", "given twice"),
        ("grid: [k]", "grid", "expected `parameter: [values]`, found list"),
        ("- detector", "", "expected sections such as `detector:`, found list"),
        ("5", "", "expected sections such as `detector:`, found int"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_file_key_and_remedy(load, text, key, remedy):
    message = refusal(load, text)
    assert message.startswith(f"{load.path}: {key}")
    assert remedy.lower() in message.lower()


@pytest.mark.parametrize(
    "text", ["grid: {k: [5], k: [6]}", "detector: {k: 5, k: 6}", "detector:\ndetector:\n"]
)
def test_a_key_that_is_there_twice_is_refused(load, text):
    assert str(load.path) in refusal(load, text)


@pytest.mark.parametrize(
    ("text", "line"),
    [("detector:\n  k: [5\n", 3), ("a: 1\nb: c: 2\n", 2), ("detector:\n\tk: 1\n", 2), ("a: *nothing\n", 1)],
)
def test_invalid_yaml_is_refused_with_its_line(load, text, line):
    assert refusal(load, text).startswith(f"{load.path}:{line}: not valid YAML: ")


def test_a_file_that_cannot_be_read(tmp_path, load):
    assert refusal(load_config, tmp_path / "none.yaml").startswith(
        f"{tmp_path / 'none.yaml'}: cannot be read"
    )
    assert refusal(load_config, tmp_path).startswith(f"{tmp_path}: cannot be read")
    load.path.write_bytes(b"\xff\xfe\x00a")
    assert refusal(load_config, load.path).startswith(f"{load.path}: cannot be read")


@pytest.mark.parametrize(
    ("assignment", "key", "remedy"),
    [
        ("k", "-p k", "expected key=value"),
        ("=5", "-p =5", "expected key=value"),
        ("k=", "-p k=", "no value"),
        ("k=[5", "-p k=[5", "cannot read the value"),
        ("kk=3", "-p kk", "did you mean detector.k?"),
        ("detector.kk=3", "-p detector.kk", "did you mean detector.k?"),
        ("grid.k=3", "-p grid.k", "no such parameter"),
        ("fov.azimuth=[0, 1]", "-p fov.azimuth", "no such parameter"),
        ("robot_frame=a,b", "-p robot_frame=a,b", "takes one value"),
        ("scoring.iou=0.5,0.6", "-p scoring.iou=0.5,0.6", "takes one value"),
        ("delta_r=1", "detector.delta_r", "greater than 1 (got 1)"),
        ("k=six", "detector.k", "integer"),
        ("x_min=3", "detector", "nothing of r_max 3.0"),
    ],
)
def test_a_bad_option_is_refused_in_one_line_that_names_it_and_the_remedy(load, assignment, key, remedy):
    for message in (refusal(load_config, None, [assignment]), refusal(load, "", assignment)):
        assert "-p" in message
        assert key in message
        assert remedy in message


def test_a_name_that_is_not_unique_must_be_dotted():
    homes = {}
    for section in set(Config.model_fields) - {"grid"}:
        for name in type(getattr(Config(), section)).model_fields:
            homes.setdefault(name, []).append(f"{section}.{name}")
    for name, keys in homes.items():
        if len(keys) == 1:
            assert dotted_key(name) == keys[0]
        else:
            assert all(key in refusal(dotted_key, name) for key in keys)


def test_names_are_found_in_their_sections():
    assert dotted_key("delta_r") == "detector.delta_r"
    assert dotted_key("uniform") == "crossing.uniform"
    assert dotted_key("detector.patch.depth") == "detector.patch.depth"
    assert dotted_key("sensor.blind_zone.below") == "sensor.blind_zone.below"


# --- who wins ----------------------------------------------------------------------------------------

FILE = "log: {robot_frame: file, max_tf_gap: 2}\ndetector: {k: 4, n_o: 3, pl_th: 0.3}\n"


def test_explicit_options_win_over_p_over_the_file_over_defaults(load):
    found = load(FILE, "robot_frame=p", "k=5", log__robot_frame="explicit")
    assert (found.log.robot_frame, found.detector.k) == ("explicit", 5)
    assert (found.detector.n_o, found.detector.pl_th, found.log.max_tf_gap) == (3, 0.3, 2.0)
    assert found.detector.delta_r == Detector().delta_r
    assert load(FILE, "robot_frame=p").log.robot_frame == "p"
    assert load(FILE).log.robot_frame == "file"
    assert load().log.robot_frame is None


def test_an_explicit_option_that_was_not_given_wins_over_nothing(load):
    assert load(FILE, log__robot_frame=None).log.robot_frame == "file"


def test_an_explicit_option_can_be_refused(load):
    assert "log.min_matched" in refusal(load, FILE, log__min_matched=3)


def test_p_sets_sections_and_nested_values(load):
    domain = "scoring.domain={x_min: 1, r_max: 4}"
    found = load("", domain, "detector.patch.depth=2", "sensor.fov.azimuth=[-1, 1]", "body=null")
    assert found.scoring.domain == Domain(x_min=1, r_max=4)
    assert found.detector.patch == Patch(depth=2)
    assert found.sensor.fov == FieldOfView(azimuth=(-1, 1))
    kept = load("detector: {patch: {width: 3}}", "detector.patch.depth=2").detector.patch
    assert kept == Patch(depth=2, width=3)


@pytest.mark.parametrize("zone", ["", "auto", "none", "{below: -0.5}"])
def test_p_gives_a_blind_zone_whatever_the_file_says(load, zone):
    text = f"sensor: {{blind_zone: {zone}}}" if zone else ""
    found = load(text, "sensor.blind_zone.below=-0.3")
    assert found.sensor.blind_zone == BlindBelow(below=-0.3)


def test_several_values_of_p_are_a_grid_one_value_ends_it(load):
    assert load("grid: {k: [4, 5]}", "n_o=0,1").grid == {"detector.k": [4, 5], "detector.n_o": [0, 1]}
    assert load("grid: {k: [4, 5]}", "k=6,7").grid == {"detector.k": [6, 7]}
    one = load("grid: {k: [4, 5]}", "k=6")
    assert (one.grid, one.detector.k) == ({}, 6)
    assert load("", "uniform=area,kdtree").grid == {"crossing.uniform": ["area", "kdtree"]}


def test_of_two_p_the_last_wins(load):
    assert load("", "k=4", "k=5").detector.k == 5
    assert load("", "k=4,5", "k=6").grid == {}
    assert load("", "k=4,5", "detector.k=6,7").grid == {"detector.k": [6, 7]}


def test_empty_files_and_sections_are_the_defaults(load):
    assert load() == load("detector:\ngrid:\n") == load("# nothing\n") == Config() == load_config(None)


def test_set_parameter_leaves_the_original_alone():
    values = {"detector": {"patch": {"depth": 1}}, "robot": {}}
    changed = set_parameter(values, "detector.patch.depth", 2)
    assert changed == {"detector": {"patch": {"depth": 2}}, "robot": {}}
    assert values == {"detector": {"patch": {"depth": 1}}, "robot": {}}


# --- through YAML ------------------------------------------------------------------------------------


def floats(low, high):
    return st.floats(low, high, exclude_min=True)


def intervals(limit):
    return st.tuples(st.floats(-limit, limit), st.floats(-limit, limit)).map(sorted).map(tuple)


def ordered(limit):
    return intervals(limit).filter(lambda pair: pair[0] < pair[1])


NAMES = st.none() | st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=8)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=8)
DETECTORS = st.builds(
    Detector,
    k=st.integers(1, 12),
    i_height=st.none() | st.integers(2, 4097),
    i_width=st.none() | st.integers(2, 4097),
    delta_r=floats(1, 1000),
    n_o=st.integers(0, 50),
    pl_th=floats(0, 10),
    x_min=st.floats(0, 5),
    r_max=st.floats(5.5, 100),
    z_min=floats(0, 10) | st.just(math.inf),
    z_max=floats(0, 10),
    origin=st.sampled_from(["sensor", "robot"]),
    plane=st.sampled_from(["robot", "patch"]),
    patch=st.builds(Patch, depth=floats(0, 3), max_tilt=st.floats(0.01, 1.5), min_points=st.integers(3, 99)),
    edge=st.sampled_from(["data", "zero"]),
    kernel=st.sampled_from(["rect", "cross"]),
)
CROSSINGS = st.builds(
    CrossingRules,
    d_r=st.none() | floats(0, 3),
    standoff=st.none() | st.floats(0, 3),
    eta=st.none() | floats(0, 3),
    clearance=st.none() | st.floats(0, 3),
    uniform=st.sampled_from(["area", "kdtree"]),
    rules=st.sampled_from(["all", "paper"]),
    min_observed=st.floats(0, 1),
)
ROBOTS = st.builds(
    Robot,
    length=floats(0, 9),
    width=floats(0, 9),
    ground_z=st.floats(-2, 2),
    body=st.none() | st.builds(BodyBox, x=intervals(3), y=intervals(3), z=intervals(3)),
)
SENSORS = st.builds(
    Sensor,
    blind_zone=st.sampled_from(["auto", "none"]) | st.builds(BlindBelow, below=st.floats(-1.5, 1.5)),
    fov=st.none() | st.builds(FieldOfView, azimuth=ordered(3.1), elevation=ordered(1.5)),
)
LOGS = st.builds(
    LogSection,
    cloud_topic=NAMES,
    fixed_frame=NAMES,
    transforms=st.lists(st.builds(StaticTransform, parent=TEXT, child=TEXT), max_size=2).map(tuple),
    max_tf_gap=floats(0, 9),
    stamps=st.sampled_from(["header", "bag"]),
    lowest_elevation=st.dictionaries(TEXT, st.floats(-1.57, 0), max_size=2),
)
SCORINGS = st.builds(
    Scoring,
    domain=st.none() | st.builds(Domain, x_min=st.floats(0, 3), r_max=floats(0, 99)),
    iou=floats(0, 1),
    min_visible=st.builds(MinVisible, share=st.floats(0, 1), area=st.floats(0, 9)),
)
GRIDS = st.fixed_dictionaries(
    {},
    optional={
        "detector.k": st.lists(st.integers(1, 12), min_size=1, max_size=3),
        "detector.delta_r": st.lists(floats(1, 1000), min_size=1, max_size=3),
        "detector.z_min": st.lists(floats(0, 9) | st.just(math.inf), min_size=1, max_size=2),
        "detector.patch.depth": st.lists(floats(0, 3), min_size=1, max_size=2),
        "crossing.uniform": st.lists(st.sampled_from(["area", "kdtree"]), min_size=1, max_size=2),
        "crossing.eta": st.lists(st.none() | floats(0, 3), min_size=1, max_size=2),
    },
)
POINTS = st.builds(Configuration, detector=DETECTORS, crossing=CROSSINGS, robot=ROBOTS, sensor=SENSORS)
CONFIGS = st.builds(
    Config,
    grid=GRIDS,
    detector=DETECTORS,
    crossing=CROSSINGS,
    robot=ROBOTS,
    sensor=SENSORS,
    log=LOGS,
    scoring=SCORINGS,
)


@settings(RANDOM)
@given(CONFIGS)
def test_a_configuration_comes_back_equal_from_yaml(tmp_path_factory, config):
    path = tmp_path_factory.mktemp("config") / "config.yaml"
    path.write_text(config.to_yaml(), encoding="utf-8")
    again = load_config(path)
    assert again == config
    assert list(again.grid) == list(config.grid)
    ids = [configuration.id for configuration in configurations(config)]
    assert [configuration.id for configuration in configurations(again)] == ids


def test_the_committed_configurations_are_valid(request):
    folder = request.config.rootpath / "configs"
    found = {path.name: load_config(path) for path in folder.glob("*.yaml")}
    assert found["paper.yaml"].detector == Detector(
        k=6, n_o=1, delta_r=1.1, pl_th=0.1, x_min=0.6, z_max=2.0, r_max=3.0
    )
    assert found["paper.yaml"].robot.ground_z == -0.0705


# --- ids ---------------------------------------------------------------------------------------------


@settings(RANDOM)
@given(POINTS, st.randoms(use_true_random=False))
def test_ids_are_12_hex_digits_and_do_not_depend_on_the_order_of_keys(configuration, chance):
    assert re.fullmatch("[0-9a-f]{12}", configuration.id)

    def shuffled(value):
        if not isinstance(value, dict):
            return value
        items = [(key, shuffled(inner)) for key, inner in value.items()]
        return dict(chance.sample(items, len(items)))

    assert Configuration.model_validate(shuffled(configuration.model_dump())).id == configuration.id


@settings(RANDOM)
@given(POINTS, POINTS)
def test_other_parameters_have_another_id(one, other):
    assert (one.id == other.id) == (one.parameters == other.parameters)


def test_an_id_is_of_the_canonical_parameters_with_their_keys_sorted():
    text = json.dumps(Configuration().parameters, sort_keys=True, separators=(",", ":"))
    assert text.startswith('{"crossing":{"clearance":0.25,"d_r":0.34,"eta":null,')
    assert Configuration().id == hashlib.sha256(text.encode()).hexdigest()[:12]


def changed(**detector):
    return Configuration(detector=Detector(**detector)).id


def test_k_and_the_resolution_spelled_out_are_the_same():
    assert changed(k=6) == changed(i_height=65, i_width=65) == changed(k=3, i_height=65, i_width=65)
    assert changed(k=6) == changed(k=6, i_height=65)
    assert len({changed(k=6), changed(k=5), changed(i_height=65, i_width=64), changed(k=5, i_width=64)}) == 4
    assert Detector(k=5, i_height=9).width == 33
    assert Detector(k=5, i_height=9).height == 9


@pytest.mark.parametrize(
    "change",
    [
        {"detector": {"pl_th": 0.1 + 1e-16 * 8}},
        {"detector": {"patch": {"width": 2}}},
        {"crossing": {"eta": 1.0}},
        {"robot": {"ground_z": 0.1}},
        {"robot": {"body": {"x": [0, 1], "y": [0, 1], "z": [0, 1]}}},
        {"sensor": {"blind_zone": "none"}},
        {"sensor": {"fov": {}}},
    ],
)
def test_every_parameter_is_in_the_id(change):
    assert Configuration.model_validate(change).id != Configuration().id


def test_a_distance_left_open_is_its_default_spelled_out():
    robot = Robot(length=1.0, width=0.5)
    left_open = Configuration(robot=robot)
    spelled = Configuration(robot=robot, crossing=CrossingRules(d_r=0.5, standoff=0.5, clearance=0.25))
    assert left_open.id == spelled.id
    assert left_open.id != Configuration(robot=robot, crossing=CrossingRules(d_r=0.34)).id
    assert left_open.id != Configuration(robot=robot, crossing=CrossingRules(eta=0.5)).id


def test_integers_and_floats_that_are_equal_have_equal_ids():
    assert changed(r_max=3, x_min=1) == changed(r_max=3.0, x_min=1.0)


# --- grids -------------------------------------------------------------------------------------------


def test_the_last_key_of_a_grid_varies_fastest(load):
    found = configurations(load("grid: {n_o: [2, 0], k: [5, 4], eta: [1, null]}"))
    listed = [(c.detector.n_o, c.detector.k, c.crossing.eta) for c in found]
    assert listed == [(n, k, e) for n in (2, 0) for k in (5, 4) for e in (1.0, None)]


def test_a_single_value_needs_no_list(load):
    assert [c.detector.k for c in configurations(load("grid: {k: 5}"))] == [5]


def test_combinations_that_mean_the_same_are_one_configuration(load):
    assert len(configurations(load("grid: {k: [5, 6, 5], n_o: [1, 1]}"))) == 2
    assert len(configurations(load("detector: {i_height: 9, i_width: 9}\ngrid: {k: [5, 6]}"))) == 1
    assert len(configurations(load("grid: {k: [3], i_height: [null, 9], i_width: [null, 9]}"))) == 1


@settings(RANDOM)
@given(CONFIGS)
def test_a_grid_is_every_combination_once(config):
    found = configurations(config)
    count = math.prod(len(values) for values in config.grid.values())
    assert 1 <= len(found) <= count
    assert len({configuration.id for configuration in found}) == len(found)
    growths = config.grid.get("detector.delta_r", [config.detector.delta_r])
    assert {configuration.detector.delta_r for configuration in found} == set(growths)


def test_without_a_grid_there_is_one_configuration(load):
    config = load("detector: {k: 4}\nrobot: {ground_z: 1}\nsensor: {blind_zone: none}\ncrossing: {eta: 2}")
    (found,) = configurations(config)
    assert found == the_one(config) == config.base
    assert (found.detector.k, found.robot.ground_z, found.sensor.blind_zone) == (4, 1.0, "none")
    assert found.crossing.eta == 2.0


def test_a_combination_that_cannot_be_is_refused(load):
    message = refusal(configurations, load("grid: {delta_r: [1.1, 1], n_o: [0]}"))
    assert message.startswith("grid (detector.delta_r=1, detector.n_o=0): detector.delta_r: ")
    message = refusal(configurations, load("grid: {x_min: [0.5, 2], r_max: [3, 1]}"))
    assert "detector.x_min=2" in message
    assert "leaves nothing of r_max 1.0" in message


def test_detect_runs_one_configuration(load):
    message = refusal(the_one, load("grid: {k: [5, 6], n_o: [1], delta_r: [1.1, 2]}"))
    assert message == (
        "the grid has 4 configurations; detect runs one: choose k, delta_r with -p, or use sweep"
    )


def test_a_box_that_is_empty_only_without_its_grid_is_no_error(load):
    config = load("grid: {r_max: [3, 10]}\ndetector: {x_min: 2}")
    assert [c.detector.r_max for c in configurations(config)] == [3.0, 10.0]


def test_the_documented_file_is_valid(load):
    text = """
grid:                         # every combination is evaluated; any detector or crossing parameter
  k: [5, 6, 7]
  n_o: [0, 1, 2]
  delta_r: [1.05, 1.1, 2.0]
  pl_th: [0.05, 0.1, 0.15]
detector: {x_min: 0.6, z_max: 2.0, r_max: 3.0}
robot: {length: 0.68, width: 0.5, ground_z: -0.0705}
log: {robot_frame: base_link, fixed_frame: map}
scoring: {iou: 0.5, hit_coverage: 0.5}
"""
    config = load(text)
    assert len(configurations(config)) == 81
    assert yaml.safe_load(config.to_yaml())["grid"]["detector.k"] == [5, 6, 7]


def test_a_distance_that_is_spelled_out_is_the_same_configuration():
    spelled = CrossingRules(d_r=0.34, standoff=0.34, clearance=0.25)
    assert Configuration(crossing=spelled).id == Configuration().id
    assert Configuration(robot=Robot(length=1.0)).parameters["crossing"]["d_r"] == 0.5


def test_a_next_line_character_comes_back_from_yaml(tmp_path) -> None:
    config = Config(log=LogSection(robot_frame="a\x85b"))
    path = tmp_path / "c.yaml"
    path.write_text(config.to_yaml(), encoding="utf-8", newline="")
    assert load_config(path) == config
