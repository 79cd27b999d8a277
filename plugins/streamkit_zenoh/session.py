"""A zenoh session that stays on this machine unless told otherwise, and opens and closes within bounds."""

import json
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import zenoh

from streamkit_zenoh.endpoints import is_local, redact

# Sessions of one machine find each other here without a router and without multicast: each listens on the
# first free port and connects to those below it, which are taken by the ones before.
MEETING_PORTS = range(7450, 7466)
OPEN_LIMIT_S = 10.0
CLIENT_CONNECT_LIMIT_MS = 5_000
CONNECT_RETRY = {"period_init_ms": 200, "period_max_ms": 2_000, "period_increase_factor": 2}
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
        mode: `auto` is a client where `connect` names another machine and nothing is listened on, else
            a peer.
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
        abroad = any(not is_local(endpoint) for endpoint in self.connect)
        return self.mode is Mode.CLIENT or (self.mode is Mode.AUTO and abroad and not self.listen)


def open_session(settings: SessionSettings, limit_s: float = OPEN_LIMIT_S) -> zenoh.Session:
    """Opens a session.

    Raises:
        SessionFailure: an endpoint cannot be used, a client's router is not there, the configuration is
            wrong, or nothing has happened within the limit.
    """
    if settings.config or settings.connect or settings.listen or settings.reach is Reach.NETWORK:
        return _opened(_configuration(settings), settings, limit_s)
    if settings.is_client:
        return _opened(_local_configuration(settings, None, multicast=True), settings, limit_s)
    return _open_at_meeting_port(settings, limit_s)


def close_session(
    session: zenoh.Session,
    limit_s: float,
    cancelled: threading.Event | None = None,
    undeclare: Sequence[Callable[[], object]] = (),
) -> bool:
    """Takes declarations back, then closes a session, after what it has still to send.

    zenoh gives up on a receiver that takes nothing after about 10 s, so the thread that closes always ends.

    Returns:
        Whether the session was closed in time and without failure; else it ends in the background.
    """
    calls: list[Callable[[], object]] = [*undeclare, session.close]
    outcome = _Outcome(lambda: [call() for call in calls])
    return outcome.wait(limit_s, cancelled) and outcome.error is None


def plain(error: Exception) -> str:
    """Zenoh's error as one line for users: no secrets, no places in its source."""
    return redact(SOURCE_PLACE.sub("", str(error)).strip())


class _Outcome:
    """What became of a call in a thread of its own, so that the caller is never held up by it."""

    def __init__(self, call: Callable[[], Any], discard: Callable[[Any], Any] | None = None) -> None:
        self.value: Any = None
        self.error: Exception | None = None
        self._call = call
        self._discard = discard
        self._abandoned = False
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh call", daemon=False)
        self._thread.start()

    def _run(self) -> None:
        try:
            value = self._call()
        except Exception as error:
            self.error = error
            value = None
        with self._lock:
            self.value = value
            self._done.set()
            unwanted = self._abandoned and value is not None
        if unwanted and self._discard is not None:
            self._discard(value)

    def wait(self, limit_s: float, cancelled: threading.Event | None = None) -> bool:
        """Whether the call came back in time; otherwise its result is discarded when it does."""
        left_s = limit_s
        while not self._done.wait(min(0.05, left_s) if cancelled else left_s):
            left_s -= 0.05
            if cancelled is None or cancelled.is_set() or left_s <= 0:
                break
        with self._lock:
            self._abandoned = not self._done.is_set()
        if self._abandoned:
            return False
        self._thread.join()
        return True


def _opened(config: zenoh.Config, settings: SessionSettings, limit_s: float) -> zenoh.Session:
    outcome = _Outcome(lambda: zenoh.open(config), lambda session: session.close())
    target = redact(", ".join((*settings.connect, *settings.listen)) or f"reach={settings.reach}")
    if not outcome.wait(limit_s):
        raise SessionFailure(f"zenoh ({target}): no session within {limit_s:g} s; check the endpoints")
    if outcome.error is not None:
        remedy = (
            "start the router or name another endpoint" if settings.is_client else "name another endpoint"
        )
        raise SessionFailure(f"zenoh ({target}): {plain(outcome.error)}; {remedy}") from None
    session: zenoh.Session = outcome.value
    return session


def _open_at_meeting_port(settings: SessionSettings, limit_s: float) -> zenoh.Session:
    """A session at the first free meeting port; beyond the last one, multicast on loopback must do."""
    for multicast in (True, False):
        for port in (*MEETING_PORTS, None):
            try:
                return _opened(_local_configuration(settings, port, multicast), settings, limit_s)
            except SessionFailure as failure:
                # Any other trouble than a taken port may come from multicast, which some containers forbid.
                if "in use" not in str(failure):
                    if not multicast:
                        raise
                    break
    raise SessionFailure("zenoh: no port of 127.0.0.1 can be listened on; name one with listen")


def _local_configuration(settings: SessionSettings, port: int | None, multicast: bool) -> zenoh.Config:
    config = _base(settings)
    ports = MEETING_PORTS if port is None else range(MEETING_PORTS.start, port)
    if not settings.is_client:
        _put(config, "listen/endpoints", [f"tcp/127.0.0.1:{port or 0}"])
        _put(config, "listen/exit_on_failure", True)
        _put(config, "connect/endpoints", [f"tcp/127.0.0.1:{lower}" for lower in ports])
    # Gossip would make this session known to, and connect it with, machines that a local one knows.
    _put(config, "scouting/gossip/enabled", False)
    _put(config, "scouting/multicast/enabled", multicast)
    if multicast:
        _put(config, "scouting/multicast/interface", "lo")
    return config


def _configuration(settings: SessionSettings) -> zenoh.Config:
    config = _base(settings)
    named = bool(settings.connect or settings.listen)
    if settings.connect:
        _put(config, "connect/endpoints", list(settings.connect))
        if settings.is_client:
            _put(config, "connect/timeout_ms", CLIENT_CONNECT_LIMIT_MS)
    if settings.listen:
        _put(config, "listen/endpoints", list(settings.listen))
        _put(config, "listen/exit_on_failure", True)
    elif named and not settings.config:
        # A router brings peers together, it does not pass records between them: each must be reachable.
        abroad = any(not is_local(endpoint) for endpoint in settings.connect)
        reachable = [] if settings.is_client else ["tcp/[::]:0" if abroad else "tcp/127.0.0.1:0"]
        _put(config, "listen/endpoints", reachable)
    if named and not settings.config:
        _put(config, "scouting/multicast/enabled", False)
    return config


def _base(settings: SessionSettings) -> zenoh.Config:
    try:
        config = zenoh.Config.from_file(settings.config) if settings.config else zenoh.Config()
    except Exception as error:
        raise SessionFailure(
            f"zenoh configuration {settings.config}: {plain(error)}; give a JSON5 file as zenoh documents it"
        ) from None
    if not settings.config or settings.mode is not Mode.AUTO:
        _put(config, "mode", "client" if settings.is_client else "peer")
    _put(config, "connect/retry", CONNECT_RETRY)
    # A record that lies in shared memory is lost when its publisher closes before it has been read.
    _put(config, "transport/shared_memory/enabled", False)
    patience_us = round(settings.patience_s * 1e6)
    _put(config, "transport/link/tx/queue/congestion_control/block/wait_before_close", patience_us)
    return config


def _put(config: zenoh.Config, key: str, value: object) -> None:
    config.insert_json5(key, json.dumps(value))
