"""Opens and closes a zenoh session within time limits; by default it stays on this machine."""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
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
        try:
            return _open(local_configuration(settings, None), settings, limit_s)
        except SessionFailure:
            raise SessionFailure(
                f"zenoh (mode=client): no session answers at tcp/127.0.0.1:{MEETING_PORTS[0]} to "
                f"{MEETING_PORTS[-1]}; start a publisher or a router, or name an endpoint with connect"
            ) from None
    for port in MEETING_PORTS:
        try:
            return _open(local_configuration(settings, port), settings, limit_s)
        except SessionFailure as failure:
            if "in use" not in str(failure):
                raise
    return _open(local_configuration(settings, None), settings, limit_s)


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

    def close_all() -> bool:
        is_clean = True
        calls: list[Callable[[], object]] = [*undeclare, session.close]
        for call in calls:
            try:
                call()
            except Exception:
                # zenoh does not undeclare what another thread is using; the rest is closed all the same.
                is_clean = False
        return is_clean

    closing = _Call(close_all)
    return closing.ends_within(limit_s, cancelled) and bool(closing.result())


class _Call(Future[Any]):
    """A call in a thread of its own, whose caller waits for a limited time."""

    def __init__(self, function: Callable[[], Any]) -> None:
        super().__init__()
        self._function = function
        self._thread = threading.Thread(target=self._run, name="zenoh call", daemon=False)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.set_result(self._function())
        except Exception as error:
            self.set_exception(error)

    def ends_within(self, limit_s: float, cancelled: threading.Event | None = None) -> bool:
        deadline_s = time.monotonic() + limit_s
        while not self.done() and (left_s := deadline_s - time.monotonic()) > 0:
            if cancelled is not None and cancelled.is_set():
                return False
            wait([self], min(0.05, left_s))
        if self.done():
            self._thread.join()
        return self.done()


def _open(config: zenoh.Config, settings: SessionSettings, limit_s: float) -> zenoh.Session:
    endpoints = connected(config)
    # A peer would silently retry forever with a wrong certificate.
    for endpoint in endpoints:
        fault = certificate_fault(endpoint, config)
        if fault is not None:
            raise SessionFailure(
                f"zenoh ({mask_secrets(endpoint)}): {fault}; see root_ca_certificate, connect_certificate "
                "and connect_private_key under transport/link/tls of the configuration file"
            )
    call = _Call(lambda: zenoh.open(config))
    named = ", ".join((*endpoints, *settings.listen_endpoints)) or f"reach={settings.reach}"
    target = mask_secrets(named)
    if not call.ends_within(limit_s):
        call.add_done_callback(_close_late)
        raise SessionFailure(f"zenoh ({target}): no session within {limit_s:g} s; check the endpoints")
    error = call.exception()
    if error is not None:
        is_client = mode_of(config) == "client"
        remedy = "start the router or name another endpoint" if is_client else "name another endpoint"
        if str(config.get_json("transport/auth/usrpwd/user")) != "null":
            remedy += ", or see whether it knows the user and password under transport/auth/usrpwd"
        raise SessionFailure(f"zenoh ({target}): {error_line(error)}; {remedy}") from None
    session: zenoh.Session = call.result()
    return session


def _close_late(opened: Future[zenoh.Session]) -> None:
    if opened.exception() is None:
        opened.result().close()  # type: ignore[no-untyped-call]
