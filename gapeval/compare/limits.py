"""How far figures may go in their worse direction."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

from gapeval.errors import ConfigError
from gapeval.results.figures import FIGURES, Better

TIME = "time"  # all stages, of one configuration in one frame; `time.STAGE`: one of them
Way = Literal["drop", "rise"]
WORSE: dict[Better, tuple[Way, ...]] = {"higher": ("drop",), "lower": ("rise",), "none": ("drop", "rise")}
AMOUNT = re.compile(r"(?P<number>\+?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?)\s*(?P<percent>%?)")


@dataclass(frozen=True, slots=True)
class Amount:
    """In the figure's unit, or a share of its value in BASE."""

    number: float
    is_share: bool = False

    def of(self, base: float) -> float:
        return self.number * abs(base) if self.is_share else self.number


@dataclass(frozen=True, slots=True)
class Limits:
    """Amounts by metric that were given."""

    drop: Mapping[str, Amount]
    rise: Mapping[str, Amount]

    def given(self, metric: str, way: Way) -> Amount | None:
        return (self.drop if way == "drop" else self.rise).get(metric)

    def allowed(self, metric: str, way: Way, base: float) -> float:
        """How far it may go this way [its unit]: as given, else not at all where that is worse.

        Infinite for seconds, and where this way is no worse.
        """
        amount = self.given(metric, way)
        if amount is not None:
            return amount.of(base)
        better = FIGURES[metric].better if metric in FIGURES else "none"
        return 0.0 if better != "none" and way in WORSE[better] else math.inf

    @property
    def stages(self) -> tuple[str, ...]:
        """Those whose seconds have a limit; `time` is all of them."""
        return tuple(name.removeprefix(f"{TIME}.") for name in self.rise if is_time(name))


def is_time(metric: str) -> bool:
    return metric == TIME or metric.startswith(f"{TIME}.")


def read_limits(
    drops: Iterable[str],
    rises: Iterable[str],
    drops_of_file: Mapping[str, float | str],
    rises_of_file: Mapping[str, float | str],
) -> Limits:
    """From `METRIC=AMOUNT` of options, which win, and of a configuration. Raises ConfigError."""
    drop, rise = (
        {name: _amount(name, str(text), way) for name, text in of_file.items()}
        | dict(_assignment(text, way) for text in options)
        for way, of_file, options in (("drop", drops_of_file, drops), ("rise", rises_of_file, rises))
    )
    return Limits(drop, rise)


def _assignment(text: str, way: str) -> tuple[str, Amount]:
    metric, equals, amount = text.partition("=")
    if not equals:
        name = (metric.split() or ["pq"])[0]
        raise ConfigError(f"--max-{way} {text}: say how much, for example {name}=0.01 or {name}=1%")
    return metric.strip(), _amount(metric.strip(), amount.strip(), way)


def _amount(metric: str, text: str, way: str) -> Amount:
    where = f"max_{way} of {metric}"
    if metric not in FIGURES and not is_time(metric):
        near = get_close_matches(metric, [*FIGURES, TIME], 1)
        hint = f"did you mean {near[0]}?" if near else "docs/scoring.md lists them"
        raise ConfigError(f"{where}: no such metric; {hint}")
    better = "lower" if is_time(metric) else FIGURES[metric].better
    if way not in WORSE[better]:
        raise ConfigError(f"{where}: a {way} is better; limit its {'rise' if way == 'drop' else 'drop'}")
    found = AMOUNT.fullmatch(text)
    if found is None:
        raise ConfigError(f"{where}: {text!r} is no amount; give a number from 0 on, or a percentage like 1%")
    number = float(found["number"])
    if not math.isfinite(number):
        raise ConfigError(f"{where}: {text!r} is no limit; leave it out")
    return Amount(number / 100, True) if found["percent"] else Amount(number)
