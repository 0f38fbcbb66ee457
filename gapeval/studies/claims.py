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


@dataclass(frozen=True, slots=True)
class Answer:
    """What was found for one value of a claim's `by`, or for all. sure: no interval was wanting."""

    group: Value | None
    verdict: str
    measured: str
    sure: bool = True


def _judge(name: str, claim: Claim, rows: Sequence[Row]) -> Judged:
    answers = [_answer(name, claim, group, rows) for group in _groups(claim, rows)]
    verdict = overall([answer.verdict for answer in answers])
    basis = BY_INTERVALS if all(answer.sure for answer in answers) else BY_VALUES
    return Judged(
        study=name,
        claim=claim.claim,
        section=claim.section,
        words=claim.words,
        measured="; ".join(answer.measured for answer in answers),
        verdict=verdict,
        basis="" if verdict == NOT_MEASURED else basis,
        conditions=_conditions(claim, answers),
        rule=claim.holds + (f"; partly: {claim.partly}" if claim.partly else ""),
        source=f"{name}.csv: " + "; ".join(f"{key}: {_source(one)}" for key, one in claim.figures.items()),
    )


def _groups(claim: Claim, rows: Sequence[Row]) -> list[Value | None]:
    """The values of `by` for which the rule is asked; only None where there is no `by`."""
    if not claim.by:
        return [None]
    wanted = {key: value for key, value in claim.where.items() if key != claim.by}
    there = [row.keys.get(claim.by) for row in rows if fits(row, wanted, claim.by)]
    return [one for one in claim.among or dict.fromkeys(there) if one is not None and one != ALL]


def _answer(name: str, claim: Claim, group: Value | None, rows: Sequence[Row]) -> Answer:
    where = claim.where if group is None else claim.where | {claim.by: group}
    about = "" if group is None else f"{claim.by} {written(group)}: "
    try:
        found = {
            key: _evaluated(figure, where, rows, f"study {name}: claims.{claim.claim}.{key}")
            for key, figure in claim.figures.items()
        }
    except NoRowError as error:
        return Answer(group, NOT_MEASURED, f"{about}{error}")
    text = ", ".join(f"{key} {shown(one)}" for key, one in found.items())
    sure = all(one.value is None or one.low is not None for one in asked_by(claim, found))
    return Answer(group, _verdict(name, claim, found), about + text, sure)


def _conditions(claim: Claim, answers: Sequence[Answer]) -> str:
    """What is fixed, and for which values of `by` the claim holds and does not."""
    parts = [f"{key} {written(value)}" for key, value in claim.where.items() if value != ""]
    found = [", ".join(parts)]
    for kind in (HOLDS, PARTLY, DOES_NOT, NOT_MEASURED):
        groups = [answer.group for answer in answers if answer.verdict == kind]
        if claim.by and groups:
            found.append(f"{kind}: {claim.by} {', '.join(map(written, groups))}")
    return "; ".join(filter(None, found))


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
