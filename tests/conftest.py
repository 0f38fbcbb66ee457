"""What all tests share."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real logs."""
    folder = os.environ.get("GAPEVAL_DATA")
    if not folder:
        pytest.skip("GAPEVAL_DATA is not set: no real logs to test on")
    return Path(folder)
