"""Schemes and ports of the addresses of servers, and why one cannot be reached or trusted, in plain words."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path
from urllib.parse import urlsplit

DEFAULT_PORTS = {"rtsp": 554, "rtsps": 322, "http": 80, "https": 443, "rtmp": 1935, "rtmps": 443}
RTSP_SCHEMES = ("rtsp", "rtsps")
LIVE_SCHEMES = ("udp", "tcp", "srt", "rtmp", "rtmps")  # never a file, which http may lead to
PLAIN_OF = {"rtsps": "rtsp", "https": "http", "rtmps": "rtmp"}  # schemes with TLS, and the same without
LOOK_LIMIT_S = 1.0
MISMATCHES = (62, 63, 64)  # OpenSSL's X509_V_ERR_HOSTNAME_MISMATCH and those of other kinds of names
# Where Python's own TLS was built without a place, as in wheels: Debian, Red Hat, Alpine and macOS.
USUAL_FILES = ("/etc/ssl/certs/ca-certificates.crt", "/etc/pki/tls/certs/ca-bundle.crt", "/etc/ssl/cert.pem")


def port_of(location: str) -> int:
    """The port a URL leads to; 0 where neither it nor its scheme has one.

    Raises:
        ValueError: the URL's port is no number from 0 to 65535; the text may be a password.
    """
    try:
        parts = urlsplit(location)
        return parts.port or DEFAULT_PORTS.get(parts.scheme, 0)
    except ValueError:
        raise ValueError(
            "the port must be a number from 0 to 65535, and / ? # @ in a password %2F %3F %23 %40"
        ) from None


def unreachable(location: str, ca_file: str | None, limit_s: float, remedy: str) -> str:
    """Why a server cannot be reached or trusted, with what to do; "" where it can be.

    Args:
        location: its URL.
        ca_file: see `tls_failure`.
        limit_s: longest wait for each answer; at most a second is waited.
        remedy: for a server that cannot be reached.
    """
    parts, limit_s = urlsplit(location), min(limit_s, LOOK_LIMIT_S)
    host, port = parts.hostname or "", port_of(location)
    if reason := server_failure(location, limit_s):
        return f"{reason}; {remedy}"
    plain = PLAIN_OF.get(parts.scheme)
    return tls_failure(host, port, ca_file, limit_s, plain) if plain else ""


def server_failure(location: str, limit_s: float) -> str:
    """Why no TCP connection to the server of a URL can be made; "" where one can.

    With an @ behind the host, what looks like host and port may begin a password: they are not named.
    """
    parts = urlsplit(location)
    reason = connection_failure(parts.hostname or "", port_of(location), limit_s)
    if reason and any("@" in part for part in (parts.path, parts.query, parts.fragment)):
        return (
            "no connection to the host; slash, ?, # and at sign in a password must be %2F, %3F, %23 and %40"
        )
    return reason


def connection_failure(host: str, port: int, limit_s: float) -> str:
    """Why no TCP connection can be made; "" where one can.

    FFmpeg calls an unknown host an input/output error and an unreachable one invalid data.
    """
    try:
        with socket.create_connection((host, port), limit_s):
            return ""
    except socket.gaierror:
        return f"the host name {host!r} is not known here"
    except TimeoutError:
        return f"no connection to {host} port {port} within {limit_s:g} s"
    except OSError as error:
        return f"no connection to {host} port {port}: {error.strerror or error}"


def trusted_authorities(path: str = "") -> str:
    """The file of trusted authorities: the user's own, or the system's where `path` is empty.

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


def tls_failure(host: str, port: int, ca_file: str | None, limit_s: float, plain_scheme: str = "rtsp") -> str:
    """Why no trusted TLS connection can be made; "" where one can.

    FFmpeg calls every such failure an input/output error.

    Args:
        host: name or address that the certificate has to be of.
        port: of the server.
        ca_file: of the authorities that are trusted; None trusts every server.
        limit_s: longest wait, for the connection and for each answer.
        plain_scheme: of the same address without TLS.
    """
    remedy = f"write {plain_scheme}:// if it is not encrypted"
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
        advice = "write the name that it is of" if is_of_other else "name its authority in tls-ca-file="
        return (
            f"the server's certificate is refused: {error.verify_message.rstrip('.')}; "
            f"{advice}, or trust every server with tls-verify=false"
        )
    except TimeoutError:
        return f"no TLS on port {port}: the server does not answer; {remedy}"
    except (ssl.SSLError, ConnectionResetError, BrokenPipeError) as error:
        reason = getattr(error, "reason", None) or "the connection was closed"
        return f"no TLS on port {port}: {reason}; {remedy}"
    except OSError:
        return ""  # connection_failure reports this
