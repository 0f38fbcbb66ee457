"""What docs/ and the README say is what the code does."""

import re
from pathlib import Path

import pytest
from documentation import pages, walk

from gapeval.cli import cli
from gapeval.config import load_config
from gapeval.sweep.grid import configurations

ROOT = Path(__file__).parent.parent
COMMANDS = {" ".join(path): command for path, command in walk(cli, ("gapeval",))}


@pytest.mark.parametrize("page", sorted(path.name for path in pages()))
def test_made_pages_are_up_to_date(page: str) -> None:
    (expected,) = [text for path, text in pages().items() if path.name == page]
    assert (ROOT / "docs" / page).read_text() == expected, "run ./scripts/document"


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_with_an_example(name: str) -> None:
    command = COMMANDS[name]
    assert command.help
    if name != "gapeval labels":  # a group of commands, which have their own
        assert "Example:" in command.help
        assert f"{name} " in command.help


def test_readme_names_every_command() -> None:
    readme = (ROOT / "README.md").read_text()
    for name, command in COMMANDS.items():
        if not hasattr(command, "commands"):
            assert name in readme, name


@pytest.mark.parametrize(
    "page", sorted([*ROOT.glob("*.md"), *ROOT.glob("[a-z]*/*.md")]), ids=lambda p: p.name
)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.name)
def test_configurations_in_the_repository_can_be_used(path: Path) -> None:
    assert configurations(load_config(path))


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda p: p.name)
def test_what_scripts_measure_writes_has_been_written(page: Path) -> None:
    parts = re.findall(r"<!-- \w+: made by scripts/measure -->(.*?)<!-- end -->", page.read_text(), re.DOTALL)
    assert len(parts) == page.read_text().count("made by scripts/measure")
    assert all(part.count("\n| ") >= 3 for part in parts)
