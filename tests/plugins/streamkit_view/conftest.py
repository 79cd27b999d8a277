"""Servers of `streamkit view`, in processes of their own or in threads, and a browser."""

from __future__ import annotations

import itertools
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import zenoh
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

from streamkit import Frame, Registration, raw_video_caps
from streamkit_view.access import Access
from streamkit_view.basemap import read_basemap
from streamkit_view.server import ViewServer, run_server
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.frame_header import frame_header
from streamkit_zenoh.wire.images import ImageFormat, encode_image
from streamkit_zenoh.wire.numbering import Stamp
from tests.slowness import patience

STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
)
WINDOW_PX = 1280, 800
FORGETTING: dict[str, dict[str, Any]] = {
    "Emulation.clearDeviceMetricsOverride": {},
    "Emulation.setEmulatedMedia": {"features": []},
    "Network.clearBrowserCookies": {},
}
POLL_S = 0.15  # a look at a canvas takes the browser 50 ms


@dataclass
class Server:
    """A running `streamkit view`; `errors` has what it printed to stderr."""

    key: str
    url: str
    process: subprocess.Popen[str]
    errors: Path

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens."""
        return "127.0.0.1", urlsplit(self.url).port or 0


@contextmanager
def view_server(folder: Path, *arguments: str, listen: str = "127.0.0.1:0") -> Iterator[Server]:
    """Starts `streamkit view`; it ends with code 0 at SIGTERM."""
    errors = folder / "errors.txt"
    with errors.open("w") as file:
        process = subprocess.Popen(
            [STREAMKIT, "view", *arguments, "--listen", listen],
            stdout=subprocess.PIPE,
            stderr=file,
            text=True,
        )
    try:
        assert process.stdout is not None
        found = re.fullmatch(r"open (http://\S+)\n", process.stdout.readline())
        assert found, errors.read_text()
        yield Server(arguments[0], found[1], process, errors)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            assert process.wait(patience(20)) == 0, errors.read_text()
    finally:
        process.kill()
        process.communicate()


@contextmanager
def view_thread(*keys: str, basemap: Path | None = None) -> Iterator[str]:
    """Serves keys from a thread of this process; gives the address with the token."""
    servers: list[ViewServer] = []
    access = Access("token", is_local=True)
    with socket.create_server(("127.0.0.1", 0)) as bound:
        arguments = ([*keys], bound, access, None, None, None, basemap and read_basemap(basemap))
        options = {"on_created": servers.append}
        thread = threading.Thread(target=run_server, args=arguments, kwargs=options, name="view server")
        thread.start()
        try:
            yield f"http://127.0.0.1:{bound.getsockname()[1]}/?token=token"
        finally:
            wait_for(lambda: servers)
            servers[0].stop()
            thread.join(patience(20))
            assert not thread.is_alive()


@pytest.fixture
def key() -> str:
    """A key of this test alone."""
    return f"test/{uuid.uuid4().hex}"


@pytest.fixture
def session() -> Iterator[zenoh.Session]:
    """Of a publisher."""
    session = open_session(SessionSettings())
    try:
        yield session
    finally:
        close_session(session, 5.0)


@pytest.fixture
def publish_mosaic(key: str, session: zenoh.Session) -> Callable[[np.ndarray[Any, Any]], None]:
    """Publishes a mosaic, whose first corner lies at (500, 120) of the plane, 4 px each."""
    publisher = session.declare_publisher(f"{key}/mosaic", encoding="image/png;streamkit.frame/1")
    place = Registration(np.eye(3), np.array([[4.0, 0, 501.5], [0, 4, 121.5], [0, 0, 1]]), reference=0)
    numbers = itertools.count()

    def put(image: np.ndarray[Any, Any]) -> None:
        caps = raw_video_caps("BGR", image.shape[1], image.shape[0], None)
        header = frame_header(Frame(image.copy(), caps, pts=0).attach(place), key, 1, 0, image.shape)
        attachment = Stamp(1, next(numbers)).attachment(header)
        publisher.put(encode_image(image, ImageFormat.PNG), attachment=attachment)

    return put


@pytest.fixture
def start_view(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Starts servers, which are ended after the test."""
    with ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(view_server(tmp_path, *arguments, **options))


@pytest.fixture
def serve_keys() -> Iterator[Callable[..., str]]:
    """Serves keys from threads, which are ended after the test."""
    with ExitStack() as stack:
        yield lambda *keys, **options: stack.enter_context(view_thread(*keys, **options))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that shows one key, for all tests of a module."""
    with view_server(tmp_path_factory.mktemp("server"), f"test/{uuid.uuid4().hex}") as running:
        yield running


@pytest.fixture(scope="module")
def chromium() -> Iterator[webdriver.Chrome]:
    """Debian's chromium without a window, for all tests of a module."""
    binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if binary is None or driver is None:
        pytest.skip("chromium and chromium-driver are not installed")
    options = Options()
    options.binary_location = binary
    for argument in (*ARGUMENTS, "--window-size={},{}".format(*WINDOW_PX)):
        options.add_argument(argument)
    chrome = webdriver.Chrome(options=options, service=Service(driver))
    try:
        yield chrome
    finally:
        chrome.quit()


@pytest.fixture
def browser(chromium: webdriver.Chrome) -> Iterator[webdriver.Chrome]:
    """A browser that shows nothing and remembers nothing."""
    yield chromium
    chromium.get("about:blank")
    chromium.set_window_size(*WINDOW_PX)
    for command, arguments in FORGETTING.items():
        chromium.execute_cdp_cmd(command, arguments)
    chromium.get_log("browser")


@pytest.fixture(name="wait_for")
def _wait_for() -> Callable[..., Any]:
    """Waits for a condition."""
    return wait_for


def wait_for(condition: Callable[[], Any], limit_s: float = 40.0) -> Any:
    """The first true value of a condition; the limit is one for an idle machine."""
    began_s = time.monotonic()
    while not (found := condition()):
        took_s = time.monotonic() - began_s
        assert took_s < limit_s or took_s < patience(limit_s), "it has not happened in time"
        time.sleep(POLL_S)
    return found
