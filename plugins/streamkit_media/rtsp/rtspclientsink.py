"""rtspclientsink: coded video to an RTSP server that records it."""

from __future__ import annotations

import enum
import errno
import os
import threading
import time

from typing_extensions import override

from streamkit import Caps, Frame, FrameFlags, Property, ResourceError, Sink, mask_secrets
from streamkit_media.codecs import codec_of, extradata_of, is_same_format, size_of
from streamkit_media.failures import access_refused, silence
from streamkit_media.live.endpoint import Endpoint
from streamkit_media.live.reachability import unreachable
from streamkit_media.nalunits import AnnexBConverter, BadPacket
from streamkit_media.recording.packetsink import BEFORE_KEYFRAME, times_of
from streamkit_media.rtsp.pusher import PushOrder, PushPacket
from streamkit_media.rtsp.pushprocess import PushFailure, PushProcess

POLL_S = 0.05
LEAVE_LIMIT_S = 1.0
STOP_LIMIT_S = 5.0
STEADY_S = 5.0  # a connection that has lasted so long was good: retries count from zero
TICK_NS = 11_112  # of RTP's 90 kHz clock, rounded up
JUMP_NS = 1_000_000_000
TOO_SLOW = "the server is too slow"
NOT_CONNECTED = "between two connections"
LOST = "lost with the connection"


Transport = enum.StrEnum("Transport", "TCP UDP")


