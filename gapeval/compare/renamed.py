"""Logs that BASE and NEW call differently, though they hold the same: found by their contents."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from gapeval.compare.frames import LogFrames
from gapeval.compare.labels import States
from gapeval.compare.side import Record, Side


def names_of(base: Side, new: Side) -> dict[str, str]:
    """What BASE calls logs of NEW that it does not have by name. A log's name depends on where others lie."""
    wanted = _by_contents(base, new)
    return {log: wanted[contents] for contents, log in _by_contents(new, base).items() if contents in wanted}


def _by_contents(side: Side, other: Side) -> dict[str, str]:
    """Logs that the other has not by name; none of which there are two alike."""
    logs = {log: side.origin.logs.get(log, "") for log in sorted(side.logs)}
    contents = list(logs.values())
    return {of: log for log, of in logs.items() if of and contents.count(of) == 1 and log not in other.logs}


def renamed(side: Side, names: Mapping[str, str]) -> Side:
    """The same with other names of logs."""
    if not names:
        return side

    def called(log: str) -> str:
        return names.get(log, log)

    origin = replace(
        side.origin,
        logs={called(log): of for log, of in side.origin.logs.items()},
        labels={called(log): of for log, of in side.origin.labels.items()},
    )
    return replace(
        side,
        origin=origin,
        frames={called(log): of for log, of in side.frames.items()},
        failed={called(log): of for log, of in side.failed.items()},
        rows=tuple({**row, "log": called(row["log"])} for row in side.rows),
        times={called(log): of for log, of in side.times.items()},
        record=Renamed(side.record, names),
    )


@dataclass(frozen=True, slots=True)
class Renamed:
    """The same frames under other names of logs."""

    record: Record
    names: Mapping[str, str]

    @property
    def unknown(self) -> str:
        return self.record.unknown

    def frames(self, configurations: Collection[str]) -> dict[str, LogFrames]:
        return {self.names.get(log, log): of for log, of in self.record.frames(configurations).items()}

    def states(self, log: str, stamp: int, configuration: str) -> States:
        before = {after: name for name, after in self.names.items()}
        return self.record.states(before.get(log, log), stamp, configuration)
