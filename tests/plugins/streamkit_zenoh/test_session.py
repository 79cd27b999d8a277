"""Sessions find each other on one machine, stay on it, and open and close within time limits."""

import contextlib
import json
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from streamkit_zenoh.configuration import (
    Reach,
    SessionFailure,
    SessionMode,
    SessionSettings,
    error_line,
    local_configuration,
)
from streamkit_zenoh.session import close_session, open_session
from tests.waiting import wait_for

Opener = Callable[..., zenoh.Session]


def _peers(session: zenoh.Session) -> set[str]:
    return {str(peer) for peer in session.info.peers_zid()}


@pytest.mark.usefixtures("meeting_ports")
def test_sessions_meet_without_endpoints(open_test_session: Opener) -> None:
    """Four sessions opened in sequence all find each other."""
    sessions = [open_test_session() for _ in range(4)]
    names = {str(session.info.zid()) for session in sessions}
    for session in sessions:
        expected = names - {str(session.info.zid())}
        assert wait_for(lambda session=session, expected=expected: _peers(session) >= expected)


@pytest.mark.usefixtures("meeting_ports")
def test_many_sessions_meet_without_multicast(open_test_session: Opener) -> None:
    """A machine with twenty feeds: the first session is connected to all others."""
    first, *others = [open_test_session() for _ in range(20)]
    names = {str(session.info.zid()) for session in others}
    assert wait_for(lambda: _peers(first) >= names, 30)


@pytest.mark.usefixtures("meeting_ports")
def test_a_client_without_endpoints_finds_a_session_of_this_machine(
    open_test_session: Opener, key: str
) -> None:
    """By the meeting ports, as peers do."""
    open_test_session()
    publisher = open_test_session().declare_publisher(key)
    client = open_test_session(mode=SessionMode.CLIENT)
    received = threading.Event()
    client.declare_subscriber(key, zenoh.handlers.Callback(lambda _: received.set(), indirect=False))
    assert wait_for(lambda: publisher.matching_status.matching)
    publisher.put(b"x")
    assert received.wait(5)


def test_a_client_without_peer_fails_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, meeting_ports: range
) -> None:
    """The error stays short however many ports were tried."""
    monkeypatch.setattr("streamkit_zenoh.configuration.CLIENT_CONNECT_LIMIT_MS", 200)
    tried = f"{meeting_ports[0]} to {meeting_ports[-1]}"
    with pytest.raises(
        SessionFailure, match=rf"no session answers at tcp/127\.0\.0\.1:{tried}; start a publisher"
    ):
        open_session(SessionSettings(mode=SessionMode.CLIENT))


