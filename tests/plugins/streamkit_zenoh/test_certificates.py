"""certificate_fault names the reason for a refused TLS link, and None if the endpoint does not answer."""

import json
import socket
import threading
from pathlib import Path

import pytest
import zenoh

from streamkit_zenoh.session import certificate_fault


def _config(**tls: object) -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("transport/link/tls", json.dumps(tls))
    return config


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1:1", "unixsock-stream//tmp/x", "quic/127.0.0.1:1"])
def test_links_without_tls_have_no_certificates(endpoint: str) -> None:
    """No handshake is tried."""
    assert certificate_fault(endpoint, _config()) is None


def test_an_endpoint_without_listener_has_no_certificate_fault() -> None:
    """Zenoh decides whether to retry."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert certificate_fault(f"tls/127.0.0.1:{port}", _config()) is None


def test_unreadable_certificates_are_reported(tmp_path: Path) -> None:
    """Before anything is sent."""
    fault = certificate_fault("tls/127.0.0.1:1", _config(root_ca_certificate=str(tmp_path / "none.pem")))
    assert fault is not None
    assert "cannot be used" in fault
    assert "none.pem" in fault


def test_a_server_without_tls_is_reported() -> None:
    """A plain TCP server at a tls/ endpoint."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            link, _ = server.accept()
            with link:
                link.recv(1000)
                link.sendall(b"HTTP/1.0 400 Bad Request\r\n\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        fault = certificate_fault(f"tls/127.0.0.1:{server.getsockname()[1]}", _config())
        thread.join(5)
    assert fault is not None
    assert "TLS is refused" in fault
