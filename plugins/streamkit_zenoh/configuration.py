"""How a session is to be opened, as settings and as zenoh's own configuration."""

import json
import re
from dataclasses import dataclass, replace
from enum import StrEnum

import zenoh

from streamkit_zenoh.endpoints import is_local, is_secure, redact

# Sessions of one machine find each other here without a router and without multicast: each listens on the
# first free port and connects to those below it, which are taken by the ones before.
MEETING_PORTS = range(7450, 7514)
CLIENT_CONNECT_LIMIT_MS = 5_000
CONNECT_RETRY = {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2}
# How long the other side takes a silent one for alive: with zenoh's own 10 s, a dead link is seen too late.
LEASE_MS = 2_500
# Bounds what a stranger can make this process hold; a mosaic must fit.
MESSAGE_LIMIT_BYTES = 128 * 1024 * 1024
# Where zenoh's own library was built says nothing to a user.
SOURCE_PLACE = re.compile(r"\s+at /\S+\.rs:\d+\.?")


class Mode(StrEnum):
    """How a session takes part: peers find each other, a client speaks to one router or peer."""

    AUTO = "auto"
    PEER = "peer"
    CLIENT = "client"


class Reach(StrEnum):
    """Who is found without endpoints: sessions on this machine, or on the whole local network."""

    LOCAL = "local"
    NETWORK = "network"


class SessionFailure(OSError):
    """A session cannot be opened; says why, without secrets."""


@dataclass(frozen=True)
class SessionSettings:
    """How a session is opened.

    Attributes:
        mode: `auto` is a client where `connect` names another machine or an encrypted link and nothing is
            listened on, else a peer.
        connect: endpoints to connect to; a peer goes on trying, a client needs one of them at once.
        listen: endpoints to listen on.
        reach: who is found where neither is given.
        config: a zenoh configuration file, for TLS, passwords and all else; the rest is put on top of it.
        patience_s: how long a slow receiver may hold up a sender before its link is closed.
    """

    mode: Mode = Mode.AUTO
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    reach: Reach = Reach.LOCAL
    config: str | None = None
    patience_s: float = 5.0

    @property
    def is_client(self) -> bool:
        """Whether the session is a client's."""
        far = any(not is_local(endpoint) or is_secure(endpoint) for endpoint in self.connect)
        return self.mode is Mode.CLIENT or (self.mode is Mode.AUTO and far and not self.listen)


def plain(error: Exception) -> str:
    """Zenoh's error as one line for users: no secrets, no places in its source."""
    return redact(SOURCE_PLACE.sub("", str(error)).strip())


def local_configuration(settings: SessionSettings, port: int | None) -> zenoh.Config:
    """The configuration of a session on this machine that listens at a meeting port, or at any.

    Raises:
        SessionFailure: the configuration file cannot be read.
    """
    config = base_configuration(settings)
    if mode_of(config) == "client":
        _put(config, "connect/timeout_ms", CLIENT_CONNECT_LIMIT_MS)
    else:
        _put(config, "listen/endpoints", [f"tcp/127.0.0.1:{port or 0}"])
        _put(config, "listen/exit_on_failure", True)
    ports = MEETING_PORTS if port is None else range(MEETING_PORTS.start, port)
    _put(config, "connect/endpoints", [f"tcp/127.0.0.1:{lower}" for lower in ports])
    _close_scouting(config)
    # Gossip would make this session known to, and connect it with, machines that a local one knows.
    _put(config, "scouting/gossip/enabled", False)
    return config


def meets_locally(settings: SessionSettings) -> bool:
    """Whether nothing says whom to meet, neither the settings nor the file: then it is this machine.

    Raises:
        SessionFailure: the configuration file cannot be read.
    """
    if settings.connect or settings.listen or settings.reach is Reach.NETWORK:
        return False
    if not settings.config:
        return True
    config = base_configuration(settings)
    told = connected(config, settings) or _told(config, "listen/endpoints")
    return not told and not _scouts(config) and mode_of(config) != "router"


