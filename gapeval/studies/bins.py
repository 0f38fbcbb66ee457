"""How radial bins match the spacing of echoes (Section 4.2.1, Fig. 9): on ground without gaps."""

from collections.abc import Callable, Sequence

from gapeval.logs.read import Recording
from gapeval.studies.cases import Planned
from gapeval.studies.rows import Row


def bin_rows(planned: Planned, opened: Sequence[Recording], advance: Callable[[int], object]) -> list[Row]:
    return []
