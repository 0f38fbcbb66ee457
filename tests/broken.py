"""Copies of gapeval with something in them changed, and what the real command does with them."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import gapeval

PACKAGE = Path(gapeval.__file__).parent
SAY_WHERE = (sys.executable, "-P", "-c", "import gapeval; print(gapeval.__file__)")


@dataclass(frozen=True, slots=True)
class Edit:
    """A replacement of text that a file of the package holds so many times."""

    file: str
    old: str
    new: str
    times: int = 1


def copy_with(edits: Sequence[Edit], folder: Path) -> Path:
    """A copy of the package below a folder, which is returned for PYTHONPATH."""
    shutil.copytree(PACKAGE, folder / "gapeval", ignore=shutil.ignore_patterns("__pycache__"))
    for edit in edits:
        path = folder / "gapeval" / edit.file
        text = path.read_text()
        found = text.count(edit.old)
        assert found == edit.times, (
            f"{edit.file} holds {edit.old!r} {found} times, not {edit.times}: mend the edit"
        )
        path.write_text(text.replace(edit.old, edit.new))
    return folder


def run_copy(folder: Path, command: Sequence[str]) -> None:
    """Run a command of Python with the package of this folder instead of ours; it must succeed."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    options = {"env": environment, "capture_output": True, "text": True, "timeout": 300}
    used = subprocess.run(SAY_WHERE, check=True, **options).stdout.strip()
    assert Path(used) == folder / "gapeval" / "__init__.py"
    done = subprocess.run(command, **options)
    assert done.returncode == 0, done.stderr