@pytest.mark.usefixtures("meeting_ports")
def test_sessions_that_open_at_once_meet(open_test_session: Opener) -> None:
    """Two sessions that start at the same moment find each other."""
    together = threading.Barrier(2)
    sessions: list[zenoh.Session] = []

    def open_one() -> None:
        together.wait(5)
        sessions.append(open_test_session())

    threads = [threading.Thread(target=open_one) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    one, other = sessions
    assert wait_for(lambda: str(other.info.zid()) in _peers(one))


@pytest.mark.usefixtures("meeting_ports")
def test_a_local_session_listens_on_loopback_only(open_test_session: Opener) -> None:
    """No other machine can connect by default."""
    locators = [
        str(link.src)
        for session in [open_test_session(), open_test_session()]
        for link in session.info.links()
    ]
    assert locators
    assert all("127.0.0.1" in locator or "[::1]" in locator for locator in locators)


def test_ports_in_use_are_skipped(open_test_session: Opener, meeting_ports: range) -> None:
    """With every meeting port in use by others, a session still opens."""
    with contextlib.ExitStack() as in_use:
        for port in meeting_ports:
            in_use.enter_context(socket.create_server(("127.0.0.1", port)))
        assert not open_test_session().is_closed()


@pytest.mark.parametrize(("text", "count"), [(None, 64), ("", 64), ("7520-7520", 1)])
def test_a_variable_names_the_meeting_ports(
    monkeypatch: pytest.MonkeyPatch, text: str | None, count: int
) -> None:
    """Sessions of a client are searched at these ports only."""
    if text is None:
        monkeypatch.delenv("STREAMKIT_MEETING_PORTS")
    else:
        monkeypatch.setenv("STREAMKIT_MEETING_PORTS", text)
    config = local_configuration(SessionSettings(mode=SessionMode.CLIENT), None)
    assert len(json.loads(config.get_json("connect/endpoints"))) == count


@pytest.mark.usefixtures("meeting_ports")
def test_sessions_with_other_meeting_ports_do_not_meet(
    monkeypatch: pytest.MonkeyPatch, open_test_session: Opener, endpoint: str
) -> None:
    """Two groups on one machine: each session finds those of its own group."""
    first = open_test_session()
    port = endpoint.rpartition(":")[2]
    monkeypatch.setenv("STREAMKIT_MEETING_PORTS", f"{port}-{int(port) + 9}")
    other, third = open_test_session(), open_test_session()
    assert wait_for(lambda: _peers(other) == {str(third.info.zid())})
    assert _peers(first) == set()


def test_peers_meet_at_an_endpoint_in_either_order(open_test_session: Opener, endpoint: str) -> None:
    """A peer retries: the one that connects may start first."""
    first = open_test_session(connect=endpoint)
    second = open_test_session(listen=endpoint)
    assert wait_for(lambda: str(second.info.zid()) in _peers(first))


def test_a_client_connects_to_a_publisher_directly(
    open_test_session: Opener, endpoint: str, key: str
) -> None:
    """No router is needed between a client and the session it names."""
    publisher = open_test_session(listen=endpoint).declare_publisher(key)
    client = open_test_session(mode=SessionMode.CLIENT, connect=endpoint)
    received = threading.Event()
    client.declare_subscriber(key, zenoh.handlers.Callback(lambda _: received.set(), indirect=False))
    assert wait_for(lambda: publisher.matching_status.matching)
    publisher.put(b"x")
    assert received.wait(5)


def test_peers_meet_through_a_router(
    open_test_session: Opener, endpoint: str, key: str, tmp_path: Path
) -> None:
    """Peers that name the same router exchange records."""
    configuration = tmp_path / "router.json5"
    configuration.write_text(
        json.dumps(
            {
                "mode": "router",
                "listen": {"endpoints": [endpoint]},
                "scouting": {"multicast": {"enabled": False}},
            }
        )
    )
    router = open_test_session(config=str(configuration))
    one, other = open_test_session(connect=endpoint), open_test_session(connect=endpoint)
    publisher, received = one.declare_publisher(key), threading.Event()
    other.declare_subscriber(key, zenoh.handlers.Callback(lambda _: received.set(), indirect=False))
    assert wait_for(lambda: publisher.matching_status.matching)
    publisher.put(b"x")
    assert received.wait(5)
    assert not router.is_closed()


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (SessionSettings(), False),
        (SessionSettings(mode=SessionMode.CLIENT), True),
        (SessionSettings(connect="tcp/127.0.0.1:1"), False),
        (SessionSettings(connect="tcp/10.0.0.1:1"), True),
        (SessionSettings(connect="tcp/10.0.0.1:1", listen="tcp/0.0.0.0:2"), False),
        (SessionSettings(connect="tcp/10.0.0.1:1", mode=SessionMode.PEER), False),
    ],
)
def test_auto_is_a_client_of_other_machines(settings: SessionSettings, expected: bool) -> None:
    """A session that connects to another machine opens no port on this one."""
    assert settings.is_client(settings.connect_endpoints) is expected


def test_an_endpoint_in_use_is_refused(open_test_session: Opener, endpoint: str) -> None:
    """The error names the endpoint, and no position in zenoh's source."""
    open_test_session(listen=endpoint)
    with pytest.raises(SessionFailure, match="in use") as caught:
        open_session(SessionSettings(listen=endpoint))
    assert endpoint in str(caught.value)
    assert ".rs" not in str(caught.value)


