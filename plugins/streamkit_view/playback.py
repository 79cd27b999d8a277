"""Playback: the pipeline of a file or camera, in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from pathlib import Path
from urllib.parse import urlsplit

from streamkit import mask_secrets

STOP_LIMIT_S = 5.0
ERROR_LIMIT_BYTES = 2000
COMMAND = (sys.executable, "-c", "from streamkit.cli.main import main; main()")


def is_source(text: str) -> bool:
    """Whether an argument is a file or the URL of a camera, and not a key."""
    return "://" in text or Path(text).is_file()


def pipeline_for(location: str) -> str:
    """The name of the pipeline for a location."""
    return "camera.pipe" if urlsplit(location).scheme in ("rtsp", "rtsps") else "file.pipe"


class Playback:
    """Runs the pipeline of one location; safe to use from several threads.

    Args:
        location: a file, or a URL.
        key: where it publishes.
        command: of streamkit; the process gets `launch` and its arguments.
    """

    def __init__(self, location: str, key: str, command: tuple[str, ...]) -> None:
        self._location, self._key, self._command = location, key, command
        self._process: subprocess.Popen[bytes] | None = None
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close()
        self._lock = threading.Lock()
        self._is_closed = False

    def start(self) -> None:
        """Starts the pipeline, unless it runs: the first page that comes sees the beginning."""
        with self._lock, as_file(files("streamkit_view") / "pipelines") as folder:
            if self._is_closed or (self._process is not None and self._process.poll() is None):
                return
            self._errors.seek(0)
            self._errors.truncate()
            arguments = ["launch", "-q", "-f", str(folder / pipeline_for(self._location))]
            arguments += ["--set", f"location={self._location}", "--set", f"key={self._key}"]
            self._process = subprocess.Popen(
                [*self._command, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                start_new_session=True,  # Ctrl-C is for the server, which ends the pipeline
            )

    @property
    def title(self) -> str:
        """What is played, without secrets and folders."""
        return mask_secrets(self._location) if "://" in self._location else Path(self._location).name

    @property
    def failure(self) -> str:
        """The last line that a failed pipeline printed; "" while it runs, and after its end."""
        with self._lock:
            if self._is_closed or self._process is None or not self._process.poll():
                return ""
            size = self._errors.seek(0, 2)
            self._errors.seek(max(0, size - ERROR_LIMIT_BYTES))
            lines = self._errors.read().decode(errors="replace").strip().splitlines()
            return mask_secrets(lines[-1] if lines else f"the pipeline ended with {self._process.returncode}")

    def close(self) -> None:
        """Ends the pipeline: asks, waits, kills."""
        with self._lock:
            process, self._is_closed = self._process, True
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(STOP_LIMIT_S)
        self._errors.close()


@contextmanager
def playing(location: str, key: str) -> Iterator[Playback]:
    """A playback that is ended with the block."""
    playback = Playback(location, key, COMMAND)
    try:
        yield playback
    finally:
        playback.close()
