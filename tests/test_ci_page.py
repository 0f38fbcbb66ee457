"""docs/ci.md: its commands are run in their order, and what it shows is what they say."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from command import Result, gapeval
from gate import COMMITTED

PAGE = (Path(__file__).parent.parent / "docs" / "ci.md").read_text()
PROSE = re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL)  # what is shown in blocks is said, not to be run
COMMANDS = [line[4:] for line in PROSE.splitlines() if line.startswith("    gapeval ")]


def block(after: str) -> str:
    """The first block of code after a text."""
    found = re.search(r"```\w*\n(.*?)```", PAGE[PAGE.index(after) :], re.DOTALL)
    assert found is not None
    return found[1]


def the_command(*words: str) -> str:
    """The one with all of these words, or the first of equal ones."""
    (found,) = {line for line in COMMANDS if all(word in line.split() for word in words)}
    return found


def run(command: str) -> Result:
    return gapeval(*shlex.split(command)[1:])


@pytest.fixture
def swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A team's repository after the second step."""
    monkeypatch.chdir(tmp_path)
    Path("ci").mkdir()
    Path("log").mkdir()
    shutil.copy(COMMITTED / "street" / "street.mcap", "log/drive.mcap")
    shutil.copy(COMMITTED / "street" / "labels.geojson", "ci")
    config = Path("ci/gate.yaml")
    config.write_text(block("<!-- gate.yaml -->"))
    assert run(SWEEP).status == 0
    assert run(MAKE).status == 0
    return config


SWEEP, MAKE, COMPARE = COMMANDS[0], COMMANDS[1], "gapeval compare ci/baseline.csv results/"


def test_the_first_commands_are_those_of_the_steps() -> None:
    assert [line.split()[1] for line in COMMANDS[:4]] == ["sweep", "baseline", "compare", "baseline"]
    assert COMMANDS[2] == COMPARE


def test_from_the_first_sweep_to_a_renewal(swept: Path) -> None:
    fine = run(COMPARE)
    assert (fine.status, fine.out.splitlines()[-1]) == (0, "fine: 2 rows, none worse")
    changed = swept.read_text().replace("ground_z: -0.1}", "ground_z: -0.15}")
    assert changed != swept.read_text()
    assert "`ground_z: -0.15`" in PAGE
    swept.write_text(changed)
    assert run(SWEEP).status == 0
    worse = run(COMPARE)
    assert worse.status == 3
    said = iter(worse.out.splitlines())
    for line in block("<!-- of compare -->").splitlines():
        assert line in said  # and those before it came before
    assert run(the_command("detect")).status == 0
    assert Path("frame.png").exists()
    renewal = the_command("baseline", "--reason")
    assert run(MAKE).status == 2  # without a reason
    assert run(renewal).status == 0
    again = run(COMPARE)
    assert again.status == 0
    assert shlex.split(renewal)[-1] in again.out


def test_limits_of_options_and_of_the_file_are_understood(swept: Path) -> None:
    swept.write_text(swept.read_text() + block("Limits that are to stay"))
    for command in (the_command("--max-drop", "pq=1%", "hit_rate=0.02"), the_command("--config", "compare")):
        assert run(command).status == 0


def test_times_are_held_against_limits_between_folders(swept: Path) -> None:
    for name in ("old", "new"):
        shutil.copytree("results", name)
    done = run(the_command("time=100%"))
    assert (done.status, done.err) == (0, "")
    assert run(f"{COMPARE} --max-rise time=100%").status == 2


def test_every_command_of_the_page_is_run_here() -> None:
    ran = {SWEEP, MAKE, COMPARE, the_command("baseline", "--reason"), the_command("time=100%")}
    ran |= {the_command("detect")}
    ran |= {the_command("--max-drop", "pq=1%", "hit_rate=0.02"), the_command("--config", "compare")}
    assert set(COMMANDS) == ran
