"""Keys and endpoints of one test, and sessions that are closed after it."""

import socket
import uuid
from collections.abc import Callable, Iterator

import pytest
import zenoh

from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session


@pytest.fixture
def key() -> str:
    """A key of this test alone: tests may run in parallel."""
    return f"test/{uuid.uuid4().hex}"


@pytest.fixture
def endpoint() -> str:
    """A free endpoint on loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def open_test_session() -> Iterator[Callable[..., zenoh.Session]]:
    """Opens sessions with the settings given; all are closed after the test."""
    sessions: list[zenoh.Session] = []

    def opened(**settings: object) -> zenoh.Session:
        sessions.append(open_session(SessionSettings(**settings)))  # type: ignore[arg-type]
        return sessions[-1]

    yield opened
    for session in sessions:
        close_session(session, 5.0)
