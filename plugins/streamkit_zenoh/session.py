"""Opens and closes a zenoh session within time limits; it stays on this machine unless told otherwise."""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import zenoh

from streamkit import mask_secrets
from streamkit_zenoh.certificates import certificate_fault
from streamkit_zenoh.configuration import (
    MEETING_PORTS,
    SessionFailure,
    SessionSettings,
    base_configuration,
    configuration,
    connected,
    error_line,
    local_configuration,
    meets_locally,
    mode_of,
)

OPEN_LIMIT_S = 10.0


def open_session(settings: SessionSettings, limit_s: float = OPEN_LIMIT_S) -> zenoh.Session:
    """Opens a session.

    Raises:
        InvalidEndpoint: an endpoint of the settings is malformed.
        SessionFailure: an endpoint cannot be used, a client's router is not there, the configuration is
            wrong, or the time limit is over.
    """
    if not meets_locally(settings):
        return _open(configuration(settings), settings, limit_s)
    if mode_of(base_configuration(settings)) == "client":
        return _open_local_client(settings, limit_s)
    return _open_at_meeting_port(settings, limit_s)


def close_session(
    session: zenoh.Session,
    limit_s: float,
    cancelled: threading.Event | None = None,
    undeclare: Sequence[Callable[[], object]] = (),
) -> bool:
    """Undeclares, then closes a session, which sends what is queued.

    zenoh gives up on a receiver that takes nothing after about 10 s, so the closing thread always ends.

    Returns:
        Whether the session closed in time and without failure; else it ends in the background.
    """
    calls: list[Callable[[], object]] = [*undeclare, session.close]
    failures: list[Exception] = []

    def close_all() -> None:
        for call in calls:
            try:
                call()
            except Exception as error:
                # zenoh does not undeclare what another thread is using; the rest is closed all the same.
                failures.append(error)

    return _Call(close_all).wait(limit_s, cancelled) and not failures


class _Call:
    """A call in a thread of its own, whose caller waits for a limited time.

    Args:
        function: called at once.
        discard: called with the result if the caller has given up.
    """

    def __init__(self, function: Callable[[], Any], discard: Callable[[Any], Any] | None = None) -> None:
        self.value: Any = None
        self.error: Exception | None = None
        self._function = function
        self._discard = discard
        self._abandoned = False
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="zenoh call", daemon=False)
        self._thread.start()

    def _run(self) -> None:
        value = None
        try:
            value = self._function()
        except Exception as error:
            self.error = error
        with self._lock:
            self.value = value
            self._done.set()
            unwanted = self._abandoned and value is not None
        if unwanted and self._discard is not None:
            self._discard(value)

    def wait(self, limit_s: float, cancelled: threading.Event | None = None) -> bool:
        """Whether the call returned in time; otherwise its result is discarded."""
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


def _open(config: zenoh.Config, settings: SessionSettings, limit_s: float) -> zenoh.Session:
    endpoints = connected(config, settings)
    # A peer would silently retry for ever with a wrong certificate.
    for endpoint in endpoints:
        fault = certificate_fault(endpoint, config)
        if fault is not None:
            raise SessionFailure(
                f"zenoh ({mask_secrets(endpoint)}): {fault}; see root_ca_certificate, connect_certificate "
                "and connect_private_key under transport/link/tls of the configuration file"
            )
    call = _Call(lambda: zenoh.open(config), lambda session: session.close())
    named = ", ".join((*endpoints, *settings.listen_endpoints)) or f"reach={settings.reach}"
    target = mask_secrets(named)
    if not call.wait(limit_s):
        raise SessionFailure(f"zenoh ({target}): no session within {limit_s:g} s; check the endpoints")
    if call.error is not None:
        is_client = mode_of(config) == "client"
        remedy = "start the router or name another endpoint" if is_client else "name another endpoint"
        if str(config.get_json("transport/auth/usrpwd/user")) != "null":
            remedy += ", or see whether it knows the user and password under transport/auth/usrpwd"
        raise SessionFailure(f"zenoh ({target}): {error_line(call.error)}; {remedy}") from None
    session: zenoh.Session = call.value
    return session


def _open_local_client(settings: SessionSettings, limit_s: float) -> zenoh.Session:
    """A client of the first session that answers at a meeting port."""
    try:
        return _open(local_configuration(settings, None), settings, limit_s)
    except SessionFailure:
        raise SessionFailure(
            f"zenoh (mode=client): nobody answers at tcp/127.0.0.1:{MEETING_PORTS[0]} to "
            f"{MEETING_PORTS[-1]}; start a publisher or a router, or name an endpoint with connect"
        ) from None


def _open_at_meeting_port(settings: SessionSettings, limit_s: float) -> zenoh.Session:
    """A session at the first free meeting port; if all are taken, one that connects to all of them."""
    for port in MEETING_PORTS:
        try:
            return _open(local_configuration(settings, port), settings, limit_s)
        except SessionFailure as failure:
            if "in use" not in str(failure):
                raise
    return _open(local_configuration(settings, None), settings, limit_s)
