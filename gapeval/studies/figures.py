"""The figures that claims ask for, from rows: single ones, differences draw by draw, best values."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gapeval.errors import ConfigError
from gapeval.frame import FloatArray
from gapeval.scoring.metrics import METRICS
from gapeval.studies.definition import Figure, Value, Where
from gapeval.studies.estimates import NOTHING, Estimate, of_draws
from gapeval.studies.rows import ALL, Row

LOWER = {metric.name for metric in METRICS if metric.better == "lower"} | {"bin_mismatch", "median"}
RIGHT = {"fp_per_frame": "hit_rate", "over_area": "coverage"}  # of what is false, its counterpart


class NoRowError(Exception):
    """That a figure asks for: not run, or not on this log."""


def evaluated(figure: Figure, where: Where, rows: Sequence[Row]) -> Estimate:
    """A figure of a claim. Raises NoRowError where there is no row that it asks for."""
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
    found = [row for row in rows if fits(row, where)]
    if not found:
        raise NoRowError(f"no row with {described(where)}")
    if len(found) > 1:
        raise ConfigError(f"{len(found)} rows with {described(where)}; a figure needs one")
    return found[0]


def _top(rows: Sequence[Row], where: Where, of: str) -> Row:
    """The row with the best figure; of equal ones, the first."""
    found = [row for row in rows if fits(row, where) and row.figures.get(of, NOTHING).value is not None]
    if not found:
        raise NoRowError(f"no row with {described(where)}")
    sign = -1.0 if of in LOWER else 1.0
    return max(found, key=lambda row: sign * (row.figures[of].value or 0.0))


def _several(rows: Sequence[Row], where: Where, column: str) -> list[Row]:
    """The rows that differ in a column alone."""
    found = [row for row in rows if fits(row, where, column) and row.keys.get(column) is not None]
    if not found:
        raise NoRowError(f"no row with {described(where)}")
    values = [row.keys[column] for row in found]
    if len(set(values)) < len(values):
        raise ConfigError(
            f"several rows with {described(where)} and equal {column}; a figure needs one of each"
        )
    return found


def fits(row: Row, where: Where, but: str = "") -> bool:
    """Rows are of all scenes and of no group unless these are asked for."""
    usual: Where = {"scene": ALL, "by": ""}
    wanted = {key: value for key, value in (usual | where).items() if key != but}
    return all(_equal(row.keys.get(key), value) for key, value in wanted.items())


def _equal(one: Value | None, other: Value) -> bool:
    return (one is None and other == "") or (
        one == other and isinstance(one, bool) == isinstance(other, bool)
    )


def described(where: Where) -> str:
    """`k=6 n_o=1`."""
    return " ".join(f"{key}={written(value)}" for key, value in where.items()) or "all"


def written(value: Value | None) -> str:
    """A value as people write it."""
    if isinstance(value, float):
        return f"{value:g}"
    return str(value).lower() if isinstance(value, bool) else str(value)
