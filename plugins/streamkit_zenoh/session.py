"""A zenoh session that stays on this machine unless told otherwise, and opens and closes within bounds."""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import zenoh

from streamkit_zenoh.certificates import certificate_fault
from streamkit_zenoh.configuration import (
    MEETING_PORTS,
    Mode,
    Reach,
    SessionFailure,
    SessionSettings,
    base_configuration,
    configuration,
    connected,
    local_configuration,
    meets_locally,
    mode_of,
    plain,
)
from streamkit_zenoh.endpoints import redact

OPEN_LIMIT_S = 10.0

__all__ = ["Mode", "Reach", "SessionFailure", "SessionSettings", "close_session", "open_session", "plain"]


def open_session(settings: SessionSettings, limit_s: float = OPEN_LIMIT_S) -> zenoh.Session:
    """Opens a session.

    Raises:
        SessionFailure: an endpoint cannot be used, a client's router is not there, the configuration is
            wrong, or nothing has happened within the limit.
    """
    if not meets_locally(settings):
        return _opened(configuration(settings), settings, limit_s)
    if mode_of(base_configuration(settings)) == "client":
        return _open_local_client(settings, limit_s)
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
    failures: list[Exception] = []

    def close_all() -> None:
        for call in calls:
            try:
                call()
            except Exception as error:
                # zenoh does not take back what another thread is using; the rest must be closed all the same.
                failures.append(error)

    return _Outcome(close_all).wait(limit_s, cancelled) and not failures


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
    endpoints = connected(config, settings)
    # What a wrong certificate is will not become right by trying on, which a peer would do in silence.
    fault = _certificate_fault(endpoints, config)
    if fault is not None:
        raise SessionFailure(fault)
    outcome = _Outcome(lambda: zenoh.open(config), lambda session: session.close())
    target = redact(", ".join((*endpoints, *settings.listen)) or f"reach={settings.reach}")
    if not outcome.wait(limit_s):
        raise SessionFailure(f"zenoh ({target}): no session within {limit_s:g} s; check the endpoints")
    if outcome.error is not None:
        is_client = str(config.get_json("mode")) == '"client"'
        remedy = "start the router or name another endpoint" if is_client else "name another endpoint"
        if str(config.get_json("transport/auth/usrpwd/user")) != "null":
            remedy += ", or see whether it knows the user and password under transport/auth/usrpwd"
        raise SessionFailure(f"zenoh ({target}): {plain(outcome.error)}; {remedy}") from None
    session: zenoh.Session = outcome.value
    return session


def _certificate_fault(endpoints: tuple[str, ...], config: zenoh.Config) -> str | None:
    for endpoint in endpoints:
        fault = certificate_fault(endpoint, config)
        if fault is not None:
            return (
                f"zenoh ({redact(endpoint)}): {fault}; see root_ca_certificate, connect_certificate and "
                "connect_private_key under transport/link/tls of the configuration file"
            )
    return None


def _open_local_client(settings: SessionSettings, limit_s: float) -> zenoh.Session:
    """A client of the first session that answers at a meeting port."""
    try:
        return _opened(local_configuration(settings, None), settings, limit_s)
    except SessionFailure:
        raise SessionFailure(
            f"zenoh (mode=client): nobody answers at tcp/127.0.0.1:{MEETING_PORTS[0]} to "
            f"{MEETING_PORTS[-1]}; start a publisher or a router, or name an endpoint with connect"
        ) from None


def _open_at_meeting_port(settings: SessionSettings, limit_s: float) -> zenoh.Session:
    """A session at the first free meeting port; beyond the last one, it meets those that have one."""
    for port in MEETING_PORTS:
        try:
            return _opened(local_configuration(settings, port), settings, limit_s)
        except SessionFailure as failure:
            if "in use" not in str(failure):
                raise
    return _opened(local_configuration(settings, None), settings, limit_s)