def configuration(settings: SessionSettings) -> zenoh.Config:
    """The configuration of a session with endpoints, from the settings or from the file, or on the network.

    Raises:
        SessionFailure: the configuration file cannot be read.
    """
    config = base_configuration(settings)
    endpoints, mode = connected(config, settings), mode_of(config)
    if settings.connect:
        _put(config, "connect/endpoints", list(settings.connect))
    if endpoints and mode == "client":
        _put(config, "connect/timeout_ms", CLIENT_CONNECT_LIMIT_MS)
    if settings.listen:
        _put(config, "listen/endpoints", list(settings.listen))
        _put(config, "listen/exit_on_failure", True)
    if settings.reach is Reach.NETWORK:
        return config
    if not settings.listen and not _told(config, "listen/endpoints"):
        _put(config, "listen/endpoints", _reachable(endpoints, mode))
    _close_scouting(config)
    # A router brings the peers that connect to it together by gossip. Who only listens needs no introduction:
    # everybody comes to it, and a stranger could name any place.
    if not endpoints and not _told(config, "scouting/gossip/autoconnect"):
        _put(config, "scouting/gossip/autoconnect", {"router": [], "peer": []})
    named = (*endpoints, *_endpoints(config, "listen/endpoints"))
    if any(is_secure(endpoint) for endpoint in named) and not _told(config, "transport/link/protocols"):
        # A partner that is introduced over an encrypted link is not to be connected to in clear.
        _put(config, "transport/link/protocols", sorted({name.partition("/")[0] for name in named}))
    return config


def _close_scouting(config: zenoh.Config) -> None:
    """Opens no scouting socket unless the file asks for one.

    A session with a scouting socket connects to whatever place a forged HELLO names, and hands over all it
    publishes. zenoh binds that socket to all interfaces, whatever `scouting/multicast/interface` says.
    """
    if not _scouts(config):
        _put(config, "scouting/multicast/enabled", False)


def _scouts(config: zenoh.Config) -> bool:
    """Whether the configuration file asks for multicast scouting; zenoh's own default does not count."""
    return bool(json.loads(config.get_json("scouting/multicast/enabled")))


def _reachable(endpoints: tuple[str, ...], mode: str) -> list[str]:
    """Where a session listens that was not told to: nowhere in clear beside an encrypted link.

    A router brings peers together, it does not pass records between them: each must be reachable.
    """
    if mode == "client" or any(is_secure(endpoint) for endpoint in endpoints):
        return []
    if mode == "router":
        return ["tcp/127.0.0.1:7447"]
    abroad = any(not is_local(endpoint) for endpoint in endpoints)
    return ["tcp/[::]:0" if abroad else "tcp/127.0.0.1:0"]


def base_configuration(settings: SessionSettings) -> zenoh.Config:
    """The configuration file, or zenoh's own defaults, with what streamkit always sets.

    Raises:
        SessionFailure: the file cannot be read.
    """
    try:
        config = zenoh.Config.from_file(settings.config) if settings.config else zenoh.Config()
    except Exception as error:
        raise SessionFailure(
            f"zenoh configuration {settings.config}: {plain(error)}; give a JSON5 file as zenoh documents it"
        ) from None
    if settings.mode is not Mode.AUTO or not _told(config, "mode"):
        named = replace(settings, connect=connected(config, settings))
        _put(config, "mode", "client" if named.is_client else "peer")
    _put(config, "connect/retry", CONNECT_RETRY)
    _put(config, "transport/link/tx/lease", LEASE_MS)
    _put(config, "transport/link/rx/max_message_size", MESSAGE_LIMIT_BYTES)
    # A record that lies in shared memory is lost when its publisher closes before it has been read.
    _put(config, "transport/shared_memory/enabled", False)
    if not _told(config, "adminspace/enabled"):
        # It tells configuration and partners to whoever asks.
        _put(config, "adminspace/enabled", False)
    patience_us = round(settings.patience_s * 1e6)
    _put(config, "transport/link/tx/queue/congestion_control/block/wait_before_close", patience_us)
    return config


def connected(config: zenoh.Config, settings: SessionSettings) -> tuple[str, ...]:
    """The endpoints that a session connects to, from the settings, else from the file."""
    return settings.connect or _endpoints(config, "connect/endpoints")


def _endpoints(config: zenoh.Config, key: str) -> tuple[str, ...]:
    found = json.loads(config.get_json(key))
    if isinstance(found, dict):
        found = [endpoint for endpoints in found.values() for endpoint in endpoints]
    return tuple(str(endpoint) for endpoint in found or ())


def mode_of(config: zenoh.Config) -> str:
    """How a session of this configuration takes part: peer, client or router."""
    return str(json.loads(config.get_json("mode")) or "peer")


def _told(config: zenoh.Config, key: str) -> bool:
    """Whether the configuration says something else than zenoh does by itself."""
    return str(config.get_json(key)) != str(zenoh.Config().get_json(key))


def _put(config: zenoh.Config, key: str, value: object) -> None:
    config.insert_json5(key, json.dumps(value))
