"""A transport stream that is sent over SRT, by the program ffmpeg."""

from __future__ import annotations

import errno
import os
import select
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from streamkit import RestartDelay
from streamkit.output.pipe import ReaderWait, wait_writable
from streamkit_media.ffmpegprogram import POLL_S, FfmpegProgram, srt_program
from streamkit_media.live.endpoint import Reconnect
from streamkit_media.recording.destination import Destination
from streamkit_media.udp import PACKET_BYTES

# The stream passes as it comes, byte for byte; after its end the connection stays until all has arrived.
# It reports its progress to its output, for the first time when the connection is there.
FROM_PIPE = ("-loglevel", "error", "-progress", "pipe:1", "-f", "data", "-i", "pipe:0")
COPY = ("-map", "0", "-c", "copy", "-flush_packets", "1", "-linger", "2", "-f", "data")
FINISH_LIMIT_S = 3.0  # the linger, which takes a second in any case, and a margin
REASON_LIMIT_S = 1.0
FIRST_DELAY_S, LONGEST_DELAY_S, JITTER = 0.5, 10.0, 0.5  # before tries to connect again, as those of rtspsrc
# The program connects with the first bytes that it reads: null packets, which receivers leave out.
PRIMER = 7 * (b"\x47\x1f\xff\x10" + bytes([0xFF]) * (PACKET_BYTES - 4))


class SrtStream(Destination):
    """Sends to one receiver, which is called or, by `mode=listener`, waited for, and again after its loss.

    Args:
        location: srt://HOST:PORT, with the options of FFmpeg's srt protocol after its `?`.
        reader_wait: how long the first receiver may be awaited, and each may take nothing.
        reconnect: whether the loss of a receiver is an error; a wrong passphrase is one in any case.
        report: called with why there is no connection, and the delay before the next try, s; and with "" and
            0.0 once there is one again.
        lose: called with the number of bytes that are not sent for lack of a connection.

    Raises:
        ResourceError: there is no program ffmpeg with SRT; it is started by the first bytes.
    """

    def __init__(
        self,
        location: str,
        reader_wait: ReaderWait,
        reconnect: Reconnect,
        report: Callable[[str, float], object],
        lose: Callable[[int], object],
    ) -> None:
        super().__init__(Path(location))
        self._reader_wait, self._reconnect = reader_wait, reconnect
        self._report, self._lose = report, lose
        self._command = (srt_program(), *FROM_PIPE, *COPY, location)
        self._program: FfmpegProgram | None = None
        self._delay = RestartDelay(FIRST_DELAY_S, LONGEST_DELAY_S, JITTER)
        self._position = 0  # in the stream, bytes
        # When to connect again; None while there is a connection, or the first is awaited.
        self._due_s: float | None = None

    def write(self, data: bytes) -> int:
        """Sends all of the data, once, or nothing while there is no connection, or after an error."""
        begin, self._position = self._position, self._position + len(data)
        try:
            if self.failure is None and self._due_s is not None:
                start = entry_point(data, -begin % PACKET_BYTES) if self._is_back() else None
                self._lose(len(data) if start is None else start)
                if start is not None:
                    self._has_returned()
                    self._send(memoryview(data)[start:])
            elif self.failure is None:
                self._send(memoryview(data))
        except BrokenPipeError:
            self._lost()
        except OSError as error:
            self.failure = error
        return len(data)

    def _send(self, rest: memoryview) -> None:
        program = self._program = self._program or FfmpegProgram(self._command, has_input=True)
        program.has_written()
        while rest:
            wait_writable(program.input, self._reader_wait)
            rest = rest[os.write(program.input, rest[: select.PIPE_BUF]) :]

    def _is_back(self) -> bool:
        """Whether there is a connection again; begins the next try when it is due."""
        if self._program is None:
            if time.monotonic() < (self._due_s or 0.0):
                return False
            self._program = FfmpegProgram(self._command, has_input=True)
            os.write(self._program.input, PRIMER)
        if self._program.has_written():
            return True
        if self._program.has_ended(0.0):
            raise BrokenPipeError
        return False

    def _has_returned(self) -> None:
        self._due_s = None
        self._delay.reset()
        self._report("", 0.0)

    def _lost(self) -> None:
        """Handles a lost connection: sets the error, or the time of the next try."""
        program = self._program
        assert program is not None
        has_worked = self._due_s is not None or program.has_written()
        error = lost(program)
        is_wanted = self._reconnect is Reconnect.ALWAYS or (
            self._reconnect is Reconnect.ON_ERROR and has_worked
        )
        if program.is_refused() or not is_wanted:
            self.failure = error
            return
        program.close()
        self._program, delay_s = None, self._delay.after()
        self._due_s = time.monotonic() + delay_s
        self._report(str(error.strerror), delay_s)

    def finish(self) -> None:
        """Waits until all has arrived.

        Raises:
            OSError: it has not.
        """
        program = self._program
        if program is None:
            return
        if self._due_s is not None:  # it still tries to connect
            program.close()
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
        while program.read(REASON_LIMIT_S, threading.Event()):
            pass
    reason = program.reason() or "it has closed the connection"
    if program.is_refused():
        reason = "it refuses the passphrase"
    return OSError(errno.ECONNRESET, f"no connection to a receiver: {reason}")


def entry_point(data: bytes, first: int) -> int | None:
    """The packet at which a receiver can begin to decode: the tables that FFmpeg writes before a keyframe.

    Source: ISO/IEC 13818-1, 2.4.3.4 (random_access_indicator) and 2.4.4.3 (the PID of the first table is 0).

    Args:
        data: of a transport stream.
        first: where its first whole packet begins.

    Returns:
        The position of a packet; None where no keyframe begins.
    """
    table: int | None = None
    for at in range(first, len(data) - PACKET_BYTES + 1, PACKET_BYTES):
        header = data[at : at + 6]
        if header[1] & 0x1F == header[2] == 0:
            table = at
        has_flags = header[3] & 0x20 and header[4] > 0
        if has_flags and header[5] & 0x40:
            return at if table is None else table
    return None