def test_a_client_without_its_router_fails(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error has a remedy."""
    monkeypatch.setattr("streamkit_zenoh.configuration.CLIENT_CONNECT_LIMIT_MS", 200)
    with pytest.raises(SessionFailure, match="start the router or name another endpoint"):
        open_session(SessionSettings(mode=SessionMode.CLIENT, connect=endpoint))


def test_opening_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call of zenoh that hangs is abandoned; a session it opens later is closed."""
    release, closed = threading.Event(), threading.Event()

    class _Late:
        def close(self) -> None:
            closed.set()

    def hang(_config: zenoh.Config) -> _Late:
        release.wait(10)
        return _Late()

    monkeypatch.setattr(zenoh, "open", hang)
    with pytest.raises(SessionFailure, match=r"no session within 0\.1 s"):
        open_session(SessionSettings(listen="tcp/127.0.0.1:0"), limit_s=0.1)
    release.set()
    assert closed.wait(5)


def test_closing_is_bounded() -> None:
    """A session that does not close is abandoned in a thread that is no daemon."""
    release = threading.Event()

    class _Stuck:
        def close(self) -> None:
            release.wait(10)

    assert not close_session(_Stuck(), 0.1)  # type: ignore[arg-type]
    cancelled = threading.Event()
    cancelled.set()
    assert not close_session(_Stuck(), 60.0, cancelled)  # type: ignore[arg-type]
    left = [thread for thread in threading.enumerate() if thread.name.startswith("zenoh call")]
    assert len(left) == 2
    assert not any(thread.daemon for thread in left)
    release.set()
    for thread in left:
        thread.join(5)
        assert not thread.is_alive()


def test_declarations_are_undeclared_before_the_close() -> None:
    """A session closed before its declarations may hang."""
    calls: list[str] = []

    class _Session:
        def close(self) -> None:
            calls.append("close")

    undeclare = (lambda: calls.append("one"), lambda: calls.append("two"))
    assert close_session(_Session(), 5.0, undeclare=undeclare)  # type: ignore[arg-type]
    assert calls == ["one", "two", "close"]


def test_a_failing_undeclare_does_not_prevent_the_close() -> None:
    """Zenoh refuses to undeclare what is in use: the session closes, and the caller is notified."""
    calls: list[str] = []

    class _Session:
        def close(self) -> None:
            calls.append("close")

    def refuse() -> None:
        raise RuntimeError("Already borrowed")

    assert not close_session(_Session(), 5.0, undeclare=(refuse,))  # type: ignore[arg-type]
    assert calls == ["close"]


def test_a_configuration_file_is_the_base(open_test_session: Opener, endpoint: str, tmp_path: Path) -> None:
    """The file applies where no setting overrides it."""
    path = tmp_path / "zenoh.json5"
    path.write_text(json.dumps({"mode": "peer", "listen": {"endpoints": [endpoint]}}))
    listener = open_test_session(config=str(path))
    other = open_test_session(connect=endpoint)
    assert wait_for(lambda: str(listener.info.zid()) in _peers(other))


@pytest.mark.parametrize("content", [None, "{mode: ", '{"mode": "king"}'])
def test_a_bad_configuration_file_is_refused(content: str | None, tmp_path: Path) -> None:
    """The error names the file."""
    path = tmp_path / "zenoh.json5"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SessionFailure, match=r"zenoh configuration .*zenoh\.json5"):
        open_session(SessionSettings(config=str(path)))


def test_reach_network_listens_to_the_network(open_test_session: Opener) -> None:
    """Only when asked does a session take part in the local network."""
    session = open_test_session(reach=Reach.NETWORK)
    assert not session.is_closed()


def test_errors_become_one_line() -> None:
    """Positions in zenoh's source and secrets are removed."""
    error = RuntimeError(
        "no way to tls/a:1#key=SECRET [x at /build/src/io/tcp.rs:61.] at /build/src/unicast.rs:338."
    )
    assert error_line(error) == "no way to tls/a:1#*** [x]"
