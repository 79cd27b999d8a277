"""A session opens to the network what its settings name, and nothing else."""

import json
from pathlib import Path
from typing import Any

import pytest

from streamkit_zenoh.configuration import (
    LEASE_MS,
    MESSAGE_LIMIT_BYTES,
    Reach,
    SessionFailure,
    SessionMode,
    SessionSettings,
    configuration,
    local_configuration,
    meeting_ports,
    meets_locally,
)


def _settings(path: Path, content: dict[str, Any], **more: Any) -> SessionSettings:
    path.write_text(json.dumps(content), encoding="utf-8")
    return SessionSettings(config=str(path), **more)


def _found(settings: SessionSettings, key: str) -> Any:
    return json.loads(configuration(settings).get_json(key))


@pytest.mark.parametrize(
    ("content", "local"),
    [
        ({}, True),
        ({"transport": {"auth": {"usrpwd": {"user": "a", "password": "b"}}}}, True),
        ({"connect": {"endpoints": ["tcp/10.0.0.1:7447"]}}, False),
        ({"listen": {"endpoints": ["tcp/10.0.0.1:7447"]}}, False),
        ({"scouting": {"multicast": {"enabled": True}}}, False),
        ({"scouting": {"multicast": {"enabled": False}}}, True),
        ({"mode": "router"}, False),
    ],
)
def test_a_file_without_endpoints_stays_on_this_machine(
    tmp_path: Path, content: dict[str, Any], local: bool
) -> None:
    """A file that names endpoints or enables scouting leaves the machine."""
    assert meets_locally(_settings(tmp_path / "z.json5", content)) is local


@pytest.mark.parametrize(
    ("content", "listens"),
    [
        ({"connect": {"endpoints": ["tcp/127.0.0.1:1"]}}, ["tcp/127.0.0.1:0"]),
        ({"mode": "peer", "connect": {"endpoints": ["tcp/10.0.0.1:1"]}}, ["tcp/[::]:0"]),
        ({"mode": "peer", "connect": {"endpoints": ["tls/10.0.0.1:1"]}}, []),
        ({"mode": "peer", "connect": {"endpoints": ["tls/127.0.0.1:1"]}}, []),
        ({"mode": "router"}, ["tcp/127.0.0.1:7447"]),
        ({"listen": {"endpoints": ["tls/0.0.0.0:1"]}}, ["tls/0.0.0.0:1"]),
    ],
)
def test_the_default_listening_endpoint_is_limited(
    tmp_path: Path, content: dict[str, Any], listens: list[str]
) -> None:
    """Loopback; all addresses for peers of a router; none in plain text next to an encrypted link."""
    settings = _settings(tmp_path / "z.json5", content)
    assert _found(settings, "listen/endpoints") == listens
    assert _found(settings, "scouting/multicast/enabled") is False


@pytest.mark.parametrize("text", ["7520", "7583-7520", "0-5", "7520-70000", "7520-7583 "])
def test_meeting_ports_that_are_none_are_refused(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """The error names the variable, what it got, and an example."""
    monkeypatch.setenv("STREAMKIT_MEETING_PORTS", text)
    with pytest.raises(
        SessionFailure, match=rf"two port numbers .*got '{text}'; write for example .*=7520-7583"
    ):
        meeting_ports()


@pytest.mark.parametrize("settings", [SessionSettings(), SessionSettings(mode=SessionMode.CLIENT)])
def test_a_local_session_neither_scouts_nor_gossips(settings: SessionSettings) -> None:
    """It finds other sessions by the meeting ports alone."""
    config = local_configuration(settings, meeting_ports()[3])
    assert json.loads(config.get_json("scouting/multicast/enabled")) is False
    assert json.loads(config.get_json("scouting/gossip/enabled")) is False
    assert json.loads(config.get_json("adminspace/enabled")) is False
    expected = [f"tcp/127.0.0.1:{port}" for port in meeting_ports()[:3]]
    assert json.loads(config.get_json("connect/endpoints")) == expected


@pytest.mark.parametrize(
    ("settings", "autoconnect"),
    [
        (SessionSettings(listen="tcp/0.0.0.0:1"), {"router": [], "peer": []}),
        (SessionSettings(connect="tcp/127.0.0.1:1"), None),
        (SessionSettings(reach=Reach.NETWORK), None),
    ],
)
def test_only_a_session_that_connects_follows_gossip(settings: SessionSettings, autoconnect: object) -> None:
    """A session that only listens connects to no address that others name."""
    assert _found(settings, "scouting/gossip/autoconnect") == autoconnect


@pytest.mark.parametrize(
    ("connect", "protocols"),
    [
        ("tls/10.0.0.1:1", ["tls"]),
        ("tls/10.0.0.1:1,quic/10.0.0.2:1", ["quic", "tls"]),
        ("tls/10.0.0.1:1,tcp/127.0.0.1:1", ["tcp", "tls"]),
        ("tcp/10.0.0.1:1", None),
    ],
)
def test_an_encrypted_endpoint_limits_the_protocols(connect: str, protocols: list[str] | None) -> None:
    """A router may introduce plain-text peers: no link to them is opened."""
    settings = SessionSettings(connect=connect, mode=SessionMode.PEER)
    assert _found(settings, "transport/link/protocols") == protocols


def test_properties_override_the_file(tmp_path: Path) -> None:
    """Endpoints of the properties replace those of the file; the mode does so if it is set."""
    content = {
        "mode": "peer",
        "connect": {"endpoints": ["tcp/10.0.0.1:1"]},
        "scouting": {"multicast": {"enabled": True}},
    }
    settings = _settings(tmp_path / "z.json5", content)
    assert _found(settings, "mode") == "peer"
    assert _found(settings, "scouting/multicast/enabled") is True
    above = _settings(tmp_path / "z.json5", content, connect="tcp/10.0.0.2:2", mode=SessionMode.CLIENT)
    assert (_found(above, "mode"), _found(above, "connect/endpoints")) == ("client", ["tcp/10.0.0.2:2"])


@pytest.mark.parametrize(
    ("settings", "mode"),
    [
        (SessionSettings(connect="tcp/127.0.0.1:1"), "peer"),
        (SessionSettings(connect="tls/127.0.0.1:1"), "client"),
        (SessionSettings(connect="tcp/10.0.0.1:1"), "client"),
        (SessionSettings(listen="tcp/0.0.0.0:1"), "peer"),
        (SessionSettings(reach=Reach.NETWORK), "peer"),
    ],
)
def test_the_mode_follows_from_the_endpoints(settings: SessionSettings, mode: str) -> None:
    """A session that only connects to another machine, or encrypted, is a client and listens on nothing."""
    assert _found(settings, "mode") == mode


def test_dead_links_and_large_messages_are_bounded() -> None:
    """A silent link is closed within 3 s; shared memory, which loses records, is off."""
    settings = SessionSettings(listen="tcp/127.0.0.1:0")
    assert _found(settings, "transport/link/tx/lease") == LEASE_MS < 3000
    assert _found(settings, "transport/link/rx/max_message_size") == MESSAGE_LIMIT_BYTES
    assert _found(settings, "transport/shared_memory/enabled") is False


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    """The error names it."""
    with pytest.raises(SessionFailure, match=r"zenoh configuration .*z\.json5"):
        configuration(SessionSettings(config=str(tmp_path / "z.json5")))
