"""SessionSettings, the endpoints that users write, and the zenoh configuration that follows from them."""

import ipaddress
import json
import os
import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import zenoh

from streamkit import mask_secrets
from streamkit.settings import setting

PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws")
ENDPOINT = re.compile(
    rf"(?P<protocol>{'|'.join(PROTOCOLS)})/(?P<host>\[[0-9a-fA-F:.%a-z]+\]|[^/:\s?#\[\]]+):(?P<port>\d{{1,5}})"
    r"(?P<metadata>\?[^#\s]*)?(?P<config>#\S*)?"
)
SOCKET_FILE = re.compile(r"(unixsock-stream|unixpipe)/[^\s?#]+")
DEFAULT_MEETING_PORTS = range(7450, 7514)
PORTS_VARIABLE = "STREAMKIT_MEETING_PORTS"
CLIENT_CONNECT_LIMIT_MS = 5_000
# After so long without a message the peer closes the link; zenoh's default of 10 s detects a dead link late.
LEASE_MS = 2_500
# Bounds the memory that a message from the network takes; a mosaic must fit.
MESSAGE_LIMIT_BYTES = 128 * 1024 * 1024
ALWAYS: dict[str, object] = {
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2},
    "transport/link/tx/lease": LEASE_MS,
    "transport/link/rx/max_message_size": MESSAGE_LIMIT_BYTES,
    # A record in shared memory is lost when its publisher closes before it is read.
    "transport/shared_memory/enabled": False,
}
CONNECT, LISTEN, SCOUTING = "connect/endpoints", "listen/endpoints", "scouting/multicast/enabled"
# Position in zenoh's source code, which its errors end with.
SOURCE_POSITION = re.compile(r"\s+at /\S+\.rs:\d+\.?")


class InvalidEndpoint(ValueError):
    """A text is not an endpoint; the message masks its secrets."""


def endpoints(text: str | None) -> tuple[str, ...]:
    """Splits a list of endpoints at commas and checks each.

    Args:
        text: for example `tcp/192.168.0.7:7447,tcp/[::1]:7448`; None and blanks give none.

    Raises:
        InvalidEndpoint: one is not PROTOCOL/HOST:PORT.
    """
    parts = tuple(part.strip() for part in (text or "").split(",") if part.strip())
    for part in parts:
        match = ENDPOINT.fullmatch(part)
        if (match is None or int(match["port"]) > 65535) and not SOCKET_FILE.fullmatch(part):
            raise InvalidEndpoint(
                f"an endpoint must be PROTOCOL/HOST:PORT with one of {', '.join(PROTOCOLS)}, "
                f"got {mask_secrets(part)!r}; write for example tcp/192.168.0.7:7447"
            )
    return parts


def is_local(endpoint: str) -> bool:
    """Whether an endpoint stays on this machine: loopback addresses, `localhost` and socket files."""
    match = ENDPOINT.fullmatch(endpoint)
    if match is None:
        return SOCKET_FILE.fullmatch(endpoint) is not None
    return is_loopback(match["host"].strip("[]"))


