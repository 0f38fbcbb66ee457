"""What the bench found: figures over repetitions, held against targets, for a reader and as JSON."""

import operator
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

PARTS = {
    "a": "one configuration: detect + assess",
    "b": "a grid of 240, evaluated with labels",
    "c": "the same grid, detection alone",
    "d": "the same grid's thresholds, morphology and contours in OpenCV alone",
    "e": "reading, and a sweep on one core against it",
    "f": "the whole sweep with more workers",
    "g": "how cost grows with points and with the grid",
    "h": "memory of the largest process of a sweep",
    "i": "for scale: Patchwork++",
    "j": "comparing large results, all of whose rows have changed",
    "k": "raw messages of healthy logs, against rosbags alone",
}
COMPARISONS = {"<=": operator.le, "<": operator.lt, ">=": operator.ge}


@dataclass(frozen=True, slots=True)
class Target:
    """What a median should be: `<= 2.5`."""

    comparison: str
    value: float

    def met(self, figure: float) -> bool:
        return bool(COMPARISONS[self.comparison](figure, self.value))


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure. samples: of which the median and the 5-95 % range are shown. log: empty for none."""

    part: str
    log: str
    name: str
    unit: str
    samples: tuple[float, ...]
    targets: tuple[Target, ...] = ()
    note: str = ""

    @property
    def median(self) -> float:
        return float(np.median(self.samples))

    @property
    def range(self) -> tuple[float, float]:
        low, high = np.percentile(self.samples, (5, 95)).tolist()
        return low, high

    def verdicts(self) -> list[dict[str, Any]]:
        return [asdict(target) | {"met": target.met(self.median)} for target in self.targets]


@dataclass(frozen=True, slots=True)
class Skipped:
    """What was not measured, and why."""

    part: str
    reason: str


Finding = Figure | Skipped


def figure(
    part: str,
    log: str,
    name: str,
    unit: str,
    samples: Iterable[float],
    *targets: tuple[str, float],
    note: str = "",
) -> Figure:
    return Figure(part, log, name, unit, tuple(samples), tuple(Target(*target) for target in targets), note)


def as_json(findings: Sequence[Finding]) -> dict[str, Any]:
    figures = [
        {
            "part": found.part,
            "log": found.log,
            "name": found.name,
            "unit": found.unit,
            "median": found.median,
            "p5": found.range[0],
            "p95": found.range[1],
            "samples": len(found.samples),
            "targets": found.verdicts(),
            "note": found.note,
        }
        for found in findings
        if isinstance(found, Figure)
    ]
    return {
        "figures": figures,
        "skipped": [asdict(found) for found in findings if isinstance(found, Skipped)],
    }


def lines(part: str, findings: Sequence[Finding]) -> Iterator[str]:
    """A part for a reader."""
    yield f"\n({part}) {PARTS[part]}"
    log = ""
    for found in findings:
        if isinstance(found, Skipped):
            yield f"  skipped: {found.reason}"
            continue
        if found.log != log:
            log = found.log
            yield f"  {log or 'any log'}"
        yield f"    {line(found)}"


def line(found: Figure) -> str:
    low, high = found.range
    spread = f"[{short(low)} - {short(high)}] n {len(found.samples)}" if len(found.samples) > 1 else ""
    verdicts = "; ".join(
        f"{v['comparison']} {v['value']:g} {'met' if v['met'] else 'not met'}" for v in found.verdicts()
    )
    said = "   ".join(text for text in (verdicts, found.note) if text)
    return f"{found.name:52s} {short(found.median):>8s} {found.unit:9s} {spread:28s} {said}".rstrip()


def short(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
