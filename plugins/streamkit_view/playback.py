"""Playback: the pipeline of a file or camera, in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from importlib.resources import as_file, files
from pathlib import Path
from typing import NamedTuple

from streamkit import STREAMKIT_COMMAND, mask_secrets
from streamkit_view.locations import pipeline_for

STOP_LIMIT_S = 5.0
LINE_LIMIT_BYTES = 2000
LIVE_PIPELINES = ("camera.pipe", "encoded_camera.pipe")
OTHER_CODEC = "takes video/x-h264; video/x-h265"  # in the error of packets that are not for a browser


class PrintedLine(NamedTuple):
    """A line that a pipeline printed, and when, on the monotonic clock; "" and 0 before the first."""

    text: str = ""
    at_s: float = 0.0


class PlayedPipeline:
    """Runs the pipeline of one location; safe to use from several threads.

    Args:
        location: a file, or a URL.
        key: where it publishes.
        video: the file of a finished run's video, or "".
        command: of streamkit; the process gets `launch` and its arguments.
        encodes: whether the video of a live feed is encoded anew.

    Attributes:
        printed: what the pipeline printed last, for example that a camera is away.
    """

    def __init__(
        self,
        location: str,
        key: str,
        video: str = "",
        command: tuple[str, ...] = STREAMKIT_COMMAND,
        *,
        encodes: bool = False,
    ) -> None:
        self._location, self._command = location, command
        self._pipeline, source = pipeline_for(location, encodes=encodes)
        self._variables = {"location": location, "key": key} | ({"video": video} if video else {})
        if self._pipeline in LIVE_PIPELINES:
            self._variables["source"] = source
        self._process: subprocess.Popen[bytes] | None = None
        self._error, self.printed = "", PrintedLine()
        self._lock = threading.Lock()
        self._is_closed = False

    def start(self) -> None:
        """Starts the pipeline, unless it runs: the first page that comes sees the beginning."""
        with self._lock, as_file(files("streamkit_view") / "pipelines") as folder:
            if self._is_closed or (self._process is not None and self._process.poll() is None):
                return
            self._error, self.printed = "", PrintedLine()
            arguments = ["launch", "-f", str(folder / self._pipeline)]
            for name, value in self._variables.items():
                arguments += ["--set", f"{name}={value}"]
            self._process = subprocess.Popen(
                [*self._command, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is for the server, which ends the pipeline
            )
            threading.Thread(target=self._read, args=(self._process,), name="view playback").start()

    @property
    def title(self) -> str:
        """What is played, without secrets and folders."""
        return mask_secrets(self._location) if "://" in self._location else Path(self._location).name

    @property
    def failure(self) -> str:
        """The first error that a failed pipeline printed; "" while it runs, and after its end."""
        with self._lock:
            if self._is_closed or self._process is None:
                return ""
            if self._error or not self._process.poll():
                return self._error
            return self.printed.text or f"the pipeline ended with {self._process.returncode}"

    @property
    def progress(self) -> str:
        """What the starting pipeline waits for: its last warning, for example of an element that compiles."""
        return f"The pipeline is starting. {self.printed.text}".rstrip()

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        """Shows what the pipeline prints in this terminal, too; ends with the pipeline."""
        assert process.stderr is not None
        with process.stderr as lines:
            while line := lines.readline(LINE_LIMIT_BYTES):
                text = mask_secrets(line.decode(errors="replace").strip())
                if OTHER_CODEC in text:
                    text += "; streamkit view --encode encodes the video for browsers"
                if shown := text.removeprefix("warning: "):
                    self.printed = PrintedLine(shown, time.monotonic())
                if text.startswith("error: "):
                    self._error = self._error or text
                print(text, file=sys.stderr, flush=True)

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
