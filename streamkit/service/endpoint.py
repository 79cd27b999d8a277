"""The HTTP endpoint of a pipeline: /metrics, /healthz and /readyz."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from streamkit.errors import ResourceError, needs_extra
from streamkit.service.monitor import Monitor

if TYPE_CHECKING:
    from wsgiref.types import StartResponse, WSGIEnvironment

WAIT_S = 30.0  # for a request, before the server checks again whether it is closed
PLAIN = ("Content-Type", "text/plain; charset=utf-8")


class MetricsEndpoint:
    """Serves the metrics and the health of a pipeline until it is closed; a context manager.

    Args:
        monitor: of the pipeline.
        address: HOST:PORT to listen on; port 0 takes a free one.

    Attributes:
        address: HOST:PORT it listens on.

    Raises:
        ResourceError: the address is invalid or taken, or prometheus-client is missing.
    """

    def __init__(self, monitor: Monitor, address: str) -> None:
        with needs_extra("metrics", "metrics"):
            from prometheus_client import CollectorRegistry, PlatformCollector, ProcessCollector
            from prometheus_client import make_wsgi_app as metrics_app

            from streamkit.service.metrics import PipelineCollector
        monitor.samples_ages = True
        registry = CollectorRegistry()
        registry.register(PipelineCollector(monitor))
        ProcessCollector(registry=registry)
        PlatformCollector(registry=registry)
        self._server = _listen(address, _routes(monitor, metrics_app(registry)))
        host, port = self._server.server_address[:2]
        self.address = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self._is_closed = False
        self._thread = threading.Thread(target=self._serve, name="streamkit-metrics", daemon=True)
        self._thread.start()

    def __enter__(self) -> MetricsEndpoint:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the server."""
        self._is_closed = True
        with suppress(OSError):  # a last connection ends the wait for one
            socket.create_connection(self._server.server_address[:2], timeout=1.0).close()
        self._thread.join()
        self._server.server_close()

    def _serve(self) -> None:
        self._server.timeout = WAIT_S
        while not self._is_closed:
            self._server.handle_request()


def _routes(monitor: Monitor, metrics: Callable[..., Iterable[bytes]]) -> Callable[..., Iterable[bytes]]:
    """The WSGI application."""
    probes = {"/healthz": monitor.unhealthy_reason, "/readyz": monitor.not_ready_reason}

    def answer(environment: WSGIEnvironment, respond: StartResponse) -> Iterable[bytes]:
        path = environment["PATH_INFO"]
        if path == "/metrics":
            return metrics(environment, respond)
        if path not in probes:
            respond("404 Not Found", [PLAIN])
            return [b"try /metrics, /healthz or /readyz\n"]
        reason = probes[path]()
        respond("503 Service Unavailable" if reason else "200 OK", [PLAIN])
        return [f"{reason or 'ok'}\n".encode()]

    return answer


def _listen(address: str, app: Callable[..., Iterable[bytes]]) -> Any:
    """A server that listens, with a thread for each request."""
    from socketserver import TCPServer, ThreadingMixIn
    from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

    class QuietHandler(WSGIRequestHandler):
        timeout = 10.0  # of an idle client, s

        def log_message(self, format: str, *args: Any) -> None:
            """Requests are not logged."""

    class ThreadingServer(ThreadingMixIn, WSGIServer):
        daemon_threads = True
        address_family = socket.AF_INET6 if address.startswith("[") else socket.AF_INET

        def server_bind(self) -> None:
            """Binds without asking for the host's name, which may take seconds."""
            TCPServer.server_bind(self)
            self.server_name, self.server_port = str(self.server_address[0]), self.server_address[1]
            self.setup_environ()

    host, separator, port = address.rpartition(":")
    if not separator or not port.isdecimal() or int(port) > 65535 or not host:
        raise ResourceError(f"the address of metrics is HOST:PORT, got {address!r}; try 127.0.0.1:9464")
    try:
        return make_server(host.strip("[]"), int(port), app, ThreadingServer, QuietHandler)
    except OSError as error:
        reason = error.strerror or error
        raise ResourceError(f"metrics cannot be served at {address}: {reason}; name another") from error
