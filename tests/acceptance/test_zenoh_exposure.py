"""Sockets of a session: by default only TCP on loopback, and no datagram makes it connect."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import zenoh

from streamkit_zenoh.configuration import Reach, SessionMode, SessionSettings
from streamkit_zenoh.session import close_session, open_session
from tests.acceptance.zenoh_links import BINARY
from tests.ports import free_port
from tests.waiting import wait_for

KEY = "acceptance/exposure"
SCOUTING_GROUP = ("224.0.0.224", 7446)
LISTENING = "0A"
HELLO, HAS_LOCATORS, VERSION, PEER = 0x02, 0x20, 0x09, 0x01
SUBSCRIBER = f"""
import sys
from streamkit_zenoh import TrackSubscriber
with TrackSubscriber({KEY!r}, **dict(word.split("=", 1) for word in sys.argv[1:])) as subscriber:
    sys.stdin.read()
"""
KINDS = {
    "zenohsink": [str(BINARY), "launch", f"videotestsrc ! zenohsink sync=true key={KEY} frame-rate=5"],
    "zenohsrc": [str(BINARY), "launch", f"zenohsrc key={KEY} eos-on-disconnect=false ! fakesink"],
    "subscribe": [str(BINARY), "subscribe", KEY, "--stay"],
    "TrackSubscriber": [sys.executable, "-c", SUBSCRIBER],
    "TrackSubscriber listen": [sys.executable, "-c", SUBSCRIBER, "listen=tcp/127.0.0.1:0"],
    "TrackSubscriber connect": [sys.executable, "-c", SUBSCRIBER, "connect=tcp/127.0.0.1:9"],
    "TrackSubscriber client": [sys.executable, "-c", SUBSCRIBER, "mode=client"],
}


class Socket(NamedTuple):
    """A socket of a process, as the kernel lists it."""

    protocol: str
    address: str
    port: int
    state: str


def sockets_of(process: int) -> list[Socket]:
    """All internet sockets that a process has open."""
    links = set()
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        with contextlib.suppress(OSError):
            links.add(os.readlink(descriptor))
    found = []
    for protocol in ("tcp", "tcp6", "udp", "udp6", "raw", "raw6"):
        rows = Path(f"/proc/net/{protocol}").read_text(encoding="ascii").splitlines()[1:]
        for row in map(str.split, rows):
            if f"socket:[{row[9]}]" in links:
                address, port = row[1].split(":")
                words = [bytes.fromhex(address[at : at + 8])[::-1] for at in range(0, len(address), 8)]
                family = socket.AF_INET if len(words) == 1 else socket.AF_INET6
                shown = socket.inet_ntop(family, b"".join(words))
                found.append(Socket(protocol, shown, int(port, 16), row[3]))
    return found


def forged_hello(locator: str) -> bytes:
    """A zenoh HELLO of an unknown peer: header, version, kind and size of the identity, locators."""
    identity, place = os.urandom(16), locator.encode()
    head = bytes([HELLO | HAS_LOCATORS, VERSION, (len(identity) - 1) << 4 | PEER])
    return head + identity + bytes([1, len(place)]) + place


class Trap:
    """An address that forged HELLOs name; a session that connects to it has accepted one."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._locator = f"tcp/127.0.0.1:{self._server.getsockname()[1]}"

    def lure(self, process: int) -> None:
        """Sends HELLOs to the scouting group on every interface and to each UDP socket of the process."""
        places = {SCOUTING_GROUP}
        places |= {("127.0.0.1", one.port) for one in sockets_of(process) if one.protocol.startswith("udp")}
        hello = forged_hello(self._locator)
        for _, name in socket.if_nameindex():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                index = socket.if_nametoindex(name)
                request = bytes(8) + index.to_bytes(4, sys.byteorder)
                sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, request)
                for place in places:
                    with contextlib.suppress(OSError):
                        sender.sendto(hello, place)

    def caught(self, limit_s: float) -> bool:
        """Whether a session connects within the time limit."""
        return bool(select.select([self._server], [], [], limit_s)[0])

    def close(self) -> None:
        """Ends it."""
        self._server.close()


@pytest.fixture
def trap() -> Iterator[Trap]:
    """A trap, closed after the test."""
    trap = Trap()
    yield trap
    trap.close()


