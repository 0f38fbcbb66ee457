"""Run gapeval's command line in this process, as a user would."""

import contextlib
import io
from dataclasses import dataclass

from gapeval.cli import main


@dataclass(frozen=True, slots=True)
class Result:
    status: int
    out: str
    err: str

    @property
    def last_line(self) -> str:
        return self.err.rstrip("\n").rpartition("\n")[2]


def gapeval(*arguments: object) -> Result:
    """Status 0 is not demanded; what is written to both streams is kept."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as end:
            return Result(int(end.code or 0), out.getvalue(), err.getvalue())
    raise AssertionError("main always exits")
