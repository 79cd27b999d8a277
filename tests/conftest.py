"""Fixtures shared by every test."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared_folder() -> Path:
    """The shared folder with real data and conformance cases; skips the test where it is not there."""
    value = os.environ.get("STREAMKIT_DATA")
    if not value:
        pytest.skip("STREAMKIT_DATA is unset: this test needs the shared data folder")
    return Path(value)


@pytest.fixture(scope="session")
def streamkit_data(shared_folder: Path) -> Path:
    """The `data` folder with real videos, pictures and telemetry."""
    return shared_folder / "data"
