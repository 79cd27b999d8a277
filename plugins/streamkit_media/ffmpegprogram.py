"""The program ffmpeg as a child process, for SRT, which the FFmpeg inside PyAV lacks."""

from __future__ import annotations

import os
import re
import selectors
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial

from streamkit import ResourceError, mask_secrets
from streamkit.handoff.endwithparent import ending_with_parent

NONE_HERE = (
    "SRT needs the program ffmpeg, and none with SRT can be run here (a bin with sandbox=true runs none); "
    "install ffmpeg, or streamkit[srt]"
)
SPEAKER = re.compile(r"^\[\w+ @ \w+\] ")  # the part of FFmpeg that reports
OPTIONS = re.compile(r"(?<=srt://)([^\s?]*)\?\S*")  # in an address, some of them secret
REJECTED = re.compile(r"REJECT.*(?:passphrase|password)", re.IGNORECASE)
LOOK_LIMIT_S = 5.0
END_LIMIT_S = 0.3  # to close the connection, so that the other side need not wait for its own limit
POLL_S = 0.1
PIECE_BYTES = 1 << 16
TEXT_BYTES = 4000


def srt_program() -> str:
    """The path of an ffmpeg with SRT: that of PATH, else that of the package imageio-ffmpeg.

    Raises:
        ResourceError: there is none.
    """
    for program in programs():
        if has_srt(program):
            return program
    raise ResourceError(NONE_HERE)


def programs() -> Iterator[str]:
    """The programs ffmpeg of this machine."""
    if found := shutil.which("ffmpeg"):
        yield os.path.abspath(found)
    try:
        import imageio_ffmpeg

        yield str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):  # not installed; without a program for this machine
        return


@cache
def has_srt(program: str) -> bool:
    """Whether a program ffmpeg says that it knows SRT."""
    command = [program, "-hide_banner", "-loglevel", "error", "-protocols"]
    try:
        answer = subprocess.run(
            command, capture_output=True, timeout=LOOK_LIMIT_S, check=False, stdin=subprocess.DEVNULL
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return b"srt" in answer.stdout.split()


class FfmpegProgram:
    """An ffmpeg that runs and writes to a pipe; one thread uses it, others may call `terminate`.

    Args:
        command: the program and its arguments.
        has_input: whether it reads a pipe, too.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, command: Sequence[str], *, has_input: bool = False) -> None:
        # Its standard error; of a program without input, what has come since the last bytes of its output.
        self._said, self._is_source = b"", not has_input
        # The kernel ends it with the thread that has started it: that one lives until `close`.
        self._starter = ThreadPoolExecutor(1, "ffmpeg")
        start = partial(
            subprocess.Popen[bytes],
            ending_with_parent(command),
            stdin=subprocess.PIPE if has_input else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C in a terminal ends the pipeline, which ends it
        )
        try:
            self._child = self._starter.submit(start).result()
        except OSError:
            self._starter.shutdown()
            raise
        self._selector = selectors.DefaultSelector()
        for pipe in (self._child.stdout, self._child.stderr):
            assert pipe is not None
            self._selector.register(pipe, selectors.EVENT_READ)
        self._output, self._has_written = self._child.stdout, False

    def read(self, limit_s: float, ended: threading.Event) -> bytes:
        """The next bytes of its output as soon as there are any; empty at its end, or once `ended` is set.

        Raises:
            TimeoutError: there are none within the limit.
        """
        deadline = time.monotonic() + limit_s
        while not ended.is_set() and self._selector.get_map():
            for key, _ in self._selector.select(POLL_S):
                data = os.read(key.fd, PIECE_BYTES)
                if not data:
                    self._selector.unregister(key.fileobj)
                elif key.fileobj is self._output:
                    self._said = b"" if self._is_source else self._said
                    return data
                else:
                    self._said = (self._said + data)[-TEXT_BYTES:]
            if time.monotonic() > deadline:
                raise TimeoutError
        return b""

    def has_written(self) -> bool:
        """Whether anything has come from its output, which is taken and not kept."""
        while any(key.fileobj is self._output for key, _ in self._selector.select(0)):
            assert self._output is not None
            if not os.read(self._output.fileno(), PIECE_BYTES):
                self._selector.unregister(self._output)
                break
            self._has_written = True
        return self._has_written

    @property
    def input(self) -> int:
        """The descriptor of its standard input."""
        assert self._child.stdin is not None
        return self._child.stdin.fileno()

    def end_input(self) -> None:
        """Closes its standard input."""
        assert self._child.stdin is not None
        self._child.stdin.close()

    def has_ended(self, limit_s: float) -> bool:
        """Waits for its end up to a limit; whether it has ended."""
        try:
            self._child.wait(limit_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    @property
    def code(self) -> int | None:
        """Its exit code, or the negative number of the signal that ended it; None while it runs."""
        return self._child.returncode

    def errors(self) -> list[str]:
        """The lines that it has reported since its last bytes were read."""
        return self._said.decode(errors="replace").splitlines()

    def is_refused(self) -> bool:
        """Whether it has reported that the other side has another passphrase."""
        return any(map(REJECTED.search, self.errors()))

    def reason(self) -> str:
        """The first of `errors`, which names the cause, without secrets; "" where there is none."""
        return next((mask_secrets(OPTIONS.sub(r"\1", SPEAKER.sub("", line))) for line in self.errors()), "")

    def terminate(self) -> None:
        """Asks it to end."""
        self._child.terminate()

    def close(self) -> None:
        """Ends it, kills it where it does not end in time, and closes its pipes."""
        self._child.terminate()
        if not self.has_ended(END_LIMIT_S):
            self._child.kill()
            self._child.wait()
        self._selector.close()
        for pipe in (self._child.stdin, self._child.stdout, self._child.stderr):
            if pipe is not None:
                pipe.close()
        self._starter.shutdown()
