"""gapeval info."""

import json
from pathlib import Path

import click

from gapeval.cli.options import PATH, configuration, log_options


@click.command()
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG...")
@log_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def info(logs: tuple[Path, ...], as_json: bool, **options: str) -> None:
    """What is in a log, and what gapeval would pick in it.

    Shows the container, topics with types and counts, the time span, the point layout and rate of each
    cloud topic, the tf tree, the default choices, and what was refused and why.

    \b
    Example:
      gapeval info drive.bag
      gapeval info --json drives/*.mcap
    """
    from gapeval.cli.reading import say
    from gapeval.errors import LogError
    from gapeval.logs.read import describe, render

    settings = configuration(**options).log  # type: ignore[arg-type]
    descriptions, unreadable = [], []
    for path in logs:
        try:
            descriptions.append(describe(path, settings))
        except LogError as error:
            unreadable.append(error)
    if as_json:
        click.echo(json.dumps([description.to_dict() for description in descriptions], indent=2))
    elif descriptions:
        click.echo("\n\n".join(render(description) for description in descriptions))
    for failure in unreadable[:-1]:
        say(f"gapeval: {failure}")
    if unreadable:
        raise unreadable[-1]
    if settings.strict and (broken := [d.path for d in descriptions if d.losses]):
        raise LogError(f"{broken[0]}: not whole, as is said above; leave out --strict to use the rest")
