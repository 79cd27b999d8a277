"""The certificates of rtsps:// servers: what they are checked against, and why one is refused."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path

SECURE = "rtsps"
MISMATCHES = (62, 63, 64)  # OpenSSL's X509_V_ERR_HOSTNAME_MISMATCH and those of other kinds of names
# Where Python's own TLS was built without a place, as in wheels: Debian, Red Hat, Alpine and macOS.
USUAL_FILES = (
    "/etc/ssl/certs/ca-certificates.crt",
    "/etc/pki/tls/certs/ca-bundle.crt",
    "/etc/ssl/cert.pem",
)


def trusted_authorities(path: str = "") -> str:
    """The file of authorities to check certificates against.

    Args:
        path: the user's own; the system's where empty.

    Raises:
        OSError: it cannot be read, is no such file, or this system has none.
    """
    if path:
        try:
            ssl.create_default_context(cafile=path)
        except ssl.SSLError as error:
            raise OSError(f"it holds no certificates in PEM form: {error.reason}") from None
        return path
    places = ssl.get_default_verify_paths()
    for place in (places.cafile, places.openssl_cafile, *USUAL_FILES):
        if place and Path(place).is_file():
            return place
    raise OSError("this system has no file of trusted authorities; name one, or set tls-verify=false")


def refusal(host: str, port: int, ca_file: str | None, limit_s: float) -> str:
    """Why no trusted connection can be made, in plain words; "" where one can.

    FFmpeg calls every such failure an input/output error.

    Args:
        host: name or address that the certificate has to be of.
        port: of the server.
        ca_file: of the authorities that are trusted; None trusts everybody.
        limit_s: longest wait, for the connection and for each answer.
    """
    context = ssl.create_default_context(cafile=ca_file)
    if ca_file is None:
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE
    try:
        with (
            socket.create_connection((host, port), limit_s) as plain,
            context.wrap_socket(plain, server_hostname=host),
        ):
            return ""
    except ssl.SSLCertVerificationError as error:
        is_of_other = error.verify_code in MISMATCHES
        remedy = "write the name that it is of" if is_of_other else "name its authority in tls-ca-file="
        return (
            f"the server's certificate is refused: {error.verify_message.rstrip('.')}; "
            f"{remedy}, or trust everybody with tls-verify=false"
        )
    except TimeoutError:
        return f"no TLS on port {port}: the server does not answer; write rtsp:// if it is not encrypted"
    except (ssl.SSLError, ConnectionResetError, BrokenPipeError) as error:
        reason = getattr(error, "reason", None) or "the connection was closed"
        return f"no TLS on port {port}: {reason}; write rtsp:// if it is not encrypted"
    except OSError:
        return ""  # what is wrong with the connection itself is told elsewhere
