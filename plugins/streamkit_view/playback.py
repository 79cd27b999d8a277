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

from streamkit import (
    ANY,
    STREAMKIT_COMMAND,
    Caps,
    ElementFailure,
    Pipeline,
    RecordFile,
    choose_source,
    mask_secrets,
)

STOP_LIMIT_S = 5.0
LINE_LIMIT_BYTES = 2000
PAGE_CODECS = ("video/x-h264", "video/x-h265")  # of packets that browsers decode; else they get images


class PrintedLine(NamedTuple):
    """A line that a pipeline printed, and when, on the monotonic clock; "" and 0 before the first."""

    text: str = ""
    at_s: float = 0.0


def is_source(text: str) -> bool:
    """Whether an argument is a file or the URL of a camera, and not a key."""
    return "://" in text or Path(text).is_file()


def is_run(text: str) -> bool:
    """Whether an argument is the records of a finished run."""
    return Path(text).suffix.lower() == ".jsonl"


def pipeline_for(location: str) -> tuple[str, str]:
    """The name of the pipeline for a location, and the element and property that take it."""
    if is_run(location):
        return "run.pipe", "tracksrc location"
    source = choose_source(location)
    name = "camera.pipe" if source.is_live else "file.pipe"
    if Path(location).is_file() and media_type_of(location) not in PAGE_CODECS:
        name = "images.pipe"
    return name, f"{source.element} {source.property}"


def unplayable(location: str, *, with_records: bool = False) -> str:
    """Why a file cannot be played; "" where it can, and for a URL, which is opened with the page.

    Args:
        location: file or URL.
        with_records: whether it is the video of a finished run, of which the page gets the packets.
    """
    if "://" in location:
        return ""
    try:
        media_type = media_type_of(location)
    except ElementFailure as error:
        return str(error.cause)
    if with_records and media_type not in PAGE_CODECS:
        remedy = f"filesrc location={location} ! decode ! videofilesink location=flight.mp4"
        return f"{location}: browsers decode no {media_type}; convert it: streamkit launch '{remedy}'"
    return ""


def size_conflict(records: str, video: str) -> str:
    """Why records are not those of a video: frames of another size; "" where none is known to differ."""
    caps = caps_of(video)
    size = (caps.get("width"), caps.get("height")) if caps is not None else (None, None)
    _, record = next(iter(RecordFile(records)), (0, None))
    recorded = (None, None) if record is None else (record.width, record.height)
    if None in size or None in recorded or size == recorded:
        return ""
    return "{}: the tracks are of frames of {} x {} px, the video has {} x {}; give their own video".format(
        video, *recorded, *size
    )


def media_type_of(file: str) -> str:
    """The media type of a file's video, such as video/x-h264, or of its records.

    Raises:
        ElementFailure: the file cannot be played; `cause` says why.
    """
    caps = caps_of(file)
    return "" if caps is None else str(caps.name)


def caps_of(file: str) -> Caps | None:
    """The caps of a file's packets or records, as far as its head tells.

    Raises:
        ElementFailure: the file cannot be played; `cause` says why.
    """
    element = "tracksrc" if is_run(file) else choose_source(file).element
    pipeline = Pipeline.parse(f"{element} name=file ! fakesink")
    pipeline["file"].location = file
    with pipeline:
        pipeline.ready()
        caps: Caps | None = pipeline["file"].negotiate(ANY)
    return caps


class PlayedPipeline:
    """Runs the pipeline of one location; safe to use from several threads.

    Args:
        location: a file, or a URL.
        key: where it publishes.
        video: the file of a finished run's video, or "".
        command: of streamkit; the process gets `launch` and its arguments.
    """

    def __init__(
        self, location: str, key: str, video: str = "", command: tuple[str, ...] = STREAMKIT_COMMAND
    ) -> None:
        self._location, self._command = location, command
        self._pipeline, source = pipeline_for(location)
        self._variables = {"location": location, "key": key} | ({"video": video} if video else {})
        if self._pipeline == "camera.pipe":
            self._variables["source"] = source
        self._process: subprocess.Popen[bytes] | None = None
        self._error, self._printed = "", PrintedLine()
        self._lock = threading.Lock()
        self._is_closed = False

    def start(self) -> None:
        """Starts the pipeline, unless it runs: the first page that comes sees the beginning."""
        with self._lock, as_file(files("streamkit_view") / "pipelines") as folder:
            if self._is_closed or (self._process is not None and self._process.poll() is None):
                return
            self._error, self._printed = "", PrintedLine()
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
            return self._printed.text or f"the pipeline ended with {self._process.returncode}"

    @property
    def progress(self) -> str:
        """What the starting pipeline waits for: its last warning, for example of an element that compiles."""
        return f"The pipeline is starting. {self._printed.text}".rstrip()

    @property
    def printed(self) -> PrintedLine:
        """What the pipeline printed last, for example that a camera is away."""
        return self._printed

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        """Shows what the pipeline prints in this terminal, too; ends with the pipeline."""
        assert process.stderr is not None
        with process.stderr as lines:
            while line := lines.readline(LINE_LIMIT_BYTES):
                text = mask_secrets(line.decode(errors="replace").strip())
                if shown := text.removeprefix("warning: "):
                    self._printed = PrintedLine(shown, time.monotonic())
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
