"""What is run on what: configurations, logs, what is made anew, which claims stay."""

import json
from pathlib import Path

import pytest

from gapeval.config import Robot
from gapeval.errors import ConfigError
from gapeval.simulate.layouts import ROUGH
from gapeval.simulate.sensors import SENSORS
from gapeval.studies.cases import Given, cases_of, plan_runs
from gapeval.studies.claims import Judged
from gapeval.studies.definition import Quick, Run, Study, quickly
from gapeval.studies.folder import about, write_claims
from gapeval.studies.logs import LOGS, MADE_BY, _made_by, missing, place
from gapeval.sweep.grid import configurations

GIVEN = Given(Path("mine.mcap"), Path("mine.geojson"))


def planned(run: Run, user: dict, given: Given | None = None, **study: object):
    texts = dict.fromkeys(("title", "paper", "question", "says"), "")
    return plan_runs("s", Study(**texts, runs=(run,), **study), user, given)[0]


def test_the_run_wins_over_the_user_and_the_user_over_the_study_and_that_over_the_robot() -> None:
    of = {"n_o": 1, "pl_th": 0.11, "x_min": 0.5}
    user = {"detector": {"pl_th": 0.12, "x_min": 0.6}, "robot": {"ground_z": -0.123}}
    run = Run(scenes=("plain",), config={"detector": {"x_min": 0.7}}, sensor="vlp16")
    one = planned(run, user, config={"detector": of}).config
    assert (one.detector.n_o, one.detector.pl_th, one.detector.x_min) == (1, 0.12, 0.7)
    assert one.robot.ground_z == -0.123
    assert one.robot.model_copy(update={"ground_z": 0.0}) == SENSORS["vlp16"].robot.model_copy(
        update={"ground_z": 0.0}
    )
    assert planned(run, {}).config.robot == SENSORS["vlp16"].robot != Robot()
    assert planned(run, {}, GIVEN).config.robot == Robot()


def test_grids_are_the_run_s_or_the_study_s_with_the_user_s_values() -> None:
    run = Run(scenes=("plain",), grid={"k": [5, 6]})
    user = {"grid": {"detector.k": [7], "detector.n_o": [0]}}  # as it is read

    def grid(run: Run, user: dict) -> list[tuple[int, int]]:
        found = configurations(planned(run, user, grid={"n_o": [1, 2, 3]}).config)
        return [(one.detector.k, one.detector.n_o) for one in found]

    usual = planned(run, {}).config.detector
    assert grid(run, {}) == [(5, usual.n_o), (6, usual.n_o)]
    assert grid(run, user) == [(7, usual.n_o)]  # n_o is not varied here
    assert grid(Run(scenes=("plain",)), user) == [(usual.k, 0)]


def test_every_scene_seed_and_combination_has_a_log_of_its_own() -> None:
    vary = {"roughness": [0.0, 0.03], "density": [0.5, 1.0], "obstacles": [True, False], "slope": [0.0, 0.1]}
    cases = cases_of(Run(scenes=("plain", "street"), seeds=2, vary=vary), None)
    assert len(cases) == 2 * 2 * 2**4
    folders = {place(case, Path("out")).log.parent for case in cases}
    assert len(folders) == len({case.source for case in cases}) == len({case.name for case in cases}) == 64
    for case in cases:
        known = dict(case.conditions)
        assert case.source.scene == case.scene
        assert case.source.seed == case.seed
        for key in ("density", "obstacles", "slope"):
            assert getattr(case.source.variation, key) == known[key]


def test_poses_err_as_conditions_say() -> None:
    vary = {"pitch": [0.0, 0.1], "height": [0.02], "tilt_noise": [0.01, 0.02], "height_noise": [0.005]}
    cases = cases_of(Run(scenes=("plain", "street"), seeds=2, vary=vary), None)
    draws: dict[tuple[str, int], set[int]] = {}
    for case in cases:
        known, settings = dict(case.conditions), case.settings(planned(Run(scenes=("plain",)), {}).config.log)
        error, noise = settings.pose_error, settings.pose_noise
        assert (error.roll, error.pitch, error.height) == (0.0, known["pitch"], 0.02)
        assert (noise.roll, noise.pitch, noise.height) == (known["tilt_noise"], known["tilt_noise"], 0.005)
        draws.setdefault((case.scene, case.seed), set()).add(noise.seed)
    assert all(len(seeds) == 1 for seeds in draws.values())  # the same under all conditions
    assert len(set().union(*draws.values())) == len(draws) == 4  # ... but not of all logs
    assert len({case.name for case in cases}) == len(cases)


