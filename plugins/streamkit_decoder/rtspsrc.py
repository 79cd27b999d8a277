"""rtspsrc: live video from a camera, drone or server."""

from __future__ import annotations

import enum
import time
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

from av.packet import Packet
from av.video.stream import VideoStream

from streamkit import Caps, Capture, Frame, FrameFlags, Property, ResourceError, Source
from streamkit_decoder.codecs import CODED_CAPS
from streamkit_decoder.location import redact
from streamkit_decoder.packetreader import DEFAULT_PORTS, PacketReader, port_of, silence
from streamkit_decoder.packetring import PacketRing
from streamkit_decoder.packets import packet_frame

WATCHDOG_MARGIN_S = 0.5
STOP_LIMIT_S = 1.8
# A live picture is wanted now: FFmpeg would otherwise collect up to five seconds to guess the frame rate.
LIVE_OPTIONS = {"analyzeduration": "1500000", "fpsprobesize": "0"}


class Transport(enum.StrEnum):
    """What carries the video."""

    TCP = "tcp"
    UDP = "udp"


class RtspSrc(Source):
    """Receives the video of an RTSP server as coded packets, the newest first when nobody keeps up.

    Example:
        rtspsrc location=rtsp://drone/live ! decode ! fakesink
    """

    src = CODED_CAPS
    is_live = True

    location: str = Property("", doc="URL, rtsp://user:password@host:port/path; passwords are never shown.")
    transport: Transport = Property(
        Transport.TCP, doc="What carries the video: tcp loses nothing, udp waits for nothing."
    )
    timeout_s: float = Property(
        5.0, min=0.1, max=600.0, unit="s", doc="Silence, also while connecting, that ends in an error."
    )
    max_packets: int = Property(
        64, min=2, doc="Packets held for a slow consumer before the oldest are dropped."
    )

    def start(self) -> None:
        """Checks the location; the connection is made by the source's thread."""
        self._reader: PacketReader | None = None
        self._ring = PacketRing[Frame](self.max_packets)
        self._seq = -1
        parts = urlsplit(self.location)
        try:
            port_of(self.location)
        except ValueError as error:
            raise ResourceError(
                f"location={redact(self.location)}: {error}; write rtsp://host:port/path"
            ) from None
        if parts.scheme not in DEFAULT_PORTS or not parts.hostname:
            raise ResourceError(
                f"location={redact(self.location)!r} must be an RTSP URL; write location=rtsp://host:port/path"
            )

    def negotiate(self, allowed: Caps) -> Caps | None:
        """Only the server can tell."""
        return None

    def frames(self) -> Iterator[Frame]:
        """The packets as they come.

        Raises:
            ResourceError: the server refuses, is silent for `timeout_s`, or ends in an error.
        """
        ring = self._ring
        self._reader = PacketReader(self.location, self._options(), self.timeout_s, ring, self._arrived)
        self._reader.begin()
        last = time.monotonic()
        flags = FrameFlags.NONE
        while not self.stopping.is_set():
            frame = ring.take(min(0.5, self.timeout_s))
            now = time.monotonic()
            if dropped := ring.take_dropped():
                self.count_drop("consumer too slow, older packets dropped", dropped)
                flags = FrameFlags.DISCONTINUITY
            if frame is not None:
                last = now
                yield frame.replace(flags=frame.flags | flags) if flags else frame
                # The consumer's own time is not the server's silence.
                last = time.monotonic()
                flags = FrameFlags.NONE
            elif ring.is_over:
                self.post_warning(f"{redact(self.location)}: the server has ended the stream")
                return
            elif now - last > self.timeout_s + WATCHDOG_MARGIN_S:
                raise silence(self.location, self.timeout_s)

    def interrupt(self) -> None:
        """Wakes the source's thread."""
        self._ring.wake()

    def stop(self) -> None:
        """Ends the connection and the thread that reads it."""
        reader, self._reader = self._reader, None
        if reader is not None and not reader.end(STOP_LIMIT_S):
            self.post_warning(
                f"FFmpeg has not let go of {redact(self.location)} within {STOP_LIMIT_S:g} s; "
                f"it will within {self.timeout_s:g} s"
            )

    def settings(self) -> dict[str, Any]:
        """The properties set in the text, the location without passwords."""
        found = super().settings()
        if "location" in found:
            found["location"] = redact(str(found["location"]))
        return found

    def _options(self) -> dict[str, str]:
        limit_us = str(round(self.timeout_s * 1e6))
        return {**LIVE_OPTIONS, "rtsp_transport": self.transport.value, "timeout": limit_us}

    def _arrived(self, packet: Packet[VideoStream], caps: Caps) -> None:
        """In the reader's thread: notes when a packet came and lines it up."""
        frame = packet_frame(packet, caps)
        self._seq += 1
        self._ring.put(
            frame.replace(
                seq=self._seq, arrival_ns=self.clock_ns(), capture=Capture(self.clock.utc_ns(), "arrival")
            ),
            packet.is_keyframe,
        )
