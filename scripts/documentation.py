"""The parts of docs/ that are made from the code. Run as a program, it writes them."""

import re
from pathlib import Path
from typing import get_args

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gapeval.cli import cli
from gapeval.config import Config
from gapeval.results import tables
from gapeval.results.figures import FIGURES

DOCS = Path(__file__).parent.parent / "docs"
MADE = r"(<!-- {name}: made by scripts/{script} -->\n).*?(<!-- end -->)"


COMMANDS = """# Commands

This page is made from the commands' `--help` by `scripts/document`.

Results go to files or standard output, everything else to standard error. Exit status: 0 fine, 1 error,
2 usage (options, parameters, configuration), 130 interrupted. An error is one line; `gapeval --debug ...`
shows its traceback.
"""

CONFIGURATION = """# Configuration

This page is made from `gapeval/config.py` by `scripts/document`. A file may leave out everything; an
unknown key is an error. On the command line: `-p key=value`, dotted where the name is not unique
or nested (`-p scoring.domain.r_max=5`). Explicit options win over `-p`, `-p` over the file. Several values,
`-p k=5,6,7`, replace the grid's.
"""


def cell(text: object) -> str:
    """Text in a table of Markdown."""
    return str(text).replace("|", "\\|")


def commands() -> str:
    """Every command's --help."""
    pages = [COMMANDS]
    for path, command in walk(cli, ("gapeval",)):
        context = click.Context(command, info_name=" ".join(path), max_content_width=100, terminal_width=100)
        pages.append(f"## {' '.join(path)}\n\n```\n{command.get_help(context)}\n```\n")
    return "\n".join(pages)


def walk(command: click.Command, path: tuple[str, ...]) -> list[tuple[tuple[str, ...], click.Command]]:
    found = [(path, command)]
    if isinstance(command, click.Group):
        for name, child in sorted(command.commands.items()):
            found += walk(child, (*path, name))
    return found


def configuration() -> str:
    """Every section and parameter."""
    page = CONFIGURATION
    for name, field in Config.model_fields.items():
        if name == "grid":
            page += f"\n## grid\n\n{field.description}\n"
        else:
            page += "".join(section(name, model) for model in models_of(field))
    return page


def section(path: str, model: type[BaseModel]) -> str:
    rows, inner = [], ""
    for name, field in model.model_fields.items():
        inner += "".join(section(f"{path}.{name}", option) for option in models_of(field))
        if field.description:
            default = "required" if field.is_required() else "" if field.default is None else field.default
            rows.append(f"| `{name}` | {default} | {values(field)} | {cell(field.description)} |")
    about = model.__doc__.split("\n")[0]
    return (
        f"\n## {path}\n\n{about}\n\n| key | default | values | meaning |\n|---|---|---|---|\n"
        + "\n".join(rows)
        + f"\n{inner}"
    )


def values(field: FieldInfo) -> str:
    """What a parameter may be, where that is more than its type."""
    choices = [c for option in (field.annotation, *get_args(field.annotation)) for c in get_args(option)]
    named = [str(c) for c in choices if isinstance(c, str)]
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    extras = [
        *field.metadata,
        *(m for option in get_args(field.annotation) for m in getattr(option, "__metadata__", ())),
    ]
    limits = [
        f"{sign} {number:.4g}"
        for extra in extras
        for item in (extra, *getattr(extra, "metadata", ()))
        for name, sign in signs.items()
        if (number := getattr(item, name, None)) is not None
    ]
    return cell(", ".join(dict.fromkeys(named or limits)))


def models_of(field: FieldInfo) -> list[type[BaseModel]]:
    """The sections that a field may be."""
    options = (field.annotation, *get_args(field.annotation))
    return [one for one in options if isinstance(one, type) and issubclass(one, BaseModel)]


def metrics() -> str:
    rows = "\n".join(f"| `{m.name}` | {m.unit} | {m.better} | {cell(m.meaning)} |" for m in FIGURES.values())
    return f"| metric | unit | better | meaning |\n|---|---|---|---|\n{rows}\n"


def columns() -> str:
    parts, meanings = [], tables.meanings()
    for file, names in tables.FILES.items():
        here = meanings | tables.label_meanings() if file == tables.LABELS else meanings
        rows = "\n".join(f"| `{name}` | {cell(here[name])} |" for name in names)
        parts.append(f"## {file}\n\n| column | meaning |\n|---|---|\n{rows}\n")
    return "\n".join(parts)


def with_part(page: str, name: str, content: str, script: str = "document") -> str:
    """The page with its part of that name, which a script of scripts/ makes, made anew."""
    made, count = re.subn(
        MADE.format(name=name, script=script),
        lambda found: found[1] + "\n" + content + "\n" + found[2],
        page,
        flags=re.DOTALL,
    )
    assert count == 1, f"no part {name}"
    return made


def pages() -> dict[Path, str]:
    """What each page should be now."""
    scoring, results = DOCS / "scoring.md", DOCS / "results.md"
    return {
        DOCS / "commands.md": commands(),
        DOCS / "configuration.md": configuration(),
        scoring: with_part(scoring.read_text(), "metrics", metrics()),
        results: with_part(results.read_text(), "columns", columns()),
    }


if __name__ == "__main__":
    for page, text in pages().items():
        page.write_text(text)
