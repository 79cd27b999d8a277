"""Fixtures shared by every test."""

import gc
import math
import os
import signal
import subprocess
import sysconfig
import time
import venv
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import av
import hypothesis  # before trio: else pytest's summary fails where no test has imported it
import pytest

from streamkit import Element
from streamkit.element import registry
from tests.entry_points import adding_entry_points
from tests.process_option import use_processes
from tests.slowness import patience, slowness

# The workers of the tests fill the cores; a second thread of OpenCV would wait in a loop for the first one.
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
# Zenoh sessions of this worker and its children meet neither other workers' nor the user's own. Linux gives
# connections the ports from 32 768 on.
MEETING_PORT = 30_000 + os.getpid() % 40 * 64
os.environ["STREAMKIT_MEETING_PORTS"] = f"{MEETING_PORT}-{MEETING_PORT + 63}"
ROOT = Path(__file__).parents[1]
MODULE = "elements_of_a_test"
Register = Callable[..., None]
# Who runs the tests in the background, or under nohup, has these ignored, and each child would inherit that.
for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)
COMMANDS = {
    "streamkit": "exec {python} -c 'from streamkit.cli.main import main; main()' \"$@\"",
    "pip": 'verb=$1; shift; exec {python} -m pip "$verb" --quiet --disable-pip-version-check '
    '--no-index --no-deps --no-build-isolation "$@"',
}

# The same examples in each run, and no limit of time for one of them: the machine may be busy.
hypothesis.settings.register_profile(
    "repeatable", derandomize=True, deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow]
)
hypothesis.settings.load_profile("repeatable")
SLOWNESS = pytest.StashKey[tuple[Path, float, float]]()
SLOWNESS_PERIOD_S = 5.0


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option of `process_option`."""
    parser.addoption("--process-of", metavar="ELEMENT", help="run each such element in a process of its own")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files that take long begin first: workers run whole files, and none should be left with one alone."""
    items.sort(key=lambda item: item.get_closest_marker("long") is None)


@pytest.fixture(autouse=True)
def process_of(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Follows `--process-of`."""
    if factory := request.config.getoption("--process-of"):
        if request.node.get_closest_marker("one_process"):
            pytest.skip("about one process")
        use_processes(factory, monkeypatch)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """A test's limit of time is one for an idle machine; a slow one gets as many times longer.

    How slow it is, is measured before a file, every few seconds; the slowest so far counts.
    """
    path, measured_s, factor = item.config.stash.get(SLOWNESS, (None, -math.inf, 1.0))
    if path != item.path:
        if not gc.get_freeze_count():  # `launch` unfreezes; a search among all collected tests takes 0.5 s
            gc.freeze()
        if time.monotonic() - measured_s > SLOWNESS_PERIOD_S:
            factor, measured_s = max(factor, slowness()), time.monotonic()
        item.config.stash[SLOWNESS] = item.path, measured_s, factor
    marker = item.get_closest_marker("timeout")
    limit_s = float(marker.args[0] if marker else item.config.getini("timeout"))
    item.add_marker(pytest.mark.timeout(limit_s * factor), append=False)
    return (yield)


@pytest.fixture(scope="session")
def shared_folder() -> Path:
    """The shared folder with real data and conformance cases; skips the test where it is not there."""
    value = os.environ.get("STREAMKIT_DATA")
    if not value:
        pytest.skip("STREAMKIT_DATA is unset: this test needs the shared data folder")
    return Path(value)


@pytest.fixture(scope="session")
def streamkit_data(shared_folder: Path) -> Path:
    """The `data` folder with real videos, pictures and telemetry."""
    return shared_folder / "data"


class FreshEnvironment:
    """A Python environment as a plugin's author has it: streamkit is there, installing needs no network.

    Attributes:
        folder: where it is.
        variables: those of a shell in which it is active; `python`, `pip` and `streamkit` are its own.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        venv.create(folder, with_pip=False)
        packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
        visible = [sysconfig.get_path("purelib"), sysconfig.get_path("platlib"), ROOT, ROOT / "plugins"]
        (packages / "visible.pth").write_text("\n".join(map(str, visible)) + "\n", encoding="utf-8")
        for name, script in COMMANDS.items():
            file = folder / "bin" / name
            file.write_text("#!/bin/sh\n" + script.format(python=folder / "bin" / "python") + "\n")
            file.chmod(0o755)
        path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
        # Of pytest's plugins, those of this project's own tests: the author has none of them.
        without_plugins = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
        self.variables = {**os.environ, "PATH": path, "VIRTUAL_ENV": str(folder), **without_plugins}

    def run(self, *command: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Runs a command in it."""
        return subprocess.run(
            command, cwd=cwd or self.folder, env=self.variables, capture_output=True, text=True,
            timeout=patience(80), check=False,
        )  # fmt: skip


@pytest.fixture
def turned_video(tmp_path: Path) -> Path:
    """A video of one frame, 64 x 48, that is to be rotated by 90 degrees for display, as a telephone's."""
    path = tmp_path / "turned.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.set_display_rotation(90)
        container.mux(stream.encode(av.VideoFrame(64, 48, "yuv420p")))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(scope="session")
def make_environment(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], FreshEnvironment]:
    """Makes environments that know nothing of each other."""
    return lambda: FreshEnvironment(tmp_path_factory.mktemp("environment"))


def _forget() -> None:
    registry.available_elements.cache_clear()
    registry.element_class.cache_clear()


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Iterator[Register]:
    """Makes classes usable in descriptions, `register(name=Class)`: in this test only, before all others."""
    add_entry_point = adding_entry_points(monkeypatch, MODULE)

    def add(**classes: type[Element] | str) -> None:
        for name, found in classes.items():
            add_entry_point(registry.GROUP, name, found)
        _forget()

    yield add
    _forget()


@pytest.fixture
def forget_registered(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Forgets afterwards what a test has registered by `register_element`."""
    monkeypatch.setattr(registry, "_registered", {})
    yield
    _forget()
