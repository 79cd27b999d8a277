"""encode: pictures to coded packets."""

from __future__ import annotations

import enum
from collections import OrderedDict
from collections.abc import Iterable
from fractions import Fraction

from av.codec.codec import UnknownCodecError
from av.packet import Packet
from av.stream import Stream

from streamkit import Caps, Frame, FrameFlags, Property, StreamError, Transform
from streamkit_media.codecs import MEDIA_TYPES, CodecParameters, caps_rate, coded_caps
from streamkit_media.container import MEDIA_ERRORS, reason_of
from streamkit_media.encoding.encoder import ENCODERS, Encoder
from streamkit_media.encoding.videofilesink import Preset

ASSUMED_RATE = Fraction(25)
HELD_LIMIT = 512


class Codec(enum.StrEnum):
    """What to encode to."""

    H264 = "h264"
    H265 = "h265"
    AV1 = "av1"
    VP8 = "vp8"
    VP9 = "vp9"
    MPEG4 = "mpeg4"
    MJPEG = "mjpeg"
    FFV1 = "ffv1"


class Encode(Transform):
    """Encodes pictures; odd sizes are extended by one repeated row or column at the lower or right edge.

    Example:
        videotestsrc num-buffers=50 ! encode ! packetsink location=test.ts
    """

    sink = (
        "video/x-raw, format=I420, width=[ 2, 16384, 2 ], height=[ 2, 16384, 2 ]; "
        "video/x-raw, format=NV12, width=[ 2, 16384, 2 ], height=[ 2, 16384, 2 ]; "
        "video/x-raw, format={ BGR, RGB, GRAY8 }, width=[ 1, 16384 ], height=[ 1, 16384 ]"
    )
    src = "; ".join(MEDIA_TYPES[name][0] for _, name in ENCODERS.values() if name in MEDIA_TYPES) + (
        "; video/x-coded"
    )

    codec: Codec = Property(Codec.H264, doc="What to encode to.")
    bitrate: int = Property(0, min=0, max=1_000_000, unit="kbit/s", doc="0 is constant quality instead.")
    quality: int = Property(23, min=0, max=51, doc="Without bitrate, for h264 and h265: 0 best, 51 worst.")
    gop: int = Property(50, min=1, max=10_000, unit="frames", doc="From key frame to key frame.")
    preset: Preset = Property(Preset.VERYFAST, doc="Trade of time for size, for h264 and h265.")
    live: bool = Property(False, doc="Hold no picture back; costs some quality.")

    def start(self) -> None:
        """Begins without an encoder: the first picture tells the size."""
        self._encoder: Encoder | None = None
        self._raw_caps: Caps | None = None
        self._coded_caps: Caps | None = None
        self._held: OrderedDict[int, Frame] = OrderedDict()
        self._epoch = 0

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
        """The first packet tells."""
        return None

    def transform(self, frame: Frame) -> Iterable[Frame]:
        """The packets complete with this picture; a new size, format or epoch begins with a key frame."""
        packets: list[Frame] = []
        try:
            if frame.caps is not self._raw_caps or frame.epoch != self._epoch:
                packets = self._finish()
                self._begin(frame)
            assert self._encoder is not None
            pts = frame.pts or 0
            coded = self._encoder.encode(frame.data, pts)
        except UnknownCodecError:
            raise StreamError(f"this FFmpeg has no encoder for {self.codec}; choose another codec=") from None
        except MEDIA_ERRORS as error:
            raise StreamError(f"{self.codec} could not be encoded: {reason_of(error)}") from error
        self._held[self._encoder.ticks(pts)] = frame.replace(data=None)
        if len(self._held) > HELD_LIMIT:
            self._held.popitem(last=False)
        return packets + [self._frame(packet, frame) for packet in coded]

    def drain(self) -> Iterable[Frame]:
        """The packets still in the encoder."""
        return self._finish()

    def stop(self) -> None:
        """Lets go of the encoder."""
        self._encoder = None

    def _begin(self, frame: Frame) -> None:
        caps = frame.caps
        size = caps.integer("width"), caps.integer("height")
        rate = caps_rate(caps)
        self._encoder = Encoder(
            self.codec.value,
            str(caps["format"]),
            size,
            rate or ASSUMED_RATE,
            self.bitrate * 1000,
            self.quality,
            self.gop,
            self.preset.value,
            self.live,
        )
        self._raw_caps, self._epoch, self._time_base = caps, frame.epoch, self._encoder.time_base
        even_size = (size[0] + size[0] % 2, size[1] + size[1] % 2)
        parameters = CodecParameters(self._encoder.codec, *even_size, self._encoder.extradata)
        self._coded_caps = coded_caps(parameters, rate)
        self._held.clear()

    def _finish(self) -> list[Frame]:
        encoder, self._encoder = self._encoder, None
        if encoder is None:
            return []
        last = next(reversed(self._held.values()), None)
        return [] if last is None else [self._frame(packet, last) for packet in encoder.finish()]

    def _frame(self, packet: Packet[Stream], fallback: Frame) -> Frame:
        """The packet with the times, metadata and number of its picture."""
        packet.time_base = self._time_base
        origin = self._held.pop(packet.pts, fallback) if packet.pts is not None else fallback
        flags = origin.flags & ~FrameFlags.KEYFRAME
        flags |= FrameFlags.KEYFRAME if packet.is_keyframe else FrameFlags.NONE
        return origin.replace(data=packet, caps=self._coded_caps, flags=flags)
