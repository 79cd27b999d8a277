"""The tests' own RTSP server."""

import importlib.util
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


def load(file: str) -> ModuleType:
    """A module in the folder of the tests."""
    name = f"streamkit_media_{Path(file).stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(file))
        assert spec is not None
        assert spec.loader is not None
        module = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture(scope="session")
def fake() -> ModuleType:
    """The module of the server: `FakeServer`, `Behaviour`, `access_units`."""
    return load("fake_server.py")


@pytest.fixture(scope="session")
def proxy() -> ModuleType:
    """The module of the bad network: `LossyProxy`."""
    return load("lossy_proxy.py")


@pytest.fixture(scope="session")
def units(fake: ModuleType) -> list[bytes]:
    """60 frames of 64 x 48; frame i is of brightness 40 + 2 * i, every 15th a key frame."""
    return fake.access_units()


@pytest.fixture
def start_server(fake: ModuleType, units: list[bytes]) -> Iterator[Callable[..., Any]]:
    """Starts a server that plays; arguments: behaviour, and attributes of FakeServer."""
    with ExitStack() as stack:

        def start(behaviour: str = "play", **attributes: Any) -> Any:
            attributes.setdefault("units", units)
            return stack.enter_context(fake.FakeServer(behaviour=fake.Behaviour(behaviour), **attributes))

        yield start
