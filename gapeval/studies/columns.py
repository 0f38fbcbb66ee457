"""The columns of a study's CSV, and whether a study asks for any other."""

import difflib
from collections.abc import Iterator

from gapeval.errors import ConfigError
from gapeval.results.tables import PARAMETERS
from gapeval.scoring.metrics import COUNTS, METRICS
from gapeval.studies.cases import columns_of
from gapeval.studies.definition import Curve, Study

OF_BINS = ("bin_ratio", "bin_mismatch", "bin_filled", "ring_growth", "box_seen")
OF_TIMES = ("points", "median", "p95", "mean", "least", "most")
FIGURES = (*(metric.name for metric in METRICS), *OF_BINS, *OF_TIMES)


def key_columns(study: Study) -> tuple[str, ...]:
    """What a row is about, in the order of the file."""
    return ("scene", *columns_of(study), "by", "group", "configuration", *PARAMETERS, "best")


def named_by(curve: Curve) -> tuple[str, ...]:
    """The columns that a curve is drawn from."""
    return (curve.x, *curve.y, *curve.where, *((curve.lines,) if curve.lines else ()))


def check_columns(name: str, study: Study) -> None:
    """Whether curves and claims ask for columns that there can be. Raises ConfigError."""
    figures = (*FIGURES, "logs", *COUNTS)
    keys = key_columns(study)
    for where, column, is_figure in _asked(study):
        known = figures if is_figure else (*keys, *figures)
        if column and column not in known:
            close = difflib.get_close_matches(column, known, n=1, cutoff=0.6)
            hint = f"; did you mean {close[0]}?" if close else f"; there are {', '.join(known)}"
            raise ConfigError(
                f"study {name}: {where}: no {'figure' if is_figure else 'column'} {column}{hint}"
            )


def _asked(study: Study) -> Iterator[tuple[str, str, bool]]:
    """Where which column is named, and whether it must be a figure; empty where none is."""
    for place, curve in enumerate(study.curves, 1):
        for column in named_by(curve):
            yield f"curves, number {place}", column, column in curve.y
    for claim in study.claims:
        here = f"claims.{claim.claim}"
        yield from ((here, column, False) for column in (*claim.where, claim.by))
        for key, figure in claim.figures.items():
            yield f"{here}.{key}", figure.of, True
            for column in (*figure.where, *figure.minus, *figure.over):
                yield f"{here}.{key}", column, False
            for column in (figure.best, figure.fit, figure.weigh):
                yield f"{here}.{key}", column, False
