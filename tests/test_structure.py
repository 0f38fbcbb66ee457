"""Data flows one way: a module imports only from those below it."""

import ast
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "gapeval"

# From top to bottom, as in CONTRIBUTING.md.
FLOORS = [
    "cli",
    "report",
    "studies",
    "compare",
    "results",
    "sweep",
    "scoring",
    "traversability",
    "detection",
    "visibility",
    "simulate",
    "labels",
    "detections",
    "logs",
    "frame",
    "config",
    "ragged",
    "share",
    "files",
    "errors",
]


def imports(path: Path) -> set[str]:
    """The rooms of gapeval that a module imports from."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module] if node.module != "gapeval" else [f"gapeval.{a.name}" for a in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        found |= {name.split(".")[1] for name in names if name.startswith("gapeval.")}
    return found - {"__version__"}


def test_every_room_is_on_the_plan() -> None:
    rooms = {
        path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert rooms - {"__init__", "__main__"} == set(FLOORS)


def test_modules_import_only_from_below() -> None:
    upwards = [
        f"{path.relative_to(PACKAGE)} imports gapeval.{room}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if (home := path.relative_to(PACKAGE).parts[0].removesuffix(".py")) in FLOORS
        for room in sorted(imports(path))
        if FLOORS.index(room) < FLOORS.index(home)
    ]
    assert upwards == []


def test_help_imports_nothing_heavy() -> None:
    """`gapeval --help` must answer at once."""
    code = "import sys, gapeval.cli; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {
        "numpy",
        "cv2",
        "shapely",
        "pydantic",
        "yaml",
        "scipy",
        "rosbags",
        "mcap",
        "pandas",
        "matplotlib",
        "jinja2",
        "tqdm",
        "filelock",
        "distributed",
    }
    assert heavy.isdisjoint(loaded)


def test_reading_a_log_goes_from_files_to_messages_to_frames() -> None:
    """What messages say does not depend on the files they stand in, nor either on what is made of them."""
    may_use = {"messages": {"container", "messages"}, "containers": {"container", "messages", "containers"}}
    folder = PACKAGE / "logs" / "read"
    wrong = [
        f"{path.relative_to(folder)} imports {name}"
        for room, allowed in may_use.items()
        for path in sorted((folder / room).glob("*.py"))
        for name in sorted(imported_from(path, "gapeval.logs.read."))
        if name not in allowed
    ]
    assert wrong == []


def imported_from(path: Path, package: str) -> set[str]:
    """The modules and folders of a package that a module imports from."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
    names = {f"{node.module}.{alias.name}" for node in nodes for alias in node.names}
    return {name.removeprefix(package).split(".")[0] for name in names if name.startswith(package)}
