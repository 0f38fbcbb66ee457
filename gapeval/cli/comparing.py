"""Compare results for a command, and keep them as a baseline."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import click

from gapeval.cli.reading import say
from gapeval.compare import compare, marks
from gapeval.compare.baseline import is_baseline, read_history, write_baseline
from gapeval.compare.limits import Limits, read_limits
from gapeval.compare.outcome import Comparison
from gapeval.compare.side import Side, read_side
from gapeval.config import load_config
from gapeval.errors import ConfigError, GapevalError
from gapeval.files import make_folder, write_whole
from gapeval.report.comparisons import FORMATS
from gapeval.report.comparisons.github import step_summary
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.text import counted
from gapeval.results.store import MANIFEST
from gapeval.results.written import read_json

STEP_SUMMARY = "GITHUB_STEP_SUMMARY"  # a file that GitHub shows on the page of a run
MOST_OF_SUMMARY = 1 << 20  # bytes; GitHub shows nothing of what is larger
FIRST = "first"
WORDS = {"!": "worse", "+": "worse", "-": "better"}  # of the history: in how many rows each metric is so


def write_comparison(
    base: Path,
    new: Path,
    drops: Sequence[str],
    rises: Sequence[str],
    config_file: Path | None,
    form: str,
    output: Path | None,
) -> int:
    """Show it in a format; returns the exit status."""
    gate = load_config(config_file).compare
    limits = read_limits(drops, rises, gate.max_drop, gate.max_rise)
    one, other = read_side(base), read_side(new)
    if other.is_baseline and not one.is_baseline:
        raise ConfigError(f"{new}: is a baseline, which goes first: gapeval compare BASELINE RESULTS")
    _check_times(limits, (base, one), (new, other))
    found = compare(one, other, limits)
    text = FORMATS[form](found)
    if output is None or str(output) == "-":
        click.echo(text, nl=not text.endswith("\n"))
    else:
        make_folder(output.parent)
        write_whole(output, text.encode() if text.endswith("\n") else f"{text}\n".encode())
        say(verdict(found))
    summary = os.environ.get(STEP_SUMMARY)
    if form == "github" and summary:
        _append(Path(summary), found)
    return found.status


def _check_times(limits: Limits, *sides: tuple[Path, Side]) -> None:
    for path, side in sides:
        if limits.stages and not side.times:
            raise ConfigError(f"{path}: has no times to hold against a limit; name a folder of results")
    stages = dict.fromkeys(stage for _, side in sides for of_log in side.times.values() for stage in of_log)
    for stage in limits.stages:
        if stage not in stages:
            near = ", ".join(get_close_matches(stage, stages, 1) or list(stages)[1:])
            raise ConfigError(f"max_rise of time.{stage}: no such stage; there is {near}")


def _append(path: Path, found: Comparison) -> None:
    """To what is shown of the step. Where that cannot be done, the verdict stands all the same."""
    try:
        with path.open("a", encoding="utf-8") as file:
            text = step_summary(found, MOST_OF_SUMMARY - path.stat().st_size)
            file.write(text)
    except OSError as error:
        say(f"{path}: no summary of the step: {error.strerror}; see ${STEP_SUMMARY}")
        return
    if not text:
        say(f"{path}: no summary of the step: it is full, with {MOST_OF_SUMMARY} bytes")


def renew_baseline(folder: Path, output: Path, reason: str | None, with_frames: bool) -> None:
    """Write a baseline, or renew one."""
    folder = folder.parent if folder.is_file() else folder
    results = read_side(folder)
    manifest = read_json(folder / MANIFEST)
    if results.failed:
        why = next(iter(results.failed.values()))
        raise GapevalError(f"{folder}: {why}; mend that and sweep again before it can be a baseline")
    if results.scoring is None:
        raise GapevalError(f"{folder}: {MANIFEST} does not say how it was scored; run what made it again")
    made_by = {name: manifest.get(name) for name in ("gapeval", "revision", "source")}
    reason = (reason or "").strip()
    entry: dict[str, Any] = {"reason": reason or FIRST} | made_by
    history: list[Mapping[str, Any]] = []
    if output.exists():
        history += _history(output)
        if not reason:
            raise ConfigError(f"{output}: say why it is renewed: --reason TEXT goes into its history")
        entry |= _renewed(output, results)
    history.append(entry)
    make_folder(output.parent)
    frames = write_baseline(output, folder, manifest, history, with_frames)
    configurations = len({row["configuration"] for row in results.rows})
    say(
        f"wrote {output}: {counted(configurations, 'configuration')} on {counted(len(results.logs), 'log')}, "
        f"{counted(frames, 'row')} of frames, {output.stat().st_size / 1e6:.2f} MB"
    )


def _history(output: Path) -> tuple[Mapping[str, Any], ...]:
    if output.is_dir() or not is_baseline(output):
        raise GapevalError(f"{output}: exists and is no baseline; name another file with -o")
    return read_history(output)


def _renewed(output: Path, results: Side) -> dict[str, Any]:
    """What is otherwise now, for the history; nothing if the old figures cannot be read any more."""
    try:
        found = compare(read_side(output), results, Limits({}, {}))
    except GapevalError as error:
        say(f"{error}; it is renewed without being compared")
        return {}
    say(f"{output}: renewed; {verdict(found)}")
    changed = Counter(
        (WORDS[change.mark], change.metric)
        for row in found.rows
        for change in row.changes
        if change.mark in WORDS
    )
    rows = {"rows": {mark: count for mark, count in marks(found).items() if mark != " "}}
    counts: dict[str, dict[str, int]] = {}
    for (word, metric), count in changed.most_common():
        counts.setdefault(word, {})[metric] = count
    return rows | counts
