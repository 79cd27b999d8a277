"""A server of `streamkit view` in a process of its own, and a browser that looks at its page."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

from tests.slowness import patience

STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--window-size=1280,800",
)
LOOK_EVERY_S = 0.05


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


@pytest.fixture
def key() -> str:
    """A key of this test alone."""
    return f"test/{uuid.uuid4().hex}"


@pytest.fixture
def start_view(tmp_path: Path) -> Iterator[Callable[..., Server]]:
    """Starts servers, which are ended after the test."""
    with ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(view_server(tmp_path, *arguments, **options))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that shows one key, for all tests of a module."""
    with view_server(tmp_path_factory.mktemp("server"), f"test/{uuid.uuid4().hex}") as running:
        yield running


@pytest.fixture
def browser() -> Iterator[webdriver.Chrome]:
    """Debian's chromium without a window."""
    binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if binary is None or driver is None:
        pytest.skip("chromium and chromium-driver are not installed")
    options = Options()
    options.binary_location = binary
    for argument in ARGUMENTS:
        options.add_argument(argument)
    chrome = webdriver.Chrome(options=options, service=Service(driver))
    try:
        yield chrome
    finally:
        chrome.quit()


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
        time.sleep(LOOK_EVERY_S)
    return found
