"""What the paper claims, held against rows: figures picked by the study's YAML, verdicts by its rules."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jinja2 import StrictUndefined, TemplateSyntaxError, meta
from jinja2.sandbox import SandboxedEnvironment

from gapeval.errors import ConfigError
from gapeval.frame import FloatArray
from gapeval.scoring.metrics import METRICS
from gapeval.studies.definition import Claim, Figure, Study, Value, Where
from gapeval.studies.estimates import NOTHING, Estimate, of_draws
from gapeval.studies.rows import ALL, Row

HOLDS, PARTLY, DOES_NOT, NOT_MEASURED = "holds", "holds partly", "does not hold", "not measured"
RULES = SandboxedEnvironment(undefined=StrictUndefined)
COLUMNS = ("study", "claim", "section", "words", "measured", "verdict", "conditions", "rule", "source")
LOWER = {metric.name for metric in METRICS if metric.better == "lower"} | {"bin_mismatch", "median"}
RIGHT = {"fp_per_frame": "hit_rate", "over_area": "coverage"}  # of what is false, its counterpart


@dataclass(frozen=True, slots=True)
class Judged:
    """A row of claims.csv."""

    study: str
    claim: str
    section: str
    words: str
    measured: str
    verdict: str
    conditions: str
    rule: str
    source: str


class _NoRowError(Exception):
    """That a figure asks for: not run, or not on this log."""


def judge(name: str, study: Study, rows: Sequence[Row]) -> list[Judged]:
    """The claims of a study. Raises ConfigError for a rule that cannot be read."""
    return [_judge(name, claim, rows) for claim in study.claims]


def check_rules(name: str, study: Study) -> None:
    """Whether the rules can be read, and ask for figures that there are. Raises ConfigError."""
    for claim in study.claims:
        for rule in filter(None, (claim.holds, claim.partly)):
            where = f"study {name}: claims.{claim.claim}: {rule}"
            try:
                RULES.compile_expression(rule)
            except TemplateSyntaxError as error:
                raise ConfigError(f"{where}: {error.message}") from error
            unknown = meta.find_undeclared_variables(RULES.parse("{{" + rule + "}}")) - claim.figures.keys()
            if unknown:
                raise ConfigError(f"{where}: no figure {min(unknown)}; there are {', '.join(claim.figures)}")
        for key, figure in claim.figures.items():
            if figure.weigh and figure.of not in RIGHT:
                raise ConfigError(
                    f"study {name}: claims.{claim.claim}.{key}: weigh takes of: {' or '.join(RIGHT)}"
                )


def _judge(name: str, claim: Claim, rows: Sequence[Row]) -> Judged:
    groups: list[Value | None] = [None]
    if claim.by:
        wanted = {key: value for key, value in claim.where.items() if key != claim.by}
        of = [row.keys.get(claim.by) for row in rows if _fits(row, wanted, claim.by)]
        asked = claim.among or dict.fromkeys(of)
        groups = [one for one in asked if one is not None and one != ALL]
    measured, verdicts = [], {}
    for group in groups:
        where = claim.where if group is None else claim.where | {claim.by: group}
        try:
            found = {key: evaluated(figure, where, rows) for key, figure in claim.figures.items()}
        except _NoRowError:
            verdicts[group] = NOT_MEASURED
            continue
        verdicts[group] = _verdict(name, claim, found)
        text = ", ".join(f"{key} {shown(one)}" for key, one in found.items())
        measured.append(text if group is None else f"{claim.by} {_text(group)}: {text}")
    verdict = overall(list(verdicts.values()))
    conditions = ""
    if claim.by:
        conditions = "; ".join(
            f"{kind}: {claim.by} {', '.join(_text(group) for group in of)}"
            for kind in (HOLDS, PARTLY, DOES_NOT, NOT_MEASURED)
            if (of := [group for group, one in verdicts.items() if one == kind])
        )
    rule = claim.holds + (f"; partly: {claim.partly}" if claim.partly else "")
    fixed = ", ".join(f"{key} {_text(value)}" for key, value in claim.where.items() if value != "")
    return Judged(
        name,
        claim.claim,
        claim.section,
        claim.words,
        "; ".join(measured),
        verdict,
        "; ".join(filter(None, (fixed, conditions))),
        rule,
        f"{name}.csv: " + "; ".join(f"{key}: {_source(one)}" for key, one in claim.figures.items()),
    )


def overall(verdicts: Sequence[str]) -> str:
    """It holds if it holds under each condition, and partly if under some."""
    known = [verdict for verdict in verdicts if verdict != NOT_MEASURED]
    if not known:
        return NOT_MEASURED
    return known[0] if len(set(known)) == 1 else PARTLY


def _verdict(name: str, claim: Claim, found: Mapping[str, Estimate]) -> str:
    if any(one.value is None for one in found.values()):
        return NOT_MEASURED
    if _asked(name, claim, claim.holds, found):
        return HOLDS
    return PARTLY if claim.partly and _asked(name, claim, claim.partly, found) else DOES_NOT


def _asked(name: str, claim: Claim, rule: str, found: Mapping[str, Estimate]) -> bool:
    """Where a figure has no interval, its value stands for both ends."""
    figures = {
        key: {
            "value": one.value,
            "low": one.value if one.low is None else one.low,
            "high": one.value if one.high is None else one.high,
        }
        for key, one in found.items()
    }
    try:
        return bool(RULES.compile_expression(rule, undefined_to_none=False)(**figures))
    except Exception as error:  # the rule is the user's
        raise ConfigError(f"study {name}: claims.{claim.claim}: {rule}: {error}") from error


# --- figures -----------------------------------------------------------------------------------------


def evaluated(figure: Figure, where: Where, rows: Sequence[Row]) -> Estimate:
    """A figure of a claim. Raises _NoRowError where there is no row that it asks for."""
    wanted = where | figure.where
    if figure.weigh:
        return weighed(_several(rows, wanted, figure.weigh), figure.weigh, figure.of)
    if figure.best:
        return best(_several(rows, wanted, figure.best), figure.best, figure.of)
    if figure.fit:
        return straightness(_several(rows, wanted, figure.fit), figure.fit, figure.of)
    one = (_top(rows, wanted, figure.of) if figure.top else _one(rows, wanted)).figures.get(
        figure.of, NOTHING
    )
    if figure.minus:
        return combined(one, _one(rows, wanted | figure.minus).figures.get(figure.of, NOTHING), np.subtract)
    if figure.over:
        return combined(one, _one(rows, wanted | figure.over).figures.get(figure.of, NOTHING), np.divide)
    return one


def combined(one: Estimate, other: Estimate, operation: Callable[[Any, Any], Any]) -> Estimate:
    """A difference or ratio, draw by draw: both are of the same logs."""
    if one.value is None or other.value is None or (operation is np.divide and other.value == 0):
        return NOTHING
    value = float(operation(one.value, other.value))
    if one.draws is None or other.draws is None or len(one.draws) != len(other.draws):
        return Estimate(value)
    with np.errstate(divide="ignore", invalid="ignore"):
        draws = np.asarray(operation(one.draws, other.draws), dtype=np.float64)
    return of_draws(value, draws)


def best(rows: Sequence[Row], column: str, of: str) -> Estimate:
    """The value of a column at which a figure is best; its interval: of the middle 95 % of the draws."""
    known = [row for row in rows if row.figures.get(of, NOTHING).value is not None]
    if not known:
        return NOTHING
    sign = -1.0 if of in LOWER else 1.0
    at = np.array([float(row.keys[column]) for row in known])  # type: ignore[arg-type]
    values = np.array([row.figures[of].value for row in known], dtype=np.float64)
    value = float(at[np.argmax(sign * values)])
    draws = [row.figures[of].draws for row in known]
    if any(one is None for one in draws):
        return Estimate(value)
    table = sign * np.array(draws)
    defined = np.isfinite(table).any(axis=0)
    chosen = at[np.argmax(np.where(np.isfinite(table), table, -np.inf)[:, defined], axis=0)]
    return of_draws(value, chosen)


def straightness(rows: Sequence[Row], column: str, of: str) -> Estimate:
    """R2 of a straight line through a figure against a column."""
    x = np.array([float(row.keys[column]) for row in rows])  # type: ignore[arg-type]
    y = np.array([row.figures[of].value for row in rows], dtype=np.float64)
    if len(x) < 3 or np.ptp(y) == 0:
        return NOTHING
    return Estimate(float(np.corrcoef(x, y)[0, 1] ** 2))


def weighed(rows: Sequence[Row], column: str, of: str) -> Estimate:
    """Section 4.5: were gaps weighed by how small `column` is, which is known of each frame, the probability
    that what is right weighs more than what is false; 0.5 where weighing does not tell them apart. The rows
    must be of equal numbers of frames and labels, so that rates stand for counts."""
    ordered = sorted(rows, key=lambda row: abs(float(row.keys[column])))  # type: ignore[arg-type]
    true, false = ([row.figures.get(name, NOTHING) for row in ordered] for name in (RIGHT[of], of))

    def probability(good: FloatArray, bad: FloatArray) -> FloatArray:
        worse = bad[::-1].cumsum(axis=0)[::-1] - bad  # false gaps at larger values
        with np.errstate(divide="ignore", invalid="ignore"):
            found: FloatArray = (good * (worse + bad / 2)).sum(axis=0) / (good.sum(axis=0) * bad.sum(axis=0))
        return found

    if any(one.value is None for one in (*true, *false)):
        return NOTHING
    value = float(probability(*(np.array([one.value for one in group]) for group in (true, false))))
    if not np.isfinite(value):
        return NOTHING
    if any(one.draws is None for one in (*true, *false)):
        return Estimate(value)
    draws = probability(*(np.array([one.draws for one in group]) for group in (true, false)))
    return of_draws(value, draws)


def _one(rows: Sequence[Row], where: Where) -> Row:
    found = [row for row in rows if _fits(row, where)]
    if not found:
        raise _NoRowError(str(where))
    if len(found) > 1:
        raise ConfigError(f"{len(found)} rows with {_where(where)}; a figure needs one")
    return found[0]


def _top(rows: Sequence[Row], where: Where, of: str) -> Row:
    """The row with the best figure; of equal ones, the first."""
    found = [row for row in rows if _fits(row, where) and row.figures.get(of, NOTHING).value is not None]
    if not found:
        raise _NoRowError(str(where))
    sign = -1.0 if of in LOWER else 1.0
    return max(found, key=lambda row: sign * (row.figures[of].value or 0.0))


def _several(rows: Sequence[Row], where: Where, column: str) -> list[Row]:
    """The rows that differ in a column alone."""
    found = [row for row in rows if _fits(row, where, column) and row.keys.get(column) is not None]
    if not found:
        raise _NoRowError(str(where))
    values = [row.keys[column] for row in found]
    if len(set(values)) < len(values):
        raise ConfigError(f"several rows with {_where(where)} and equal {column}; a figure needs one of each")
    return found


def _fits(row: Row, where: Where, but: str = "") -> bool:
    """Rows are of all scenes and of no group unless these are asked for."""
    usual: Where = {"scene": ALL, "by": ""}
    wanted = {key: value for key, value in (usual | where).items() if key != but}
    return all(_equal(row.keys.get(key), value) for key, value in wanted.items())


def _equal(one: Value | None, other: Value) -> bool:
    return (one is None and other == "") or (
        one == other and isinstance(one, bool) == isinstance(other, bool)
    )


# --- words -------------------------------------------------------------------------------------------


def shown(one: Estimate) -> str:
    """`0.71 [0.65, 0.77]`."""
    if one.value is None:
        return "-"
    interval = "" if one.low is None or one.high is None else f" [{one.low:.3g}, {one.high:.3g}]"
    return f"{one.value:.3g}{interval}"


def _text(value: Value | None) -> str:
    return (
        f"{value:g}"
        if isinstance(value, float)
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
    )


def _where(where: Where) -> str:
    return " ".join(f"{key}={_text(value)}" for key, value in where.items()) or "all"


def _source(figure: Figure) -> str:
    what = figure.of
    if figure.weigh:
        return f"{RIGHT[what]} and {what} against {figure.weigh} where {_where(figure.where)}"
    if figure.best:
        return f"{figure.best} with the best {what} where {_where(figure.where)}"
    if figure.fit:
        return f"R2 of {what} against {figure.fit} where {_where(figure.where)}"
    text = f"{'best ' if figure.top else ''}{what} where {_where(figure.where)}"
    for word, other in (("minus", figure.minus), ("over", figure.over)):
        if other:
            text += f" {word} where {_where(other)}"
    return text
