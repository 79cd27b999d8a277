"""rtspsrc: live video from a camera, drone or server."""

from __future__ import annotations

import enum

from typing_extensions import override

from streamkit import Caps, Direction, PadTemplate, Presence, Property, ResourceError
from streamkit_media.failures import TimedOut, UnsupportedTransport
from streamkit_media.live.livesource import VIDEO_PAD, LiveSource
from streamkit_media.rtsp.rtspinput import RtspInput
from streamkit_media.streams import KLV_CAPS

UDP_SHARE = 0.5  # of the time limit, where tcp can follow
WAIT_SHARE = 0.5  # of the time limit: a wait for a packet out of order is not to be taken for silence


SourceTransport = enum.StrEnum("SourceTransport", "TCP UDP AUTO")


class RtspSrc(LiveSource):
    """Receives the video of an RTSP server as coded packets; connects again when the server goes away.

    Each connection is an epoch of its own; times ascend over all of them. Live never lags: for a consumer
    that is too slow, older packets are decoded but not shown, or dropped up to a keyframe, and counted.
    Every change of the connection is an element message `connection` with `state` (connecting, connected,
    stalled, retrying, gave-up), `attempt`, `delay_s` and `reason`.

    Example:
        rtspsrc location=rtsp://drone/live ! decode ! fakesink
    """

    templates = (VIDEO_PAD, PadTemplate("klv", Direction.SRC, Caps(KLV_CAPS), Presence.SOMETIMES))

    transport: SourceTransport = Property(
        SourceTransport.TCP,
        doc="What carries the video: tcp loses nothing, udp waits for nothing; auto is udp, or tcp where no "
        "video has come within half of timeout-s.",
    )

    def start(self) -> None:
        """Checks the location; the connection is made by the source's thread."""
        self._carrier = SourceTransport.UDP if self.transport is SourceTransport.AUTO else self.transport
        super().start()

    @property
    @override
    def carrier(self) -> str:
        return self._carrier.value

    @override
    def make_input(self) -> RtspInput:
        may_fall_back = self.transport is SourceTransport.AUTO and self._carrier is SourceTransport.UDP
        limit_s = self.timeout_s * UDP_SHARE if may_fall_back else self.timeout_s
        options = {
            **self._tls_options,
            "rtsp_transport": self._carrier.value,
            "timeout": str(round(limit_s * 1e6)),
            "max_delay": str(min(self.latency_ms * 1000, round(limit_s * WAIT_SHARE * 1e6))),
            "allowed_media_types": "video+data",
        }
        return RtspInput(self._url, options, limit_s, low_latency=self.low_latency)

    @override
    def explain_silence(self, failure: ResourceError) -> ResourceError | None:
        is_refused = isinstance(failure, UnsupportedTransport)
        may_help = self._carrier is SourceTransport.UDP and (is_refused or isinstance(failure, TimedOut))
        if self.transport is SourceTransport.AUTO and may_help:
            self._carrier = SourceTransport.TCP
            self.post_warning(f"{self._where}: nothing came over UDP; continuing over TCP")
            return None
        if self.transport is SourceTransport.AUTO and self._epoch < 0:
            self._carrier = SourceTransport.UDP  # neither has worked: the next try begins with UDP again
        elif may_help:
            return type(failure)(f"{failure}; if it does over TCP, set transport=tcp or transport=auto")
        elif is_refused and self.transport is SourceTransport.TCP:
            return type(failure)(f"{failure}; if it does over UDP, set transport=udp or transport=auto")
        return failure
