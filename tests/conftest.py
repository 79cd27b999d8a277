"""Fixtures shared by every test."""

import os
import subprocess
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COMMANDS = {
    "streamkit": "exec {python} -c 'from streamkit.cli.main import main; main()' \"$@\"",
    "pip": 'verb=$1; shift; exec {python} -m pip "$verb" --quiet --disable-pip-version-check '
    '--no-index --no-deps --no-build-isolation "$@"',
}


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
        self.variables = {**os.environ, "PATH": path, "VIRTUAL_ENV": str(folder)}

    def run(self, *command: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Runs a command in it."""
        return subprocess.run(
            command, cwd=cwd or self.folder, env=self.variables, capture_output=True, text=True, timeout=80,
            check=False,
        )  # fmt: skip


@pytest.fixture(scope="session")
def make_environment(tmp_path_factory: pytest.TempPathFactory) -> Callable[[], FreshEnvironment]:
    """Makes environments that know nothing of each other."""
    return lambda: FreshEnvironment(tmp_path_factory.mktemp("environment"))
