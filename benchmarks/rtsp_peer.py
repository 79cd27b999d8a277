"""What the RTSP benchmarks share: the tests' own server in a process of its own, and figures of this one."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

SERVER = Path(__file__).parents[1] / "tests" / "plugins" / "streamkit_media" / "rtsp" / "fake_server.py"


def server_module() -> ModuleType:
    """`FakeServer`, `Behaviour`, `access_units`."""
    name = "streamkit_media_fake_server"
    spec = importlib.util.spec_from_file_location(name, SERVER)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextmanager
def server_process(width: int, height: int, rate: int) -> Iterator[str]:
    """A server that plays at a size and rate; its URL."""
    command = [sys.executable, str(SERVER), str(width), str(height), str(rate)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield f"rtsp://127.0.0.1:{int(process.stdout.readline())}/live"
        assert process.stdin is not None
        process.stdin.close()
        process.wait(20)


def resident_mb() -> float:
    """Memory of this process."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def descriptors() -> int:
    """Open files of this process."""
    return len(os.listdir("/proc/self/fd"))