class RtspClientSink(Endpoint, Sink):
    """Pushes coded video to an RTSP server that takes recordings, such as MediaMTX or gst-rtsp-server.

    It begins with a keyframe. Every change of the connection is an element message `connection` as that of
    `rtspsrc`. Frames are sent as they come; `sync=true` paces those of a file.

    Example:
        filesrc location=flight.mp4 ! rtspclientsink location=rtsp://server/live sync=true
    """

    sink = "video/x-h264; video/x-h265"

    transport: Transport = Property(
        Transport.TCP, doc="What carries the video: tcp loses nothing, udp waits for nothing."
    )
    latency_ms: int = Property(
        500,
        name="latency",
        min=0,
        max=60_000,
        unit="ms",
        doc="Stay so long after the last frame: servers forget what waits in their jitter buffer when we go.",
    )
    max_packets: int = Property(256, min=1, max=8192, doc="Packets held for a server that is slower.")
    drop: bool = Property(
        False, doc="When that many are held, drop frames up to the next keyframe rather than wait."
    )

    def start(self) -> None:
        """Checks the location; the connection is made when the first keyframe comes."""
        self._working = threading.Lock()
        self._process: PushProcess | None = None
        self._caps: Caps | None = None
        self._sent = 0
        self._is_connected = self._was_connected = self._needs_keyframe = False
        self._opened_s = self._retry_s = 0.0
        self._zero = self._last_dts = 0
        super().start()

    @property
    def sent(self) -> int:
        """Packets sent since the start; each that came is sent, counted in `drops`, or still held."""
        return self._sent + (self._process.written if self._process is not None else 0)

    def render(self, frame: Frame) -> None:
        """Sends one packet, or holds it until the server takes it.

        Raises:
            ResourceError: the connection failed and is not, or no longer, to be tried again.
        """
        with self._working:
            try:
                self._push(frame)
            except BadPacket as error:
                self.count_drop("damaged packet")
                self.post_warning(f"{self._where}: a packet is left out: {error}")
            except PushFailure as failure:
                self.count_drop(LOST)
                self._schedule_retry(failure)

    def drain(self) -> None:
        """Sends what is queued and ends the recording.

        Raises:
            ResourceError: the connection failed before.
        """
        with self._working:
            try:
                self._finish()
            except PushFailure as failure:
                self._schedule_retry(failure)
            if self._delay.tries and time.monotonic() < self._retry_s:
                self.post_warning(f"{self._where}: the stream ended while there was no connection")

    @override
    def stop(self) -> None:
        if not self._working.acquire(timeout=STOP_LIMIT_S):
            raise ResourceError(f"{self._where}: a frame is still being sent after {STOP_LIMIT_S:g} s")
        try:
            self._leave()
        finally:
            self._working.release()

    # One packet.

    def _push(self, frame: Frame) -> None:
        is_keyframe = bool(frame.flags & FrameFlags.KEYFRAME)
        if self._process is not None:
            self._check()
        if is_keyframe and self._process is not None and frame.caps is not self._caps:
            self._change_format(frame.caps)
        if self._process is None:
            if time.monotonic() < self._retry_s:
                self.count_drop(NOT_CONNECTED)
                return
            if not is_keyframe:
                self.count_drop(BEFORE_KEYFRAME)
                return
            self._process = self._open(frame)
        self._needs_keyframe &= not is_keyframe
        if self._needs_keyframe or not self._has_room():
            self._needs_keyframe = True
            self.count_drop(TOO_SLOW)
            return
        data = self._annexb.packet(bytes(frame.data), is_keyframe)
        pts, dts = self._times(frame)
        self._process.send(PushPacket(pts, dts, frame.duration or 0, is_keyframe, data))

    def _has_room(self) -> bool:
        """Whether another packet may be held; waits for it unless frames are to be dropped."""
        assert self._process is not None
        with self.waiting():
            while self._process.pending >= self.max_packets:
                if self.drop or self.stopping.is_set():
                    return False
                self._check(POLL_S)
        return True

    def _times(self, frame: Frame) -> tuple[int, int]:
        """Presentation and decoding time, ns from the connection's beginning; decoding times ascend."""
        pts, dts = times_of(frame)
        if dts - self._zero + JUMP_NS < self._last_dts:
            self._zero = dts - self._last_dts - (frame.duration or TICK_NS)
        dts = max(dts - self._zero, self._last_dts + TICK_NS)
        self._last_dts = dts
        return max(pts - self._zero, dts), dts

    # One connection.

    def _open(self, frame: Frame) -> PushProcess:
        """A process that connects for the format of this frame."""
        codec = codec_of(frame.caps)
        self._annexb = AnnexBConverter(codec, extradata_of(frame.caps))
        pts, dts = times_of(frame)
        self._zero, self._last_dts = min(pts, dts), -TICK_NS
        self._caps, self._needs_keyframe, self._is_connected = frame.caps, False, False
        self._opened_s = time.monotonic()
        self._post_state("connecting", attempt=self._delay.tries)
        options = {"rtsp_transport": self.transport.value, **self._tls_options}
        order = PushOrder(self._url, options, codec, *size_of(frame.caps), self.timeout_s)
        try:
            return PushProcess(order)
        except OSError as error:
            raise ResourceError(f"the process that pushes could not be started: {error.strerror}") from error

    def _change_format(self, caps: Caps) -> None:
        """Ends the connection where the format differs: a connection has one format."""
        assert self._caps is not None
        if is_same_format(caps, self._caps):
            self._caps = caps
        else:
            self._finish()

    def _check(self, wait_s: float = 0.0) -> None:
        process = self._process
        assert process is not None
        try:
            process.check(wait_s)
        finally:
            if process.is_ready and not self._is_connected:
                self._is_connected = self._was_connected = True
                self._post_state("connected", caps=str(self._caps))

    def _finish(self) -> None:
        """Sends what is queued and ends the recording."""
        process = self._process
        if process is not None:
            while process.pending and not self.stopping.is_set():
                self._check(POLL_S)
            self.stopping.wait(self.latency_ms / 1000)
            process.end()
            while not process.is_done and not self.stopping.is_set():
                self._check(POLL_S)
        self._leave()

    def _leave(self, reason: str = "the pipeline was stopped", limit_s: float = LEAVE_LIMIT_S) -> None:
        """Ends the process; what it still held counts as dropped."""
        process, self._process = self._process, None
        if process is None:
            return
        process.close(limit_s)
        self._sent += process.written
        if process.pending:
            self.count_drop(reason, process.pending)

    # Between two connections.

    def _schedule_retry(self, failure: PushFailure) -> None:
        """Sets the time of the next try.

        Raises:
            ResourceError: there is to be none.
        """
        self._leave(LOST, 0)
        if self._is_connected and time.monotonic() - self._opened_s >= STEADY_S:
            self._delay.reset()
        delay_s = self._retry(self._error(failure), has_worked=self._was_connected)
        self._retry_s = time.monotonic() + delay_s

    def _error(self, failure: PushFailure) -> ResourceError:
        """The failure with where it happened and what to do."""
        where, reason = self._where, mask_secrets(failure.reason)
        if failure.is_refused:
            return access_refused(where, reason)
        if failure.is_silent:
            return silence(where, self.timeout_s, "check that it takes recordings")
        if self._is_connected:
            return ResourceError(
                f"{where}: the server has ended the connection: {reason}; check that it still runs"
            )
        # FFmpeg reports an unknown host in these words, and every failure of TLS.
        if self._tls_options or reason == os.strerror(errno.EIO):
            remedy = "check address and port, and that the server runs"
            cause = unreachable(self.location, self._tls_options.get("ca_file"), self.timeout_s, remedy)
            if cause:
                return ResourceError(f"{where}: {cause}")
        return ResourceError(
            f"{where}: no recording there: {reason}; "
            "check address, port and path, and that the server takes recordings"
        )
