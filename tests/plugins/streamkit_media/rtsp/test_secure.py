"""rtsps:// servers: whom `rtspsrc` and `rtspclientsink` trust, and what they say of those they do not."""

import select
import shutil
import socket
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from streamkit import ElementFailure, Pipeline
from streamkit_media.live.reachability import tls_failure, trusted_authorities

SCRIPT = Path(__file__).parents[4] / "docs" / "examples" / "zenoh" / "make-test-certificates.sh"
LIMIT_S = 10.0


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folders of a server that is this machine, and of one that is another; each with its authority."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl: it makes the certificates of these tests")
    here, elsewhere = (tmp_path_factory.mktemp(name) for name in ("here", "elsewhere"))
    subprocess.run(["sh", str(SCRIPT), str(here)], check=True, timeout=60)
    subprocess.run(["sh", str(SCRIPT), str(elsewhere), "DNS:drone.example"], check=True, timeout=60)
    return here, elsewhere


class Front:
    """A TLS proxy before a plain server, one client at a time, in one thread as OpenSSL requires."""

    def __init__(self, server_port: int, folder: Path) -> None:
        self._server_port = server_port
        self._context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        self._context.load_cert_chain(folder / "server.pem", folder / "server.key")
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> "Front":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join(LIMIT_S)
        self._listener.close()

    def _serve(self) -> None:
        while True:
            try:
                plain, _ = self._listener.accept()
            except OSError:
                return
            with suppress(OSError), plain:  # a client that does not trust us goes
                plain.settimeout(LIMIT_S)
                with (
                    self._context.wrap_socket(plain, server_side=True) as client,
                    socket.create_connection(("127.0.0.1", self._server_port), LIMIT_S) as server,
                ):
                    self._pass_on(client, server)

    def _pass_on(self, client: ssl.SSLSocket, server: socket.socket) -> None:
        while ready := select.select([client, server], [], [], LIMIT_S)[0]:
            for source in ready:
                data = source.recv(65_536)
                if not data:
                    return
                (server if source is client else client).sendall(data)


@pytest.fixture
def camera(start_server: Callable[..., Any], certificates: tuple[Path, Path]) -> Iterator[int]:
    """The port of a server that is this machine, by its certificate."""
    with Front(start_server().port, certificates[0]) as front:
        yield front.port


def source(port: int, properties: str = "", host: str = "127.0.0.1") -> str:
    """The description of a source that decodes."""
    return f"rtspsrc location=rtsps://me:hunter2@{host}:{port}/live {properties} timeout-s=5 ! decode"


def error_of(text: str) -> str:
    """What a pipeline ends in."""
    with pytest.raises(ElementFailure) as caught:
        Pipeline.parse(f"{text} ! fakesink").run(timeout_s=20)
    assert "hunter2" not in str(caught.value)
    return str(caught.value)


def test_an_untrusted_server_is_refused(camera: int) -> None:
    """A certificate of an authority that this machine does not know ends in an error with the remedies."""
    error = error_of(source(camera))
    assert "the server's certificate is refused" in error
    assert "tls-ca-file=" in error
    assert "tls-verify=false" in error


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_a_trusted_server_plays(camera: int, certificates: tuple[Path, Path], host: str) -> None:
    """With the authority named, names and addresses that the certificate is of play."""
    text = f"{source(camera, f'tls-ca-file={certificates[0]}/ca.pem', host)} ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline["out"].pull(LIMIT_S) is not None


def test_anybody_plays_where_that_is_asked_for(camera: int) -> None:
    """Without the check a certificate of an unknown authority is enough."""
    with Pipeline.parse(f"{source(camera, 'tls-verify=false')} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        assert pipeline["out"].pull(LIMIT_S) is not None


def test_another_hosts_certificate_is_refused(
    start_server: Callable[..., Any], certificates: tuple[Path, Path]
) -> None:
    """A trusted authority is not enough: the certificate has to be of this host, and the error says so."""
    with Front(start_server().port, certificates[1]) as front:
        error = error_of(source(front.port, f"tls-ca-file={certificates[1]}/ca.pem"))
    assert "not valid for '127.0.0.1'" in error
    assert "write the name that it is of" in error


def test_a_server_without_encryption_is_reported(start_server: Callable[..., Any], fake: ModuleType) -> None:
    """rtsps:// to a server without TLS ends in time, with rtsp:// as the remedy."""
    server = start_server("accept, then close")
    assert "write rtsp:// if it is not encrypted" in error_of(source(server.port, "tls-verify=false"))


@pytest.mark.parametrize("name", ["none.pem", "text.pem"])
def test_a_bad_file_of_authorities_is_reported(tmp_path: Path, name: str) -> None:
    """A file that is not there, or holds no certificates, is refused before anything plays."""
    (tmp_path / "text.pem").write_text("no certificate\n", encoding="ascii")
    assert f"tls-ca-file={tmp_path / name}: " in error_of(source(1, f"tls-ca-file={tmp_path / name}"))


def test_pushing_checks_certificates_too(
    camera: int, certificates: tuple[Path, Path], tmp_path: Path
) -> None:
    """`rtspclientsink` refuses who is not trusted."""
    video_frames = "videotestsrc num-buffers=30 ! video/x-raw, width=64, height=48 ! encode live=true"
    text = f"{video_frames} ! rtspclientsink location=rtsps://127.0.0.1:{camera}/live timeout-s=5"
    with pytest.raises(ElementFailure, match="the server's certificate is refused"):
        Pipeline.parse(text).run(timeout_s=20)


def test_the_system_has_authorities() -> None:
    """Without a file of one's own it is the system's, which Python can read."""
    try:
        path = trusted_authorities()
    except OSError as error:
        pytest.skip(f"this machine has none: {error}")
    assert ssl.create_default_context(cafile=path).get_ca_certs()


def test_a_trusted_tls_server_gives_no_reason(camera: int, certificates: tuple[Path, Path]) -> None:
    """The reason is empty for a trusted server, and for a closed port, which another function reports."""
    assert tls_failure("127.0.0.1", camera, str(certificates[0] / "ca.pem"), LIMIT_S) == ""
    assert tls_failure("127.0.0.1", 1, None, LIMIT_S) == ""
