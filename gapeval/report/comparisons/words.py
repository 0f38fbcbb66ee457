"""The words that all formats share for what a comparison found."""

import math
from collections.abc import Sequence

from gapeval.compare.outcome import Change, LabelChange, Noise, Row
from gapeval.report.text import counted, short
from gapeval.results.figures import FIGURES
from gapeval.scoring.metrics import COUNTS

UNITS = {figure.name: figure.unit for figure in FIGURES.values() if figure.unit != "1"}
ROWS = 8  # that are shown to people in detail
LABELS = 10  # of a row whose changes are shown to people
RUNS = 8  # of frames that are named
DIGITS = 17  # tell any two floats apart
# Metrics that say what another one says: 1 - coverage, and f1 by its name in panoptic quality. People are
# told once, unless a limit of its own makes the mark another; what programs read has both.
MIRRORS = {"under_coverage": "coverage", "rq": "f1"}


def plain(text: str) -> str:
    """Text on one line that is no command to a terminal and legal in XML: `\\n` and `\\x1b` are spelt out."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def parameters(row: Row, varied: Sequence[str]) -> str:
    """`k=7 n_o=1`: what tells a row apart."""
    return plain(" ".join(f"{name}={row.parameters.get(name, '')}" for name in varied))


def named(row: Row, varied: Sequence[str]) -> str:
    """`street.mcap 5ed457beaf20 k=7 n_o=1`."""
    words = (plain(row.log), plain(row.configuration), parameters(row, varied))
    return " ".join(word for word in words if word)


def metric_and_unit(metric: str) -> str:
    """`over_area [m2]`; shares and numbers have no unit."""
    return f"{metric} [{UNITS[metric]}]" if metric in UNITS else metric


def figure(value: float | None, digits: int = 4) -> str:
    """A dash for what is undefined; what is whole has all its digits, since it may be a count."""
    if value is None:
        return "-"
    if math.isfinite(value) and value == int(value) and abs(value) < 1e15:
        return short(int(value))
    return f"{value:.{digits}g}"


def pair(base: float | None, new: float | None) -> tuple[str, str]:
    """Two figures with 4 digits, or with as many as tell them apart."""
    for digits in range(4, DIGITS):
        if (shown := (figure(base, digits), figure(new, digits)))[0] != shown[1] or base == new:
            return shown
    return figure(base, DIGITS), figure(new, DIGITS)


def difference(change: Change) -> str:
    """`-0.05`, with what is allowed where that is anything."""
    if change.difference is None:
        return "-"
    shown = figure(change.difference)
    signed = shown if shown.startswith("-") else f"+{shown}"
    return f"{signed} ({figure(change.limit)} allowed)" if 0 < change.limit < math.inf else signed


def noise_word(noise: Noise | None) -> str:
    """`beyond`, `within`, or nothing where that is not known or there are no frames behind a figure."""
    if noise is None or noise.beyond is None:
        return ""
    return "beyond" if noise.beyond else "within"


def noise_words(noise: Noise | None) -> str:
    """For people: `beyond noise`, `within noise` or a dash."""
    word = noise_word(noise)
    return f"{word} noise" if word else "-"


def sentence(change: Change) -> str:
    """`hit_rate 0.95 -> 0.9 (-0.05), beyond noise`."""
    base, new = pair(change.base, change.new)
    found = f"{metric_and_unit(plain(change.metric))} {base} -> {new}"
    if change.difference is not None:
        found += f", {difference(change)}"
    word = noise_word(change.noise)
    return f"{found}, {word} noise" if word else found


def is_aside(change: Change) -> bool:
    """Whether it is a count that nothing is held against: metrics that it leads to have lines."""
    return change.metric in COUNTS and change.mark == "~" and change.limit == math.inf


def told_changes(row: Row) -> list[Change]:
    """Those that have a line of their own for people, in their order: neither asides nor mirrors."""
    marks = {change.metric: change.mark for change in row.changes}
    return [
        change
        for change in row.changes
        if not is_aside(change) and marks.get(MIRRORS.get(change.metric, "")) != change.mark
    ]


def asides(row: Row) -> str:
    """`hits 36 -> 23, fn 22 -> 23`, or nothing."""
    found = [
        f"{change.metric} {' -> '.join(pair(change.base, change.new))}"
        for change in filter(is_aside, row.changes)
    ]
    return ", ".join(found)


def frames_run(frames: Sequence[int]) -> str:
    """`4-9, 12`: ascending indices, as runs; after some of them how many more there are."""
    runs: list[list[int]] = []
    for frame in frames:
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    shown = ", ".join(f"{first}" if first == last else f"{first}-{last}" for first, last in runs[:RUNS])
    more = sum(last - first + 1 for first, last in runs[RUNS:])
    return f"{shown} and {more} more" if more else shown


def in_frames(frames: Sequence[int]) -> str:
    """`in frame 4`, `in frames 4-9, 12`."""
    return f"in frame{'' if len(frames) == 1 else 's'} {frames_run(frames)}"


def label_sentence(change: LabelChange) -> str:
    """gap `trench` was hit in frames 4-9, now missed"""
    return f"gap `{plain(change.label)}` was {change.was} {in_frames(change.frames)}, now {change.now}"


def frames_sentence(row: Row) -> str:
    """In how many frames anything changed, and in which; nothing where that is not known or none did."""
    return f"changed {in_frames(row.frames)} ({counted(len(row.frames), 'frame')})" if row.frames else ""


def label_sentences(row: Row) -> list[str]:
    """What changed for the first labels, and how many more there are."""
    changes = row.labels or ()
    more = len(changes) - LABELS
    told = [label_sentence(change) for change in changes[:LABELS]]
    return (
        [*told, f"... and {counted(more, 'more change')} of labels; --format json has all"]
        if more > 0
        else told
    )


def unknowns(rows: Sequence[Row]) -> list[str]:
    """Why noise or frames are not known, each reason once."""
    noise = [change.noise.unknown for row in rows for change in row.changes if change.noise is not None]
    found = [f"noise is not known: {plain(reason)}" for reason in dict.fromkeys(noise) if reason]
    frames = dict.fromkeys(row.unknown for row in rows if row.unknown)
    return found + [f"changed frames are not known: {plain(reason)}" for reason in frames]


def is_told(row: Row) -> bool:
    """Whether there is anything to tell of a row."""
    return row.mark != " " or bool(row.changes or row.labels or row.reasons)