def is_loopback(host: str) -> bool:
    """Whether only processes of this machine reach an address or name."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_secure(endpoint: str) -> bool:
    """Whether its link is encrypted."""
    return endpoint.startswith(("tls/", "quic/"))


class SessionMode(StrEnum):
    """Role of a session: peers connect to each other, a client to one router or peer."""

    AUTO = "auto"
    PEER = "peer"
    CLIENT = "client"


class Reach(StrEnum):
    """The sessions that are found without endpoints: those on this machine, or on the local network."""

    LOCAL = "local"
    NETWORK = "network"


class SessionFailure(OSError):
    """A session cannot be opened; the message says why, without secrets."""


@dataclass(frozen=True)
class SessionSettings:
    """How a session is opened; each field but `cut_off_s` is a property of zenohsink and zenohsrc.

    Attributes:
        cut_off_s: how long a receiver that takes nothing may block a sender before its link is closed.
    """

    connect: str | None = setting(
        None,
        doc="Endpoints to connect to, with commas: tcp/HOST:PORT of a router, a publisher or a receiver.",
    )
    listen: str | None = setting(None, doc="Endpoints to listen on, with commas: tcp/0.0.0.0:7447.")
    mode: SessionMode = setting(
        SessionMode.AUTO,
        doc="auto: a client where connect names another machine and nothing is listened on, else a peer.",
    )
    reach: Reach = setting(
        Reach.LOCAL,
        doc="Sessions found without connect and listen: those on this machine, or on the local network.",
    )
    config: str | None = setting(
        None, file="read", doc="A zenoh configuration file (JSON5), for TLS, passwords and everything else."
    )
    cut_off_s: float = 5.0

    @property
    def connect_endpoints(self) -> tuple[str, ...]:
        """The endpoints of `connect`; raises InvalidEndpoint."""
        return endpoints(self.connect)

    @property
    def listen_endpoints(self) -> tuple[str, ...]:
        """The endpoints of `listen`; raises InvalidEndpoint."""
        return endpoints(self.listen)

    def is_client(self, connect: tuple[str, ...]) -> bool:
        """Whether a session that connects to these endpoints is a client."""
        remote = any(not is_local(endpoint) or is_secure(endpoint) for endpoint in connect)
        automatic = self.mode is SessionMode.AUTO and remote and not self.listen_endpoints
        return self.mode is SessionMode.CLIENT or automatic


def error_line(error: BaseException) -> str:
    """A zenoh error as one line, without secrets and positions in zenoh's source code."""
    return mask_secrets(SOURCE_POSITION.sub("", str(error)).strip())


def base_configuration(settings: SessionSettings) -> zenoh.Config:
    """The configuration file, or zenoh's defaults, with what streamkit always sets.

    Raises:
        SessionFailure: the file cannot be read.
    """
    try:
        config = zenoh.Config.from_file(settings.config) if settings.config else zenoh.Config()
    except Exception as error:
        raise SessionFailure(
            f"zenoh configuration {settings.config}: {error_line(error)}; "
            "give a JSON5 file as zenoh documents it"
        ) from None
    if settings.connect_endpoints:
        _put(config, CONNECT, list(settings.connect_endpoints))
    if settings.listen_endpoints:
        _put(config, LISTEN, list(settings.listen_endpoints))
    if settings.mode is not SessionMode.AUTO or not _is_set(config, "mode"):
        _put(config, "mode", "client" if settings.is_client(connected(config)) else "peer")
    if not _is_set(config, "adminspace/enabled"):
        # It shows configuration and partners to any session.
        _put(config, "adminspace/enabled", False)
    cut_off_us = round(settings.cut_off_s * 1e6)
    _put(config, "transport/link/tx/queue/congestion_control/block/wait_before_close", cut_off_us)
    for key, value in ALWAYS.items():
        _put(config, key, value)
    return config


def meeting_ports() -> range:
    """The ports where sessions on one machine find each other without router and multicast.

    Each listens on the first free port and connects to the ports below it. The environment variable
    STREAMKIT_MEETING_PORTS, FIRST-LAST, names others: sessions with other ports are not found.

    Raises:
        SessionFailure: the variable does not name ports.
    """
    text = os.environ.get(PORTS_VARIABLE)
    if not text:
        return DEFAULT_MEETING_PORTS
    match = re.fullmatch(r"(\d{1,5})-(\d{1,5})", text)
    first, last = map(int, match.groups()) if match else (0, 0)
    if not 1 <= first <= last <= 65535:
        raise SessionFailure(
            f"zenoh: {PORTS_VARIABLE} must be two port numbers in ascending order, got {text!r}; "
            f"write for example {PORTS_VARIABLE}=7520-7583"
        )
    return range(first, last + 1)


