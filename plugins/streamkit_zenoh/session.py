"""Opens and closes a zenoh session within time limits; by default it stays on this machine."""

import json
import socket
import ssl
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import zenoh

from streamkit import Element, ResourceError, SettingsOf, mask_secrets
from streamkit_zenoh.configuration import (
    ENDPOINT,
    InvalidEndpoint,
    SessionFailure,
    SessionSettings,
    base_configuration,
    configuration,
    connected,
    error_line,
    local_configuration,
    meeting_ports,
    meets_locally,
    mode_of,
)

OPEN_LIMIT_S = 10.0
HANDSHAKE_LIMIT_S = 2.0
ANSWER_LIMIT_S = 0.2
Result = TypeVar("Result")


class SessionElement(Element):
    """Base of zenohsink and zenohsrc: declares the properties of their session, and opens it."""

    session_settings = SettingsOf(SessionSettings)

    def open_zenoh(self, cut_off_s: float = 5.0) -> zenoh.Session:
        """Opens the session that the properties describe; see `SessionSettings` for `cut_off_s`.

        Raises:
            ResourceError: an endpoint is malformed, or the session cannot be opened.
        """
        settings = replace(self.session_settings, cut_off_s=cut_off_s)
        try:
            session = open_session(settings)
        except (InvalidEndpoint, SessionFailure) as error:
            raise ResourceError(str(error)) from None
        if settings.connect_endpoints and not list(session.info.transports()):
            shown = mask_secrets(", ".join(settings.connect_endpoints))
            self.post_warning(f"no session answers at {shown} yet; retrying in the background")
        return session


def open_session(settings: SessionSettings, limit_s: float = OPEN_LIMIT_S) -> zenoh.Session:
    """Opens a session.

    Raises:
        InvalidEndpoint: an endpoint of the settings is malformed.
        SessionFailure: an endpoint cannot be used, a client's router is not there, the configuration or
            STREAMKIT_MEETING_PORTS is wrong, or the time limit is over.
    """
    if not meets_locally(settings):
        return _open(configuration(settings), settings, limit_s)
    ports = meeting_ports()
    if mode_of(base_configuration(settings)) == "client":
        try:
            return _open(local_configuration(settings, None), settings, limit_s)
        except SessionFailure:
            raise SessionFailure(
                f"zenoh (mode=client): no session answers at tcp/127.0.0.1:{ports[0]} to "
                f"{ports[-1]}; start a publisher or a router, or name an endpoint with connect"
            ) from None
    for port in ports:
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

    closing = _call(close_all, limit_s, cancelled)
    return closing.done() and closing.result()


def _call(
    function: Callable[[], Result], limit_s: float, cancelled: threading.Event | None = None
) -> Future[Result]:
    """Calls a function in a thread of its own; the result is not done if the limit is over or cancelled."""
    executor = ThreadPoolExecutor(1, "zenoh call")
    future = executor.submit(function)
    deadline_s = time.monotonic() + limit_s
    while not future.done() and (left_s := deadline_s - time.monotonic()) > 0:
        if cancelled is not None and cancelled.is_set():
            break
        wait([future], min(0.05, left_s))
    executor.shutdown(wait=future.done())
    return future


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
    named = ", ".join((*endpoints, *settings.listen_endpoints)) or f"reach={settings.reach}"
    target = mask_secrets(named)
    call = _call(lambda: zenoh.open(config), limit_s)
    if not call.done():
        call.add_done_callback(_close_late)
        raise SessionFailure(f"zenoh ({target}): no session within {limit_s:g} s; check the endpoints")
    error = call.exception()
    if error is not None:
        is_client = mode_of(config) == "client"
        remedy = "start the router or name another endpoint" if is_client else "name another endpoint"
        if str(config.get_json("transport/auth/usrpwd/user")) != "null":
            remedy += ", or see whether it knows the user and password under transport/auth/usrpwd"
        raise SessionFailure(f"zenoh ({target}): {error_line(error)}; {remedy}") from None
    return call.result()


def _close_late(opened: Future[zenoh.Session]) -> None:
    if opened.exception() is None:
        opened.result().close()  # type: ignore[no-untyped-call]


def certificate_fault(endpoint: str, config: zenoh.Config) -> str | None:
    """What is wrong with a certificate of a `tls/` link; None if nothing is, or the endpoint does not answer.

    Tries the handshake that zenoh would do: its own error seldom names the reason.
    """
    match = ENDPOINT.fullmatch(endpoint)
    if match is None or match["protocol"] != "tls":
        return None
    settings = json.loads(config.get_json("transport/link/tls")) or {}
    root, certificate, key = map(
        settings.get, ("root_ca_certificate", "connect_certificate", "connect_private_key")
    )
    try:
        for file in filter(None, (root, certificate, key)):
            Path(file).open("rb").close()  # the errors of ssl do not name the file
        context = ssl.create_default_context(cafile=root)
        context.check_hostname = settings.get("verify_name_on_connect") is not False
        if certificate and key and settings.get("enable_mtls"):
            context.load_cert_chain(certificate, key)
    except (OSError, ValueError) as error:
        return f"the certificates of the configuration cannot be used: {error}"
    return _handshake(context, match["host"].strip("[]"), int(match["port"]))


def _handshake(context: ssl.SSLContext, host: str, port: int) -> str | None:
    began_s = time.monotonic()
    try:
        with (
            socket.create_connection((host, port), HANDSHAKE_LIMIT_S) as connection,
            context.wrap_socket(connection, server_hostname=host) as link,
        ):
            # With TLS 1.3 the server checks the client's certificate one round trip after the handshake.
            link.settimeout(max(ANSWER_LIMIT_S, 3 * (time.monotonic() - began_s)))
            link.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"its certificate is not trusted: {error.verify_message}"
    except TimeoutError:
        return None
    except ssl.SSLError as error:
        return f"TLS is refused: {error.reason or error}"
    except OSError:
        return None
    return None
