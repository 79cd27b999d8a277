"""TLS: nothing in plain text, a wrong certificate is refused with its reason, passwords are checked."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from streamkit import Pipeline
from tests.acceptance.zenoh_links import BINARY, Proxy, Router, router
from tests.ports import free_port

SCRIPT = Path(__file__).parents[2] / "docs" / "examples" / "zenoh" / "make-test-certificates.sh"
WORD = "acceptance-of-tls"


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two folders of certificates by the documented command: the right ones, and an attacker's."""
    folders = tmp_path_factory.mktemp("right"), tmp_path_factory.mktemp("wrong")
    for folder in folders:
        subprocess.run(["sh", str(SCRIPT), str(folder)], check=True, timeout=60)
    return folders


def _listening(folder: Path) -> dict[str, Any]:
    return {
        "root_ca_certificate": str(folder / "ca.pem"),
        "listen_certificate": str(folder / "server.pem"),
        "listen_private_key": str(folder / "server.key"),
        "enable_mtls": True,
    }


def _connecting(folder: Path, trusted: Path) -> dict[str, Any]:
    return {
        "root_ca_certificate": str(trusted / "ca.pem"),
        "connect_certificate": str(folder / "client.pem"),
        "connect_private_key": str(folder / "client.key"),
        "enable_mtls": True,
    }


@pytest.fixture
def tls_router(certificates: tuple[Path, Path]) -> Iterator[tuple[Router, Proxy, int]]:
    """A router with mutual TLS behind a proxy that records its traffic."""
    port = free_port()
    with router(f"tls/127.0.0.1:{port}", transport__link__tls=_listening(certificates[0])) as running:
        proxy = Proxy(port)
        yield running, proxy, port
        proxy.close()


def _config(path: Path, endpoint: str, tls: dict[str, Any], **more: Any) -> Path:
    content = {"connect": {"endpoints": [endpoint]}, "transport": {"link": {"tls": tls}, **more}}
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def _publish(config: Path, count: int = 20) -> subprocess.CompletedProcess[str]:
    text = f"videotestsrc num-buffers={count} ! zenohsink key={WORD} config={config} wait-subscribers=1"
    return subprocess.run(
        [str(BINARY), "launch", "-q", text + " wait-timeout-s=20 patience-s=5"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


def test_mutual_tls_delivers_and_shows_nothing(
    tls_router: tuple[Router, Proxy, int], certificates: tuple[Path, Path], tmp_path: Path
) -> None:
    """All records arrive; neither keys nor records are readable on the wire, nor on another socket."""
    _, proxy, _ = tls_router
    endpoint, right = f"tls/127.0.0.1:{proxy.port}", certificates[0]
    config = _config(tmp_path / "client.json5", endpoint, _connecting(right, right))
    subscriber = subprocess.Popen(
        [str(BINARY), "subscribe", WORD, "--config", str(config), "--format", "jsonl", "--timeout", "30"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        done = _publish(config)
        assert done.returncode == 0, done.stderr
        lines = subscriber.communicate(timeout=30)[0].splitlines()
    finally:
        subscriber.kill()
        subscriber.wait(10)
    assert [json.loads(line)["seq"] for line in lines] == list(range(20))
    assert len(proxy.seen) > 10_000
    for secret in (WORD.encode(), b"streamkit", b'"seq"'):
        assert secret not in proxy.seen


@pytest.mark.parametrize(("who", "mode"), [("server", "auto"), ("client", "peer")])
def test_a_wrong_certificate_is_refused(
    tls_router: tuple[Router, Proxy, int],
    certificates: tuple[Path, Path],
    tmp_path: Path,
    who: str,
    mode: str,
) -> None:
    """The error names endpoint, fault and remedy within a time limit; nothing is sent."""
    _, proxy, _ = tls_router
    right, wrong = certificates
    tls = _connecting(right, wrong) if who == "server" else _connecting(wrong, right)
    config = _config(tmp_path / "client.json5", f"tls/127.0.0.1:{proxy.port}", tls)
    text = f"videotestsrc num-buffers=1 ! zenohsink key={WORD} config={config} mode={mode}"
    done = subprocess.run(
        [str(BINARY), "launch", "-q", text], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert f"tls/127.0.0.1:{proxy.port}" in done.stderr
    reason = "its certificate is not trusted" if who == "server" else "TLS is refused"
    assert reason in done.stderr
    assert "root_ca_certificate, connect_certificate" in done.stderr
    assert WORD.encode() not in proxy.seen


def test_with_tls_no_plain_socket_listens(
    tls_router: tuple[Router, Proxy, int], certificates: tuple[Path, Path], tmp_path: Path
) -> None:
    """A peer with an encrypted endpoint opens no other one."""
    _, proxy, _ = tls_router
    right = certificates[0]
    config = _config(tmp_path / "peer.json5", f"tls/127.0.0.1:{proxy.port}", _connecting(right, right))
    with Pipeline.parse(f"fakesrc ! zenohsink name=z key={WORD} config={config} mode=peer") as pipeline:
        pipeline.ready()
        assert str(pipeline["z"]._publication.session.info.zid())
        before = {str(link.dst) for link in pipeline["z"]._publication.session.info.links()}
        assert before
        assert all(link.startswith("tls/") for link in before)
        assert not _listening_sockets()


def _listening_sockets() -> list[str]:
    """Listening TCP sockets of this process."""
    import os

    own = set()
    for name in os.listdir("/proc/self/fd"):
        try:
            own.add(os.readlink(f"/proc/self/fd/{name}"))
        except OSError:
            continue
    rows = [
        line.split()
        for table in ("tcp", "tcp6")
        for line in Path(f"/proc/net/{table}").read_text(encoding="ascii").splitlines()[1:]
    ]
    # The proxy of the test listens, on loopback.
    return [
        row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own and "0100007F" not in row[1]
    ]


def test_a_wrong_password_is_refused(tmp_path: Path) -> None:
    """User and password are in zenoh's own configuration, and never in an error."""
    users = tmp_path / "users.txt"
    users.write_text("drone:right-password\n", encoding="utf-8")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    auth = {"user": "router", "password": "of-the-router", "dictionary_file": str(users)}
    with router(endpoint, transport__auth__usrpwd=auth):
        for password, code in (("right-password", 0), ("wrong-password", 1)):
            config = _config(
                tmp_path / f"{code}.json5",
                endpoint,
                {},
                auth={"usrpwd": {"user": "drone", "password": password}},
            )
            text = f"videotestsrc num-buffers=3 ! zenohsink key={WORD} config={config} mode=client"
            done = subprocess.run(
                [str(BINARY), "launch", "-q", text], capture_output=True, text=True, timeout=60, check=False
            )
            assert done.returncode == code, done.stderr
            assert password not in done.stderr
    assert endpoint in done.stderr
    assert "see whether it knows the user and password" in done.stderr
