"""What an RTSP server says of itself."""

from __future__ import annotations

import re
import socket
import time
from typing import Any

MAX_REPLY_BYTES = 1 << 16
BEGINNING = b"RTSP/"


class NoAnswer(Exception):
    """The server did not answer as RTSP asks for."""


def ask_options(host: str, port: int, url: str, limit_s: float) -> dict[str, Any]:
    """Asks a server what it can do.

    Args:
        host: its name or address.
        port: of RTSP.
        url: of the stream, without user name and password.
        limit_s: for everything together, and once more for connecting.

    Returns:
        `status` ("200 OK" and the like), `software` and `methods` (the fields Server and Public, or ""),
        `connect_ms` and `answer_ms` (until the connection stood, and from then on).

    Raises:
        OSError: no connection.
        NoAnswer: it stays silent or answers with something else.
    """
    began = time.monotonic()
    with socket.create_connection((host, port), limit_s) as connection:
        connected = time.monotonic()
        connection.sendall(f"OPTIONS {url} RTSP/1.0\r\nCSeq: 1\r\nUser-Agent: streamkit\r\n\r\n".encode())
        reply = _read_head(connection, connected + limit_s).decode("latin-1")
    answer_ms = (time.monotonic() - connected) * 1000
    status = re.match(r"RTSP/\d\.\d (\d{3}[^\r\n]*)", reply)
    if status is None:
        raise NoAnswer(f"it answers with something else than RTSP: {reply[:40]!r}")
    found = {name: re.search(rf"(?im)^{name}:\s*([^\r\n]*)", reply) for name in ("Server", "Public")}
    software, methods = (match[1].strip() if match else "" for match in found.values())
    connect_ms = (connected - began) * 1000
    return {
        "status": status[1], "software": software, "methods": methods,
        "connect_ms": connect_ms, "answer_ms": answer_ms,
    }  # fmt: skip


def _read_head(connection: socket.socket, deadline: float) -> bytes:
    data = b""
    while b"\r\n\r\n" not in data and len(data) < MAX_REPLY_BYTES:
        try:
            connection.settimeout(max(0.001, deadline - time.monotonic()))
            more = connection.recv(4096)
        except TimeoutError:
            raise NoAnswer("it accepts the connection and does not answer") from None
        except ConnectionError:
            more = b""
        data += more
        if not more or not data.startswith(BEGINNING[: len(data)]):
            break
    if not data:
        raise NoAnswer("it accepts the connection and closes it")
    return data
