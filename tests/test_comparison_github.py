"""Annotations and the summary of a step of GitHub Actions."""

import re
from dataclasses import replace

import pytest
from comparisons import RANK, comparison, comparisons, large, realistic, row
from hypothesis import given
from hypothesis import strategies as st

from gapeval.compare.outcome import Change, Comparison, Spread, Time
from gapeval.report.comparisons.failures import failures, worst
from gapeval.report.comparisons.github import ANNOTATIONS, FIGURES, SUMMARY, annotations, step_summary
from gapeval.report.comparisons.markdown import markdown
from gapeval.report.comparisons.verdict import verdict

COMMAND = re.compile(r"::error title=([^:,]*)::(.*)")
LONG = replace(large(30, 25), notices=("ä" * 70, "b" * 70))
SIZE = len(step_summary(LONG).encode())


def read(text: str) -> tuple[list[tuple[str, str]], str]:
    """Title and message of each command, as the runner takes them, and the last line."""
    *commands, last, end = text.split("\n")
    assert end == ""
    found = []
    for command in commands:
        match = COMMAND.fullmatch(command)
        assert match is not None
        title = match[1].replace("%3A", ":").replace("%2C", ",")
        found.append(
            tuple(re.sub("%(25|0D|0A)", lambda c: chr(int(c[1], 16)), part) for part in (title, match[2]))
        )
    return found, last


@given(comparisons())
def test_commands_can_be_read_back_and_the_verdict_is_last(found) -> None:
    commands, last = read(annotations(found))
    assert last == verdict(found)
    assert len(commands) == len(failures(found))
    assert (found.status == 0) == (not commands)


@given(comparisons())
def test_worst_first_rows_before_times(found) -> None:
    order = [(RANK[worst(one)], isinstance(one, Time)) for one in failures(found)]
    assert order == sorted(order)
    assert all(rank < RANK["-"] for rank, _ in order)


def test_a_real_one() -> None:
    commands, last = read(annotations(realistic()))
    assert [title for title, _ in commands] == [
        "gapeval: tunnel.mcap e38b37806118 n_o=0 pl_th=0.05",
        "gapeval: street.mcap f3a8ce15674c n_o=2 pl_th=0.4",
        "gapeval: street.mcap 5ed457beaf20 n_o=1 pl_th=0.4",
        "gapeval: street.mcap a013f6f3d667 n_o=1 pl_th=0.1",
        "gapeval: street.mcap",
    ]
    assert commands[0][1] == "not comparable: labels differ: 0b0c0b0c0b0c in BASE, 1c1d1c1d1c1d in NEW"
    assert commands[2][1].split("\n")[:3] == [
        "worse: hit_rate 0.95 -> 0.8, -0.15, beyond noise",
        "worse: pq 0.6667 -> 0.66668, -2e-05, within noise",
        "gap `trench` was hit in frames 4-9, now missed",
    ]
    assert last == "not comparable: 1 of 7 rows; 4 regressions besides"


def test_what_would_end_a_command_is_escaped() -> None:
    hostile = row("+", log="a%,:\r\n::error::b", reasons=("100 %\n::warning::",))
    line = annotations(comparison(hostile)).split("\n")[0]
    assert line == (
        "::error title=gapeval%3A a%25%2C%3A\\r\\n%3A%3Aerror%3A%3Ab 5ed457beaf20 n_o=1 pl_th=0.4"
        "::worse: 100 %25\\n::warning::"
    )


def test_nothing_but_the_verdict_when_fine() -> None:
    found = comparison(row("-", (Change("pq", "-", 0.5, 0.6, 0.0),)), row("~"), row("*"))
    assert annotations(found) == "fine: 3 rows, none worse, 1 better\n"


@pytest.mark.parametrize(("number", "shown"), [(9, 9), (10, 10), (11, 10), (1000, 10)])
def test_at_most_ten_and_the_tenth_says_how_many_more(number: int, shown: int) -> None:
    commands, _ = read(annotations(large(number, 2)))
    assert len(commands) == shown <= ANNOTATIONS
    more = f"{number - 9} more are worse or not comparable; see the summary"
    assert (commands[-1] == ("gapeval compare", more)) == (number > ANNOTATIONS)


def test_rows_that_fail_for_the_same_reasons_are_one_annotation() -> None:
    alike = [
        row("x", log=log, configuration=f"{at:012x}", reasons=("other scorer",))
        for log in "ab"
        for at in range(20)
    ]
    others = [row("x", log=f"{at}", reasons=(f"other labels: {at}",)) for at in range(12)]
    found = comparison(*alike, *others, row("!", reasons=("not in NEW",)), varied=())
    commands, _ = read(annotations(found))
    assert len(commands) == ANNOTATIONS
    named = ", ".join(f"{at:012x}" for at in range(8))
    assert commands[0] == (
        "gapeval: 40 rows of 2 logs",
        f"not comparable: other scorer\na, b: {named} and 12 more configurations",
    )
    assert commands[1] == ("gapeval: 0 5ed457beaf20", "not comparable: other labels: 0")
    assert commands[-1][1] == "5 more are worse or not comparable; see the summary"
    more, _ = read(annotations(comparison(*others[:10], *alike)))
    assert more[-1][1] == "41 more are worse or not comparable; see the summary"


def test_times_come_with_the_rows_that_are_as_bad() -> None:
    lost = Time("a", "time", "x", None, Spread(1, 1, 1), 0.1)
    commands, _ = read(annotations(comparison(row("+"), times=(lost,))))
    assert [message.split(":")[0] for _, message in commands] == ["not comparable", "worse"]


def test_not_every_figure_in_a_message() -> None:
    ((_, message),), _ = read(annotations(large(1, 25)))
    assert message.count("worse: ") == FIGURES
    assert "\n... and 15 more figures\n" in message


def test_a_summary_is_the_markdown_where_there_is_room() -> None:
    assert step_summary(LONG) == "\n" + markdown(LONG)
    assert step_summary(LONG, SIZE + 1) == "\n" + markdown(LONG)


def test_a_summary_is_cut_after_a_line() -> None:
    """For every room: it says how many lines are missing, and hides nothing in a fold that is not closed."""
    size = len(step_summary(realistic()).encode())
    for room in range(-1, size + 2):
        check_cut(realistic(), room)


@given(comparisons(), st.integers(0, 3000))
def test_any_summary_fits(found, room: int) -> None:
    check_cut(found, room)


def check_cut(found: Comparison, room: int) -> None:
    whole = step_summary(found)
    cut = step_summary(found, room)
    assert len(cut.encode()) < max(room, 1)
    if not cut or cut == whole:
        return
    lines = cut.split("\n")
    more = re.fullmatch(r"\.\.\. cut here, (\d+) more lines; --format md has all", lines[-2])
    assert more is not None
    kept = whole.split("\n")[: -int(more[1]) - 1]
    closing = lines[len(kept) : -3]
    assert lines[: len(kept)] == kept
    opened = sum(line.startswith("<details>") for line in kept) - kept.count("</details>")
    assert closing == ["</details>"] * opened


def test_a_summary_that_is_too_large_for_github() -> None:
    rows = [replace(one, log="ö" * 5000) for one in large(20, 25).rows]
    found = comparison(*rows)
    assert len(markdown(found).encode()) > SUMMARY
    cut = step_summary(found)
    assert SUMMARY - 20_000 < len(cut.encode()) < SUMMARY
    assert cut.endswith("more lines; --format md has all\n")
