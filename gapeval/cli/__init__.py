"""The command line: parse, call, print. Nothing heavy is imported before a command needs it."""

import errno
import os
import sys
from typing import Any

import click

from gapeval import __version__
from gapeval.cli.baseline import baseline
from gapeval.cli.compare import compare
from gapeval.cli.demo import demo
from gapeval.cli.detect import detect
from gapeval.cli.info import info
from gapeval.cli.labels import labels
from gapeval.cli.report import report
from gapeval.cli.score import score
from gapeval.cli.simulate import simulate
from gapeval.cli.study import study
from gapeval.cli.sweep import sweep
from gapeval.errors import ConfigError, GapevalError

INTERRUPTED = 130

# One thread per process, before numpy is imported: the last bit of a sum must not depend on the cores.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="gapeval")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option("-v", "--verbose", is_flag=True, help="Say more about what is read and where time goes.")
@click.pass_context
def cli(context: click.Context, debug: bool, verbose: bool) -> None:
    """How well does terrain-gap detection work on your recorded LIDAR logs, and with which parameters?

    Reads ROS 1 bags, ROS 2 bags and MCAP logs, runs the detector of "Mind the gap" (Sinha & Papadakis,
    Robotica 2013), and scores it against hand-labelled gaps.

    \b
    Example:
      gapeval info drive.mcap
      gapeval labels image drive.mcap -o labelling/
      gapeval sweep drive.mcap --labels gaps.geojson --config configs/paper.yaml -p k=5,6,7 -o results/
    """
    context.obj = {"debug": debug, "verbose": verbose}


for _command in (info, detect, score, sweep, study, report, compare, baseline, labels, simulate, demo):
    cli.add_command(_command)


def main(arguments: list[str] | None = None) -> None:
    """Run a command; errors are one line. Exit status: 0 fine, 1 error, 2 usage, 3 regression,
    4 not comparable, 130 interrupted."""
    debug = "--debug" in (sys.argv[1:] if arguments is None else arguments)
    try:
        status: Any = cli.main(arguments, prog_name="gapeval", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt) as interrupt:
        # click hides the interrupt of a command behind an Abort.
        what_to_do = str(interrupt) or str(interrupt.__cause__ or "")
        click.echo(f"gapeval: interrupted{what_to_do and '; ' + what_to_do}", err=True)
        sys.exit(INTERRUPTED)
    except GapevalError as error:
        if debug:
            raise
        click.echo(f"gapeval: {error}", err=True)
        sys.exit(2 if isinstance(error, ConfigError) else 1)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our output went away; that is its right
        sys.exit(1)
    except Exception as error:
        if debug:
            raise
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            where = error.filename or "the output"
            click.echo(f"gapeval: {where} cannot be written: {error.strerror}; make room first", err=True)
            sys.exit(1)
        click.echo(
            f"gapeval: a bug of ours: {type(error).__name__}: {error}; please report what --debug shows",
            err=True,
        )
        sys.exit(1)
    sys.exit(status if isinstance(status, int) else 0)