def test_conditions_are_told_also_where_a_log_is_as_it_is() -> None:
    run = Run(
        scenes=("plain",), seeds=1, vary={"density": [0.5], "roll": [0.0, 0.1]}, conditions={"kind": "x"}
    )
    simulated, given = cases_of(run, None), cases_of(run, GIVEN)
    assert [dict(case.conditions) for case in simulated] == [
        {"sensor": "lms151", "density": 0.5, "kind": "x", "roll": roll} for roll in (0.0, 0.1)
    ]
    assert [dict(case.conditions) for case in given] == [
        {"sensor": "its own", "density": 1.0, "kind": "x", "roll": roll} for roll in (0.0, 0.1)
    ]
    assert {case.source for case in given} == {GIVEN}


def test_quick_runs_less_and_changes_nothing_else() -> None:
    quick = Quick(scenes=("street",), seeds=3, frames=2, vary={"roll": [0.1]}, grid={"k": [6]})
    run = Run(
        name="r", scenes=("plain", "tunnel"), seeds=2, frames=9, grid={"k": [5, 6], "n_o": [0, 1]},
        vary={"roll": [0.0, 0.1], "pitch": [0.0, 0.2]}, quick=quick, gaps=True,
    )  # fmt: skip
    found = quickly(run)
    assert (found.scenes, found.seeds, found.frames) == (("street",), 2, 2)
    assert found.vary == {"roll": [0.1], "pitch": [0.0, 0.2]}
    assert found.grid == {"k": [6], "n_o": [0, 1]}
    assert found.gaps
    plain = quickly(run.model_copy(update={"quick": Quick()}))
    assert (plain.scenes, plain.frames, plain.vary, plain.grid) == (run.scenes, 9, run.vary, run.grid)
    assert plain.seeds == 1


def test_logs_of_another_simulator_are_made_anew(tmp_path) -> None:
    cases = cases_of(Run(scenes=("plain",), seeds=3), None)
    recipes = [case.source for case in cases]
    assert missing([*cases, *cases], tmp_path) == recipes
    for recipe, text in zip(
        recipes, (_made_by(), _made_by().replace('"source": "', '"source": "0')), strict=False
    ):
        folder = tmp_path / LOGS / recipe.name
        folder.mkdir(parents=True)
        (folder / MADE_BY).write_text(text)
    assert missing(cases, tmp_path) == recipes[1:]


def judged(study: str, words: str = "") -> Judged:
    return Judged(study, "it", "1", words, "", "holds", "", "", "", "")


def claims(folder: Path) -> list[str]:
    return [line.split(",")[0] for line in (folder / "claims.csv").read_text().splitlines()[1:]]


def test_claims_stay_beside_those_of_the_same_inputs_only(tmp_path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"a")
    (tmp_path / "l.geojson").write_bytes(b"l")
    given = Given(tmp_path / "a.mcap", tmp_path / "l.geojson")
    usual = about({}, None, False)
    of_log = about({}, given, False)
    (tmp_path / "l.geojson").write_bytes(b"m")
    labelled_anew = about({}, given, False)
    (tmp_path / "a.mcap").rename(tmp_path / "b.mcap")
    renamed = about({}, Given(tmp_path / "b.mcap", given.labels), False)
    others = [
        about({}, None, True), about({"k": 5}, None, False), of_log, labelled_anew, renamed,
        usual | {"scorer": usual["scorer"] + 1}, usual | {"gapeval": "0"}, usual | {"versions": {}},
    ]  # fmt: skip
    assert len({json.dumps(one) for one in (usual, *others)}) == 9
    for other in others:
        write_claims(tmp_path, usual, "zeta", [judged("zeta")])
        assert claims(tmp_path) == ["zeta"]
        for name in ("timing", "delta_r"):
            write_claims(tmp_path, usual, name, [judged(name)])
        assert claims(tmp_path) == ["delta_r", "timing", "zeta"]
        write_claims(tmp_path, other, "delta_r", [judged("delta_r")])
        assert claims(tmp_path) == ["delta_r"]


def test_the_scorer_is_part_of_what_claims_are_made_from() -> None:
    assert {"gapeval", "scorer", "versions", "quick", "log", "inputs", "configuration"} == set(
        about({}, None, False)
    )


def test_claims_of_a_study_that_is_run_again_are_replaced(tmp_path) -> None:
    made = about({}, None, False)
    for name in ("delta_r", "mine"):
        write_claims(tmp_path, made, name, [judged(name, "first")])
    write_claims(tmp_path, made, "mine", [judged("mine", "second")])
    text = (tmp_path / "claims.csv").read_text()
    assert claims(tmp_path) == ["delta_r", "mine"]
    assert text.count("first") == text.count("second") == 1


def test_a_study_of_scenes_alone_cannot_be_run_on_a_log() -> None:
    with pytest.raises(ConfigError, match="study s: makes sense on simulated scenes only; leave --log out"):
        planned(Run(scenes=("plain",), simulated=True), {}, GIVEN)


def test_the_usual_roughness_is_the_usual_log() -> None:
    varied = cases_of(Run(scenes=("plain",), seeds=1, vary={"roughness": [ROUGH]}), None)
    usual = cases_of(Run(scenes=("plain",), seeds=1), None)
    assert [case.source for case in varied] == [case.source for case in usual]
