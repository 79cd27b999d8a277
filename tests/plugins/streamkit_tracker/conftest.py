"""Fixtures of the tracker's tests."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


def _loaded(path: Path) -> ModuleType:
    name = f"streamkit_tracker_test_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def scenes() -> ModuleType:
    """The module of synthetic sequences beside this file."""
    return _loaded(Path(__file__).with_name("scenes.py"))


@pytest.fixture(scope="session")
def layered_and_flat() -> ModuleType:
    """The two ways of sampling, as benchmarks/tracking_layers.py compares them."""
    return _loaded(BENCHMARKS / "layered_and_flat.py")
