"""A transport stream that is sent over SRT, by the program ffmpeg."""

from __future__ import annotations

import errno
import os
import select
import threading
import time
from contextlib import suppress
from pathlib import Path

from streamkit.output.pipe import ReaderWait, wait_writable
from streamkit_media.live.ffmpegprogram import POLL_S, FfmpegProgram, srt_program
from streamkit_media.recording.destination import Destination

# The stream passes as it comes, byte for byte; after its end the connection stays until all has arrived.
FROM_PIPE = ("-loglevel", "error", "-f", "data", "-i", "pipe:0")
COPY = ("-map", "0", "-c", "copy", "-flush_packets", "1", "-linger", "2", "-f", "data")
FINISH_LIMIT_S = 3.0  # the linger, which takes a second in any case, and a margin
REASON_LIMIT_S = 1.0


class SrtStream(Destination):
    """Sends to one receiver, which is called or, by `mode=listener`, waited for; its loss is an error.

    Args:
        location: srt://HOST:PORT, with the options of FFmpeg's srt protocol after its `?`.
        reader_wait: how long the receiver may take nothing, or be awaited.

    Raises:
        ResourceError: there is no program ffmpeg with SRT; it is started by the first bytes.
    """

    def __init__(self, location: str, reader_wait: ReaderWait) -> None:
        super().__init__(Path(location))
        self._reader_wait = reader_wait
        self._command = (srt_program(), *FROM_PIPE, *COPY, location)
        self._program: FfmpegProgram | None = None

    def write(self, data: bytes) -> int:
        """Sends all of the data, once; after an error, which FFmpeg may hide, nothing."""
        rest = memoryview(data)
        try:
            program = self._program = self._program or FfmpegProgram(self._command, has_input=True)
            while rest and self.failure is None:
                wait_writable(program.input, self._reader_wait)
                rest = rest[os.write(program.input, rest[: select.PIPE_BUF]) :]
        except BrokenPipeError:
            self.failure = lost(program)
        except OSError as error:
            self.failure = error
        return len(data)

    def finish(self) -> None:
        """Waits until all has arrived.

        Raises:
            OSError: it has not.
        """
        program = self._program
        if program is None:
            return
        try:
            program.end_input()
            self._await_end(program)
            if program.code:
                raise lost(program)
        finally:
            program.close()

    def _await_end(self, program: FfmpegProgram) -> None:
        wait, began_s = self._reader_wait, time.monotonic()
        with wait.waiting():
            while not program.has_ended(POLL_S):
                limit_s = FINISH_LIMIT_S if wait.stopping.is_set() else max(wait.limit_s, FINISH_LIMIT_S)
                if time.monotonic() - began_s > limit_s:
                    raise TimeoutError(errno.ETIMEDOUT, f"its reader has taken nothing for {limit_s:g} s")

    def abandon(self) -> None:
        """Ends the connection after an error."""
        if self._program is not None:
            self._program.close()

    discard = abandon


def lost(program: FfmpegProgram) -> OSError:
    """Why a program has ended; no BrokenPipeError, which would be the end of a standard output."""
    with suppress(TimeoutError):  # then what it has said so far is the reason
        program.read(REASON_LIMIT_S, threading.Event())
    reason = program.reason() or "it has closed the connection"
    if program.is_refused():
        reason = "it refuses the passphrase"
    return OSError(errno.ECONNRESET, f"no connection to a receiver: {reason}")
