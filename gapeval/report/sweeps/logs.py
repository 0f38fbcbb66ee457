"""The logs and labels that a sweep was made from, as far as they are still there."""

from collections.abc import Mapping
from dataclasses import dataclass

from gapeval.config import Config, Configuration
from gapeval.errors import GapevalError
from gapeval.labels import Labels, read_labels
from gapeval.logs.read import Recording, read_recording
from gapeval.report.sweeps.results import Results
from gapeval.results.from_sweep import log_names
from gapeval.results.parts import PARTS, Input, Order, read_order
from gapeval.sweep.grid import configurations
from gapeval.sweep.provenance import content_digest


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One log. missing: why it cannot be read, where recording is None. unlabelled: why it has no labels."""

    recording: Recording | None
    labels: Labels | None
    missing: str = ""
    unlabelled: str = ""


class Sources:
    """The logs of a sweep by their names in its results; each is opened when it is first asked for."""

    def __init__(self, results: Results) -> None:
        self.configurations: Mapping[str, Configuration] = {}
        self.missing = ""
        self._opened: dict[str, Source] = {}
        self._inputs: dict[str, tuple[Input, Input | None]] = {}
        self._config = Config()
        try:
            order = read_order(results.folder)
        except GapevalError:
            self.missing = f"{results.folder / PARTS} does not say which logs these results are of"
            return
        self._take(order, results)

    def _take(self, order: Order, results: Results) -> None:
        names = log_names([log.path for log in order.logs])
        known = {one.id: one for one in configurations(order.config)}
        ids = {row["configuration"] for row in results.overall}
        if not ids <= known.keys() or set(names) != {entry["log"] for entry in results.manifest["logs"]}:
            self.missing = f"{results.folder / PARTS} is of a sweep that was begun later and is not finished"
            return
        labels = list(order.labels) * len(names) if len(order.labels) == 1 else list(order.labels)
        labelled: list[Input | None] = [*labels] or [None] * len(names)
        self.configurations, self._config = known, order.config
        self._inputs = {
            name: (log, drawn) for name, log, drawn in zip(names, order.logs, labelled, strict=True)
        }

    def of(self, log: str) -> Source:
        """The log of this name, if it is there and the same."""
        if log not in self._opened:
            self._opened[log] = self._open(log)
        return self._opened[log]

    def _open(self, log: str) -> Source:
        if log not in self._inputs:
            return Source(None, None, self.missing or f"{log} is not among the logs of this sweep")
        file, drawn = self._inputs[log]
        if not file.path.exists():
            return Source(None, None, f"the log is no longer at {file.path}")
        if content_digest(file.path) != file.sha256:
            return Source(None, None, f"{file.path} is not what was swept: its content has changed")
        try:
            recording = read_recording(file.path, self._config.log, body=self._config.robot.body)
        except GapevalError as error:
            return Source(None, None, str(error))
        labels, unlabelled = _labels(drawn)
        return Source(recording, labels, "", unlabelled)


def _labels(drawn: Input | None) -> tuple[Labels | None, str]:
    if drawn is None:
        return None, ""
    try:
        labels = read_labels(drawn.path)
    except GapevalError as error:
        return None, f"without its labels: {error}"
    if labels.sha256 != drawn.sha256:
        return None, f"without its labels: {drawn.path} is not what was swept: its content has changed"
    return labels, ""
