"""Elements that misbehave, in a package that child processes find, too."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from streamkit.element import registry

MODULE = '''
import ctypes, os, signal, subprocess, threading, time
from dataclasses import dataclass
import numpy as np
from streamkit import Caps, Direction, PadTemplate, Presence, Property, Source, Transform


@dataclass(frozen=True)
class Mark:
    """Metadata that crosses."""

    text: str
    numbers: tuple[int, ...]
    array: np.ndarray
    inner: "Mark | None" = None


class Plain:
    """Metadata that does not."""


class Doomed(Transform):
    """Dies in a chosen way at a chosen frame, or at the start (-2) or the stop (-3)."""

    sink = src = "ANY"
    how: str = Property("", live=True)
    at: int = Property(-1, live=True)
    note: str = Property("", live=True)

    def start(self):
        if self.at == -2:
            self.die()

    def stop(self):
        if self.at == -3:
            self.die()

    def transform(self, frame):
        if frame.seq == self.at:
            self.die()
        return frame

    def die(self):
        if self.how == "segfault":
            ctypes.string_at(0)
        if self.how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.how == "exit":
            os._exit(7)
        if self.how == "abort":
            os.abort()
        if self.how == "sleep":
            time.sleep(600)
        if self.how == "hold":  # the interpreter's lock
            ctypes.PyDLL(None).sleep(600)
        if self.how == "raise":
            raise ValueError("as the test wants")
        if self.how == "stop":
            os.kill(os.getpid(), signal.SIGSTOP)
            time.sleep(600)  # the signal may be taken by another thread, which lets this one run on a little


class Marker(Transform):
    """Attaches metadata of this package."""

    sink = src = "ANY"
    plain: bool = Property(False)

    def transform(self, frame):
        inner = Mark("", (), np.eye(2)[::2])
        mark = Mark("\\u00fc", (frame.seq, 2**63), np.arange(6.0).reshape(2, 3).T, inner)
        frame = frame.attach(mark)
        return frame.attach(Plain()) if self.plain else frame


class Burglar(Transform):
    """Tries what a sandbox refuses, and tells which attempts have failed."""

    sink = src = "ANY"
    secret: str = Property("")
    replaces: bool = Property(False)  # where that is not refused, it ends the process

    def start(self):
        attempts = {
            "read": lambda: open(self.secret).read(),
            "list": lambda: os.listdir(os.path.dirname(self.secret)),
            "write": lambda: open(self.secret, "a"),
            "create": lambda: open(self.secret + "-new", "w"),
            "remove": lambda: os.remove(self.secret),
            "rename": lambda: os.rename(self.secret, self.secret + "-other"),
            "truncate": lambda: os.truncate(self.secret, 0),
            "program": lambda: os.execv("/bin/true", ["true"]),
            "shell": lambda: subprocess.run(["/bin/true"], check=True),
            "fork": lambda: os.fork() or os._exit(0),
            "signal": lambda: os.kill(os.getppid(), 0),
            "privilege": lambda: os.chroot("/"),
        }
        if not self.replaces:
            del attempts["program"]
        held, opened = [], []
        for name, attempt in attempts.items():
            try:
                attempt()
            except OSError:
                held.append(name)
            else:
                opened.append(name)
        threading.Thread(target=lambda: None).start()
        open("/dev/null", "w").close()
        self.post_message("attempts", held=" ".join(held), opened=" ".join(opened))

    def transform(self, frame):
        return frame


class Hungry(Transform):
    """Takes 64 MiB of memory with each frame."""

    sink = src = "ANY"

    def start(self):
        self.kept = []

    def transform(self, frame):
        self.kept.append(np.empty(2**26, np.uint8))
        return frame


class Demux(Source):
    """Its stream decides which pads it has."""

    templates = (PadTemplate("video_%u", Direction.SRC, Caps("video/x-raw"), Presence.SOMETIMES),)


class Keeper(Transform):
    """Keeps every frame, and checks at the end that none has changed."""

    sink = src = "ANY"

    def start(self):
        self.kept = []

    def transform(self, frame):
        self.kept.append((frame.data, frame.data.copy()))
        return frame

    def drain(self):
        assert all(np.array_equal(kept, copy) for kept, copy in self.kept), "a kept frame has changed"
        return ()
'''
NAMES = ("doomed", "marker", "burglar", "hungry", "demux", "keeper")


@pytest.fixture(autouse=True)
def misbehaving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Installs the elements, for this process and those that it starts."""
    name = "streamkit_misbehaving"
    (tmp_path / f"{name}.py").write_text(MODULE)
    info = tmp_path / f"{name}-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    lines = [f"{element} = {name}:{element.capitalize()}" for element in NAMES]
    (info / "entry_points.txt").write_text("\n".join(["[streamkit.elements]", *lines, ""]))
    monkeypatch.syspath_prepend(tmp_path)
    registry.available_elements.cache_clear()
    registry.element_class.cache_clear()
    yield
    sys.modules.pop(name, None)
    registry.available_elements.cache_clear()
    registry.element_class.cache_clear()