def meets_locally(settings: SessionSettings) -> bool:
    """Whether neither settings nor file name a partner, so that sessions on this machine are found."""
    config = base_configuration(settings)
    is_set = connected(config) or _is_set(config, LISTEN) or _get(config, SCOUTING)
    return settings.reach is Reach.LOCAL and not is_set and mode_of(config) != "router"


def local_configuration(settings: SessionSettings, port: int | None) -> zenoh.Config:
    """The configuration of a session on this machine that listens on a meeting port, or on any for None."""
    config = base_configuration(settings)
    if mode_of(config) == "client":
        _put(config, "connect/timeout_ms", CLIENT_CONNECT_LIMIT_MS)
    else:
        _put(config, LISTEN, [f"tcp/127.0.0.1:{port or 0}"])
        _put(config, "listen/exit_on_failure", True)
    ports = meeting_ports()
    if port is not None:
        ports = range(ports.start, port)
    _put(config, CONNECT, [f"tcp/127.0.0.1:{lower}" for lower in ports])
    _put(config, SCOUTING, False)
    # Gossip would introduce this session to machines that another local session knows.
    _put(config, "scouting/gossip/enabled", False)
    return config


def configuration(settings: SessionSettings) -> zenoh.Config:
    """The configuration of a session with endpoints, from settings or file, or on the local network."""
    config = base_configuration(settings)
    connect, mode = connected(config), mode_of(config)
    if connect and mode == "client":
        _put(config, "connect/timeout_ms", CLIENT_CONNECT_LIMIT_MS)
    if settings.listen_endpoints:
        _put(config, "listen/exit_on_failure", True)
    if settings.reach is Reach.NETWORK:
        return config
    if not _is_set(config, LISTEN):
        _put(config, LISTEN, _default_listen(connect, mode))
    if not _get(config, SCOUTING):
        # A session with a scouting socket connects to the address in a forged HELLO, and sends there all it
        # publishes. zenoh binds that socket to all interfaces, whatever `scouting/multicast/interface` says.
        _put(config, SCOUTING, False)
    # A router introduces its peers to each other by gossip. A session that only listens needs no
    # introduction, and an attacker could introduce it to any address.
    if not connect and not _is_set(config, "scouting/gossip/autoconnect"):
        _put(config, "scouting/gossip/autoconnect", {"router": [], "peer": []})
    named = (*connect, *_endpoints(config, LISTEN))
    if any(is_secure(endpoint) for endpoint in named) and not _is_set(config, "transport/link/protocols"):
        # No plain-text link to a peer that is introduced over an encrypted one.
        _put(config, "transport/link/protocols", sorted({name.partition("/")[0] for name in named}))
    return config


def _default_listen(connect: tuple[str, ...], mode: str) -> list[str]:
    """Endpoints to listen on by default: none in plain text next to an encrypted link.

    A router introduces peers and does not forward records between them: each must be reachable.
    """
    if mode == "client" or any(is_secure(endpoint) for endpoint in connect):
        return []
    if mode == "router":
        return ["tcp/127.0.0.1:7447"]
    return ["tcp/127.0.0.1:0" if all(map(is_local, connect)) else "tcp/[::]:0"]


def connected(config: zenoh.Config) -> tuple[str, ...]:
    """The endpoints that a session connects to."""
    return _endpoints(config, CONNECT)


def mode_of(config: zenoh.Config) -> str:
    """Role of a session with this configuration: peer, client or router."""
    return str(_get(config, "mode") or "peer")


def _endpoints(config: zenoh.Config, key: str) -> tuple[str, ...]:
    found = _get(config, key) or ()
    if isinstance(found, dict):
        found = [endpoint for named in found.values() for endpoint in named]
    return tuple(map(str, found))


def _get(config: zenoh.Config, key: str) -> Any:
    return json.loads(config.get_json(key))


def _is_set(config: zenoh.Config, key: str) -> bool:
    """Whether the configuration differs from zenoh's default."""
    return bool(_get(config, key) != _get(zenoh.Config(), key))


def _put(config: zenoh.Config, key: str, value: object) -> None:
    config.insert_json5(key, json.dumps(value))
