"""The columns of a study's CSV, and whether a study asks for any other."""

import difflib
from collections.abc import Iterator

from gapeval.errors import ConfigError
from gapeval.results.tables import PARAMETERS
from gapeval.scoring.metrics import COUNTS, METRICS
from gapeval.studies.cases import columns_of
from gapeval.studies.definition import Curve, Study

OF_BINS = ("bin_ratio", "bin_mismatch", "bin_filled", "ring_growth")
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
    known = (*key_columns(study), *FIGURES, "logs", *COUNTS)
    for where, column in _asked(study):
        if column not in known:
            close = difflib.get_close_matches(column, known, n=1, cutoff=0.6)
            hint = f"; did you mean {close[0]}?" if close else f"; there are {', '.join(known)}"
            raise ConfigError(f"study {name}: {where}: no column {column}{hint}")


def _asked(study: Study) -> Iterator[tuple[str, str]]:
    """Each column that is named, and where."""
    for place, curve in enumerate(study.curves, 1):
        for column in named_by(curve):
            yield f"curves, number {place}", column
    for claim in study.claims:
        of_claim = f"claims.{claim.claim}"
        yield from ((of_claim, column) for column in (*claim.where, *filter(None, (claim.by,))))
        for key, figure in claim.figures.items():
            columns = (*figure.where, *figure.minus, *figure.over, *filter(None, (figure.of, figure.best)))
            yield from ((f"{of_claim}.{key}", column) for column in columns)
            yield from ((f"{of_claim}.{key}", column) for column in (figure.fit, figure.weigh) if column)
