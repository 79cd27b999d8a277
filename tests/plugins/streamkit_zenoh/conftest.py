"""Keys and endpoints of one test, and sessions that are closed after it."""

import os
import socket
import uuid
from collections.abc import Callable, Iterator

import pytest
import zenoh

from streamkit_zenoh.configuration import PORTS_VARIABLE, SessionSettings
from streamkit_zenoh.session import close_session, open_session
from tests.ports import free_port


@pytest.fixture
def key() -> str:
    """A key of this test alone: tests may run in parallel."""
    return f"test/{uuid.uuid4().hex}"


@pytest.fixture
def endpoint() -> str:
    """A free endpoint on loopback."""
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def meeting_ports(monkeypatch: pytest.MonkeyPatch) -> range:
    """Meeting ports of this test alone, 24 in sequence that are free.

    A zenoh session that closes while another process connects to it may keep that link alive: the other then
    never meets the next session at that port.
    """
    # Tests in other processes look for free ports at the same time.
    first = 20_000 + os.getpid() % 400 * 24
    for start in range(first, 30_000, 24):
        ports = range(start, start + 24)
        if all(map(_is_free, ports)):
            monkeypatch.setenv(PORTS_VARIABLE, f"{ports[0]}-{ports[-1]}")
            return ports
    pytest.fail(f"no 24 free ports in sequence between {first} and 30000")


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


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
