"""encode: frames to coded packets."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable

from av.codec.codec import UnknownCodecError
from av.packet import Packet
from av.stream import Stream

from streamkit import SECOND_NS, Caps, Frame, FrameFlags, SettingsOf, StreamError, Transform
from streamkit_media.codecs import MEDIA_TYPES, caps_rate, coded_caps
from streamkit_media.encoding.encoder import ASSUMED_RATE, ENCODERS, RAW_CAPS, Encoder, EncoderSettings, even
from streamkit_media.failures import MEDIA_ERRORS, reason_of
from streamkit_media.streams import ticks

HELD_LIMIT = 512
MAX_REORDERED = 16  # frames between two that are shown in the order of their packets, as in H.264
UNFINISHED = "held by the encoder at the stop"


class Encode(Transform):
    """Encodes frames; odd sizes are extended by one repeated row or column at the lower or right edge.

    Packets leave when all frames shown before them are encoded, too, so that a recording that is stopped has
    no hole. A stop without EOS drops, and counts, the frames that the encoder holds: a dozen, with
    `live=true` none. Frames without times get them by the frame rate of their caps, else at 25/s.

    Example:
        videotestsrc num-buffers=50 ! encode ! packetsink location=test.ts
    """

    sink = RAW_CAPS
    src = "; ".join(MEDIA_TYPES[name][0] for _, name in ENCODERS.values() if name in MEDIA_TYPES) + (
        "; video/x-coded"
    )

    settings = SettingsOf(EncoderSettings)

    def start(self) -> None:
        """Begins without an encoder: the first frame has the size."""
        self._encoder: Encoder | None = None
        self._raw_caps: Caps | None = None
        self._coded_caps: Caps | None = None
        self._held: OrderedDict[int, Frame] = OrderedDict()  # by ticks; their packets are still to come
        self._waiting: list[Frame] = []  # packets that come before those of frames shown earlier
        self._highest = -1
        self._epoch = 0
        self._last_ticks = -1
        self._frame_ns = self._next_ns = 0

    def fixate(self, sink_caps: Caps, allowed: Caps) -> Caps | None:
        """Caps are those of the first packet."""
        return None

    def transform(self, frame: Frame) -> Iterable[Frame]:
        """The packets complete with this frame; a new size, format or epoch begins with a keyframe."""
        packets: list[Frame] = []
        try:
            if frame.caps is not self._raw_caps or frame.epoch != self._epoch:
                packets = self._finish()
                self._begin(frame)
            assert self._encoder is not None
            if frame.pts is None:
                frame = frame.replace(pts=self._next_ns, duration=frame.duration or self._frame_ns)
            pts, last_ns = frame.pts or 0, self._next_ns - self._frame_ns
            if self._last_ticks >= 0 and pts <= last_ns:
                self.warn_once(
                    f"times do not ascend: a frame at {pts / SECOND_NS:.3f} s follows one at "
                    f"{last_ns / SECOND_NS:.3f} s, and a recording has it out of place; give each frame a "
                    "later pts, or None for that of the frame rate",
                    "times",
                )
            self._next_ns = pts + self._frame_ns
            time = self._last_ticks = max(self._last_ticks + 1, ticks(pts, self._encoder.time_base))
            coded = self._encoder.encode(frame.data, time)
        except UnknownCodecError:
            raise StreamError(
                f"this FFmpeg has no encoder for {self.settings.codec}; choose another codec="
            ) from None
        except MEDIA_ERRORS as error:
            size = f"{frame.caps.integer('width')} x {frame.caps.integer('height')} px"
            raise StreamError(
                f"{self.settings.codec} could not encode frames of {size}: {reason_of(error)}; "
                "another codec= or size may do"
            ) from error
        self._held[time] = frame.replace(data=None)
        if len(self._held) > HELD_LIMIT:
            self._held.popitem(last=False)
        for packet in coded:
            self._waiting.append(self._frame(packet, frame))
            self._highest = max(self._highest, packet.pts or 0)
            if next(iter(self._held), time + 1) > self._highest or len(self._waiting) > MAX_REORDERED:
                packets += self._waiting
                self._waiting.clear()
        return packets

    def drain(self) -> Iterable[Frame]:
        """The packets still in the encoder."""
        return self._finish()

    def stop(self) -> None:
        """Frees the encoder, and counts what it holds."""
        self._encoder = None
        self.count_drop(UNFINISHED, len(self._held) + len(self._waiting))

    def _begin(self, frame: Frame) -> None:
        caps = frame.caps
        size = caps.integer("width"), caps.integer("height")
        rate = caps_rate(caps)
        self._encoder = Encoder(self.settings, str(caps["format"]), size, rate or ASSUMED_RATE)
        self._frame_ns = round(SECOND_NS / (rate or ASSUMED_RATE))
        self._raw_caps, self._epoch, self._last_ticks, self._highest = caps, frame.epoch, -1, -1
        self._coded_caps = coded_caps(
            self._encoder.codec, even(size[0]), even(size[1]), self._encoder.extradata, rate
        )

    def _finish(self) -> list[Frame]:
        encoder, self._encoder = self._encoder, None
        if encoder is None:
            return []
        packets, self._waiting = self._waiting, []
        if last := next(reversed(self._held.values()), None):
            packets += [self._frame(packet, last) for packet in encoder.finish()]
        self._held.clear()
        return packets

    def _frame(self, packet: Packet[Stream], fallback: Frame) -> Frame:
        """The packet with the times, metadata and number of its frame."""
        origin = self._held.pop(packet.pts, fallback) if packet.pts is not None else fallback
        flags = origin.flags & ~FrameFlags.KEYFRAME
        flags |= FrameFlags.KEYFRAME if packet.is_keyframe else FrameFlags.NONE
        return origin.replace(data=packet, caps=self._coded_caps, flags=flags)
