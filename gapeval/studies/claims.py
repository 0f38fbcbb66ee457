"""What the paper claims, held against rows: figures picked by the study's YAML, verdicts by its rules."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jinja2 import StrictUndefined, TemplateSyntaxError, meta
from jinja2.sandbox import SandboxedEnvironment

from gapeval.errors import ConfigError
from gapeval.studies.definition import Claim, Figure, Study, Value, Where
from gapeval.studies.estimates import Estimate
from gapeval.studies.figures import RIGHT, NoRowError, described, evaluated, fits, written
from gapeval.studies.rows import ALL, Row

HOLDS, PARTLY, DOES_NOT, NOT_MEASURED = "holds", "holds partly", "does not hold", "not measured"
RULES = SandboxedEnvironment(undefined=StrictUndefined)
BY_INTERVALS, BY_VALUES = "intervals", "values alone"  # where there was too little data for an interval
COLUMNS = (
    "study",
    "claim",
    "section",
    "words",
    "measured",
    "verdict",
    "basis",
    "conditions",
    "rule",
    "source",
)


@dataclass(frozen=True, slots=True)
class Judged:
    """A row of claims.csv."""

    study: str
    claim: str
    section: str
    words: str
    measured: str
    verdict: str
    basis: str
    conditions: str
    rule: str
    source: str


def judge(name: str, study: Study, rows: Sequence[Row]) -> list[Judged]:
    """The claims of a study. Raises ConfigError for a rule that cannot be read."""
    return [_judge(name, claim, rows) for claim in study.claims]


def check_rules(name: str, study: Study) -> None:
    """Whether the rules can be read, and ask for figures that there are. Raises ConfigError."""
    for claim in study.claims:
        tried = dict.fromkeys(claim.figures, Estimate(0.5, 0.4, 0.6))
        for rule in filter(None, (claim.holds, claim.partly)):
            where = f"study {name}: claims.{claim.claim}: {rule}"
            try:
                RULES.compile_expression(rule)
            except TemplateSyntaxError as error:
                raise ConfigError(f"{where}: {error.message}") from error
            unknown = meta.find_undeclared_variables(RULES.parse("{{" + rule + "}}")) - claim.figures.keys()
            if unknown:
                raise ConfigError(f"{where}: no figure {min(unknown)}; there are {', '.join(claim.figures)}")
            _asked(name, claim, rule, tried)
        for key, figure in claim.figures.items():
            if figure.weigh and figure.of not in RIGHT:
                raise ConfigError(
                    f"study {name}: claims.{claim.claim}.{key}: weigh takes of: {' or '.join(RIGHT)}"
                )


def _judge(name: str, claim: Claim, rows: Sequence[Row]) -> Judged:
    groups: list[Value | None] = [None]
    if claim.by:
        wanted = {key: value for key, value in claim.where.items() if key != claim.by}
        of = [row.keys.get(claim.by) for row in rows if fits(row, wanted, claim.by)]
        asked = claim.among or dict.fromkeys(of)
        groups = [one for one in asked if one is not None and one != ALL]
    measured, verdicts, sure = [], {}, True
    for group in groups:
        where = claim.where if group is None else claim.where | {claim.by: group}
        try:
            found = {
                key: _evaluated(figure, where, rows, f"study {name}: claims.{claim.claim}.{key}")
                for key, figure in claim.figures.items()
            }
            verdicts[group] = _verdict(name, claim, found)
            text = ", ".join(f"{key} {shown(one)}" for key, one in found.items())
            sure &= all(one.value is None or one.low is not None for one in asked_by(claim, found))
        except NoRowError as error:
            verdicts[group] = NOT_MEASURED
            text = str(error)
        measured.append(text if group is None else f"{claim.by} {written(group)}: {text}")
    verdict = overall(list(verdicts.values()))
    conditions = ""
    if claim.by:
        conditions = "; ".join(
            f"{kind}: {claim.by} {', '.join(written(group) for group in of)}"
            for kind in (HOLDS, PARTLY, DOES_NOT, NOT_MEASURED)
            if (of := [group for group, one in verdicts.items() if one == kind])
        )
    rule = claim.holds + (f"; partly: {claim.partly}" if claim.partly else "")
    fixed = ", ".join(f"{key} {written(value)}" for key, value in claim.where.items() if value != "")
    return Judged(
        name,
        claim.claim,
        claim.section,
        claim.words,
        "; ".join(measured),
        verdict,
        "" if verdict == NOT_MEASURED else BY_INTERVALS if sure else BY_VALUES,
        "; ".join(filter(None, (fixed, conditions))),
        rule,
        f"{name}.csv: " + "; ".join(f"{key}: {_source(one)}" for key, one in claim.figures.items()),
    )


def asked_by(claim: Claim, found: Mapping[str, Estimate]) -> list[Estimate]:
    """The figures of whose interval a rule asks an end."""
    rules = f"{claim.holds} {claim.partly}"
    return [one for key, one in found.items() if re.search(rf"\b{re.escape(key)}\.(low|high)\b", rules)]


def _evaluated(figure: Figure, where: Where, rows: Sequence[Row], what: str) -> Estimate:
    try:
        return evaluated(figure, where, rows)
    except ConfigError as error:
        raise ConfigError(f"{what}: {error}") from error


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
    where = f"study {name}: claims.{claim.claim}: {rule}"
    try:
        answer = RULES.compile_expression(rule, undefined_to_none=False)(**figures)
    except Exception as error:  # the rule is the user's
        raise ConfigError(f"{where}: {error}; a figure has value, low and high") from error
    if not isinstance(answer, bool):
        raise ConfigError(f"{where}: is {answer!r}, neither true nor false; compare it with something")
    return answer


def shown(one: Estimate) -> str:
    """`0.71 [0.65, 0.77]`."""
    if one.value is None:
        return "-"
    interval = "" if one.low is None or one.high is None else f" [{one.low:.3g}, {one.high:.3g}]"
    return f"{one.value:.3g}{interval}"


def _source(figure: Figure) -> str:
    what = figure.of
    if figure.weigh:
        return f"{RIGHT[what]} and {what} against {figure.weigh} where {described(figure.where)}"
    if figure.best:
        return f"{figure.best} with the best {what} where {described(figure.where)}"
    if figure.fit:
        return f"R2 of {what} against {figure.fit} where {described(figure.where)}"
    text = f"{'best ' if figure.top else ''}{what} where {described(figure.where)}"
    for word, other in (("minus", figure.minus), ("over", figure.over)):
        if other:
            text += f" {word} where {described(other)}"
    return text
