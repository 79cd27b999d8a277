"""The reason why a TLS link is refused, found by a plain handshake: zenoh's own error seldom names it."""

import json
import socket
import ssl
import time

import zenoh

from streamkit_zenoh.endpoints import ENDPOINT

HANDSHAKE_LIMIT_S = 2.0
ANSWER_LIMIT_S = 0.2


def certificate_fault(endpoint: str, config: zenoh.Config) -> str | None:
    """Tries the handshake that zenoh would do.

    Args:
        endpoint: `tls/HOST:PORT`; others have no certificates.
        config: with the certificates under `transport/link/tls`.

    Returns:
        What is wrong with a certificate; None if nothing is, or the endpoint does not answer.
    """
    match = ENDPOINT.fullmatch(endpoint)
    if match is None or match["protocol"] != "tls":
        return None
    settings = json.loads(config.get_json("transport/link/tls")) or {}
    try:
        context = ssl.create_default_context(cafile=settings.get("root_ca_certificate"))
        context.check_hostname = settings.get("verify_name_on_connect") is not False
        certificate, key = settings.get("connect_certificate"), settings.get("connect_private_key")
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
