"""Units to the workers of a Dask cluster that runs already. Logs are read from a path that all share."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from gapeval.errors import ConfigError, GapevalError
from gapeval.sweep.executor import Stopped, Submit, Work, Workers, WrongWorkersError, one_thread
from gapeval.sweep.provenance import MISSING, code, content_sample
from gapeval.sweep.units import Task, Unit

if TYPE_CHECKING:
    from distributed import Client

CONNECT = 10  # s


def scheduler_address(url: str) -> str:
    """`dask://host:port` as Dask writes it. Raises ConfigError."""
    parts = urlsplit(url)
    with suppress(ValueError):  # of a port that is no number
        if parts.scheme == "dask" and parts.hostname and parts.port and not parts.path.strip("/"):
            return f"tcp://{parts.netloc}"
    raise ConfigError(f"--executor {url}: expected dask://HOST:PORT, where `dask scheduler` listens")


@contextmanager
def connected(url: str) -> Iterator["Client"]:
    """A connection to a scheduler. Raises GapevalError where there is none."""
    address = scheduler_address(url)
    try:
        from distributed import Client
    except ImportError as error:
        raise GapevalError(f"--executor {url}: needs pip install 'gapeval[cluster]'") from error
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("distributed"):  # what matters is said in our own words
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise GapevalError(f"--executor {url}: no scheduler answers there; start `dask scheduler`") from error
    try:
        yield client
    finally:
        client.close(timeout=CONNECT)


def on_cluster(client: "Client", url: str, work: Work[Task, Unit], task: Task) -> Workers[Unit]:
    """All workers of a cluster. Raises GapevalError unless they have the same code and logs as we do."""
    absolute = tuple(replace(recording, path=recording.path.resolve()) for recording in task.recordings)
    task = replace(task, recordings=absolute)
    threads: Mapping[str, int] = client.nthreads()
    if not threads:
        raise GapevalError(f"--executor {url}: no workers there; start some with `dask worker`")
    check(client, [str(recording.path) for recording in absolute])

    @contextmanager
    def begin() -> Iterator[Submit[Unit]]:
        try:
            order = client.scatter((work, task, code()), broadcast=True, hash=False)
            executor = client.get_executor()
            try:
                yield lambda unit: _submitted(executor, order, unit)
            finally:
                with suppress(Exception):  # of a connection that is lost
                    executor.shutdown(wait=False)
        except GapevalError:
            raise
        except (CancelledError, OSError, RuntimeError) as error:
            raise GapevalError(
                f"--executor {url}: lost the connection to the cluster; run the same command again"
            ) from error

    return Workers(begin, 2 * sum(threads.values()))


def _submitted(executor: Any, order: Any, unit: Unit) -> "Future[bytes]":
    future: Future[bytes] = executor.submit(_work, order, unit)
    return future


def _work(order: tuple[Work[Task, Unit], Task, Mapping[str, str]], unit: Unit) -> bytes:
    work, task, expected = order
    if unlike := differing(expected, code()):  # a worker that came later was not asked before
        raise WrongWorkersError(f"a worker that joined later differs: {unlike}; end it, and go on")
    one_thread()
    return work(task, unit, _cancelled())


def _cancelled() -> Stopped:
    """Whether nobody waits any more for what this thread does."""
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()

    def cancelled() -> bool:
        known = worker.state.tasks.get(key)
        return known is None or known.state == "cancelled"

    return cancelled


# --- are all workers alike? --------------------------------------------------------------------------


def check(client: "Client", logs: Sequence[str]) -> None:
    """Raises GapevalError with the first worker that has other code, libraries or logs, and which."""
    ours = {"gapeval": code()["gapeval"]}
    _compare(ours, _ask(client, version, "gapeval"), lambda found: {"gapeval": found})
    _compare(code() | log_facts(logs), _ask(client, facts, logs), dict)


def facts(logs: Sequence[str]) -> dict[str, str]:
    """What must be the same on all workers."""
    return dict(code()) | log_facts(logs)


def log_facts(logs: Sequence[str]) -> dict[str, str]:
    """Of each log: its size, and a digest of the beginning and end of its files."""
    return {path: content_sample(Path(path)) for path in logs}


def differing(ours: Mapping[str, str], theirs: Mapping[str, str]) -> str:
    """The first difference, in words; empty if there is none."""
    for name, value in ours.items():
        found = theirs.get(name, MISSING)
        if found != value:
            return f"{name} is {found}, here {value}"
    return ""


def _ask(client: "Client", question: Callable[..., Any], *about: Any) -> dict[str, Any]:
    try:
        answers: dict[str, Any] = client.run(question, *about, on_error="return")
    except Exception as error:  # of any kind, where a worker cannot even load the question
        raise GapevalError(f"a worker cannot be asked for its version: {error}; is gapeval there?") from error
    return answers


def _compare(
    ours: Mapping[str, str], answers: Mapping[str, Any], read: Callable[[Any], Mapping[str, str]]
) -> None:
    for worker, answer in sorted(answers.items()):
        if isinstance(answer, Exception):
            text = " ".join(str(answer).split())
            raise GapevalError(f"worker {worker}: {type(answer).__name__}: {text}; install gapeval there")
        if unlike := differing(ours, read(answer)):
            raise GapevalError(f"worker {worker}: {unlike}; all workers need the same code and logs")
