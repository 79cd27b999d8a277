"""The tests' own RTSP server."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import ModuleType
from typing import Any

import pytest


@pytest.fixture
def start_server(fake: ModuleType, units: list[bytes]) -> Iterator[Callable[..., Any]]:
    """Starts a server that plays; arguments: behaviour, and attributes of FakeServer."""
    with ExitStack() as stack:

        def start(behaviour: str = "play", **attributes: Any) -> Any:
            attributes.setdefault("units", units)
            return stack.enter_context(fake.FakeServer(behaviour=fake.Behaviour(behaviour), **attributes))

        yield start
