"""What all tests share."""

import os
from functools import partial
from pathlib import Path

import pytest
from logs_writer import write_sorted
from result_folders import swept


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real logs."""
    folder = os.environ.get("GAPEVAL_DATA")
    if not folder:
        pytest.skip("GAPEVAL_DATA is not set: no real logs to test on")
    return Path(folder)


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results of two logs and four configurations: to be copied, not changed."""
    return swept(tmp_path_factory.mktemp("swept"))


@pytest.fixture
def log(tmp_path):
    """Writes a log of records, sorted by time; returns its path."""
    return partial(write_sorted, tmp_path / "log")