@contextlib.contextmanager
def running(command: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """A process that runs during the block."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, **environment},
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate(timeout=10)


def is_open(kind: str, sockets: list[Socket]) -> bool:
    """Whether a session of this kind has opened all its sockets."""
    return any((one.state == LISTENING) is not kind.endswith("client") for one in sockets)


@pytest.mark.parametrize("kind", KINDS)
def test_a_default_session_has_loopback_tcp_only(kind: str, trap: Trap, tmp_path: Path) -> None:
    """Whatever zenoh's environment variables are; forged HELLOs have no effect."""
    exposed = tmp_path / "exposed.json5"
    exposed.write_text(
        json.dumps({"listen": {"endpoints": [f"tcp/0.0.0.0:{free_port()}"]}, "adminspace": {"enabled": True}})
    )
    environment = {"ZENOH_CONFIG": str(exposed)}
    # A client connects at once or fails: it needs a peer.
    partner = open_session(SessionSettings())
    try:
        with running(KINDS[kind], environment) as process:
            assert wait_for(lambda: process.poll() is not None or is_open(kind, sockets_of(process.pid)), 30)
            assert process.poll() is None, process.communicate(timeout=10)
            trap.lure(process.pid)
            assert not trap.caught(1.5)
            assert process.poll() is None, process.communicate(timeout=10)
            found = sockets_of(process.pid)
            assert found
            assert {one.protocol for one in found} == {"tcp"}
            assert {one.address for one in found} == {"127.0.0.1"}
    finally:
        close_session(partner, 5.0)


def test_only_reach_network_listens_to_hellos(trap: Trap) -> None:
    """The forged HELLO is valid: with reach=network a session connects to the address it names."""
    session = open_session(SessionSettings(reach=Reach.NETWORK))
    try:
        assert any(one.protocol == "udp" for one in sockets_of(os.getpid()))
        assert wait_for(lambda: trap.lure(os.getpid()) or trap.caught(0.2))
    finally:
        close_session(session, 5.0)


def test_sessions_on_the_network_meet() -> None:
    """By multicast, and only if both have reach=network."""
    one, other = (open_session(SessionSettings(reach=Reach.NETWORK)) for _ in range(2))
    try:
        assert wait_for(lambda: str(other.info.zid()) in {str(peer) for peer in one.info.peers_zid()})
    finally:
        close_session(one, 5.0)
        close_session(other, 5.0)


def _raw_session(port: int, *connect: str) -> zenoh.Session:
    """A session with zenoh's own defaults but scouting: it gossips."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("connect/endpoints", json.dumps(connect))
    return zenoh.open(config)


def test_a_listening_session_follows_no_gossip() -> None:
    """A peer that introduces a third one by gossip has no effect."""
    port = free_port()
    session = open_session(SessionSettings(listen=f"tcp/127.0.0.1:{port}"))
    third = _raw_session(free_port())
    third_port = next(one for one in _listening_ports() if one != port)
    other = _raw_session(free_port(), f"tcp/127.0.0.1:{port}", f"tcp/127.0.0.1:{third_port}")
    try:
        other_id, third_id = str(other.info.zid()), str(third.info.zid())
        assert wait_for(lambda: other_id in {str(peer) for peer in session.info.peers_zid()})
        assert wait_for(lambda: third_id in {str(peer) for peer in other.info.peers_zid()})
        assert not wait_for(
            lambda: any(str(third_port) in str(link.dst) for link in session.info.links()), limit_s=1.0
        )
    finally:
        for opened in (other, third, session):
            close_session(opened, 5.0)


def _listening_ports() -> list[int]:
    return [one.port for one in sockets_of(os.getpid()) if one.state == LISTENING and one.protocol == "tcp"]


@pytest.mark.parametrize("settings", [SessionSettings(), SessionSettings(listen="tcp/127.0.0.1:0")])
def test_the_admin_space_is_off(settings: SessionSettings) -> None:
    """The admin space, which shows configuration and peers, answers no query."""
    session = open_session(settings)
    port = next(one.port for one in sockets_of(os.getpid()) if one.state == LISTENING)
    asking = open_session(SessionSettings(mode=SessionMode.CLIENT, connect=f"tcp/127.0.0.1:{port}"))
    try:
        answers = asking.get("@/**", timeout=2.0)
        # zenoh answers a session's own question about that session itself.
        keys = [str(answer.ok.key_expr) for answer in answers if answer.ok is not None]
        assert [key for key in keys if not key.startswith(f"@/{asking.info.zid()}/")] == []
    finally:
        close_session(asking, 5.0)
        close_session(session, 5.0)
