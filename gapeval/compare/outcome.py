"""What a comparison found: plain data, which every format shows in its way."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Mark = Literal["x", "!", "+", "-", "*", "~", " "]

MARKS: dict[Mark, str] = {  # worst first
    "x": "not comparable",
    "!": "missing or failed now, or no longer defined",
    "+": "worse",
    "-": "better",
    "*": "new, mended, or defined for the first time",
    "~": "changed, within the limit or with no better direction",
    " ": "the same",
}
REGRESSIONS: tuple[Mark, ...] = ("!", "+")

FINE, REGRESSION, NOT_COMPARABLE = 0, 3, 4  # exit statuses
TOLERANCE = 1e-9  # what machines differ by


@dataclass(frozen=True, slots=True)
class Noise:
    """How much a change may owe to the frames that happened to be recorded.

    low, high: the middle 95 % of new - base, both over the same blocks of time, drawn anew. NaN, with the
    reason in `unknown`, where that cannot be told.
    """

    low: float
    high: float
    unknown: str = ""

    @property
    def beyond(self) -> bool | None:
        """Whether a change is beyond noise; None: unknown."""
        return None if self.unknown else not (self.low <= TOLERANCE and self.high >= -TOLERANCE)


@dataclass(frozen=True, slots=True)
class Change:
    """One figure of a row that is not the same.

    base, new: None where undefined. limit: how far it may go in its worse direction [unit]; infinite where
    nothing is held against it.
    """

    metric: str
    mark: Mark
    base: float | None
    new: float | None
    limit: float
    noise: Noise | None = None  # None: the figure is no ratio of sums over frames

    @property
    def difference(self) -> float | None:
        """New - base; None where one is undefined."""
        return None if self.base is None or self.new is None else self.new - self.base


@dataclass(frozen=True, slots=True)
class LabelChange:
    """A label in the frames in which it was this and is now that: `hit`, `missed`, `not asked for`.

    frames: their indices in the log, from 0, ascending, and their stamps [ns].
    """

    label: str
    was: str
    now: str
    frames: tuple[int, ...]
    stamps: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Row:
    """A configuration on a log, or on `all` of them, in both results.

    configuration: its id in NEW, or in BASE where NEW lacks it; was: its id in BASE, empty where BASE lacks
    it. parameters: the columns that rows are joined on. reasons: why the row is `x`, `!` or `*` as a whole.
    base, new: every figure that is compared, empty where the row is missing. changes: worst first. frames:
    indices of frames in which any sum changed; None: not known, for the reason in `unknown`, or of all logs.
    labels: None: not looked at, or not known.
    """

    log: str
    configuration: str
    parameters: Mapping[str, str]
    mark: Mark
    reasons: tuple[str, ...]
    base: Mapping[str, float | None]
    new: Mapping[str, float | None]
    changes: tuple[Change, ...]
    frames: tuple[int, ...] | None = None
    labels: tuple[LabelChange, ...] | None = None
    unknown: str = ""
    was: str = ""


@dataclass(frozen=True, slots=True)
class Spread:
    """Seconds: median and 95 % quantile over so many frames."""

    median: float
    p95: float
    frames: int


@dataclass(frozen=True, slots=True)
class Time:
    """A stage on a log, or `time`: all of them, of one configuration in one frame. limit [s], or infinite."""

    log: str
    stage: str
    mark: Mark
    base: Spread | None
    new: Spread | None
    limit: float

    @property
    def metric(self) -> str:
        """What a limit calls it."""
        return self.stage if self.stage == "time" else f"time.{self.stage}"


@dataclass(frozen=True, slots=True)
class Origin:
    """Where results come from.

    path: as it was given. revision: of gapeval's repository, where known; source: digest of its code.
    logs, labels: of each log by name, the sha256 of its content and of its labels, empty where unknown or
    none. history: of a baseline, its renewals, the latest last: `gapeval`, `source`, `reason`.
    """

    path: str
    gapeval: str
    revision: str
    source: str
    scorer: str
    logs: Mapping[str, str]
    labels: Mapping[str, str]
    history: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, slots=True)
class Comparison:
    """rows: worst first, all of them. varied: the parameters that tell rows apart. notices: to read first."""

    base: Origin
    new: Origin
    rows: tuple[Row, ...]
    times: tuple[Time, ...]
    varied: tuple[str, ...]
    notices: tuple[str, ...]

    @property
    def status(self) -> int:
        """The exit status: what is not comparable weighs more than what is worse."""
        marks = {row.mark for row in self.rows} | {time.mark for time in self.times}
        marks |= {change.mark for row in self.rows for change in row.changes}
        if "x" in marks:
            return NOT_COMPARABLE
        return REGRESSION if marks & set(REGRESSIONS) else FINE
