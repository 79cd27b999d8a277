"""videofilesink: frames as H.264 to a file, pipe, network or playlist, at the intervals they came at."""

from __future__ import annotations

import math
import time
from fractions import Fraction

from streamkit import SECOND_NS, Caps, Frame, Property, StreamError
from streamkit_media.codecs import caps_rate
from streamkit_media.encoding.encoder import ASSUMED_RATE, RAW_CAPS, Encoder, EncoderSettings, Preset
from streamkit_media.recording.filemuxer import (
    FORMATS,
    FRAGMENT_TICKS,
    FRAGMENTED,
    TIME_BASE,
    FileMuxer,
    ticks,
)
from streamkit_media.recording.mediaoutput import SEGMENT_NS, MediaOutput

FLUSH_LIMIT_S = 1.0
KEYFRAME_INTERVAL = 250
# Hybrid fragmented MP4: indexed when closed. FFmpeg's muxer crashes on some damaged streams, so it is used
# for frames encoded here only. Without empty_moov it misreads the first fragment of a file not closed.
# Such a file has no edit list yet: its frames are later by the frames that are reordered.
HYBRID = {
    "movflags": "hybrid_fragmented+frag_keyframe+negative_cts_offsets+empty_moov",
    "frag_duration": "500000",
}
OWN_FORMATS = {
    suffix: (name, HYBRID if options is FRAGMENTED else options)
    for suffix, (name, options) in FORMATS.items()
}
# The encoder holds back a dozen frames; at lower rates that is more than a second.
MIN_HOLDING_RATE = 12
MIN_RATE = Fraction(1, 3600)  # for the encoder; MP4 cannot hold a frame of 7 hours


class VideoFileSink(MediaOutput):
    """Encodes frames to an H.264 file that plays while it grows, and however the process ended.

    The first frame is at 0 s, as players expect it, and the others are at their distance from it. A video to
    be matched with records needs the times of the stream: encode ! packetsink keeps them. Over UDP there is
    a keyframe each second, so that a receiver may join at any time. Odd sizes are extended by one repeated
    row or column at the lower or right edge.

    Example:
        videotestsrc num-buffers=50 ! videofilesink location=test.mp4
    """

    sink = RAW_CAPS
    formats = OWN_FORMATS
    example = "out.mp4"

    location: str = Property(
        "",
        file="write",
        doc="File to write; missing folders are made. Or - (the standard output), udp://HOST:PORT, or a "
        "playlist of segments (HLS), live.m3u8.",
    )
    max_files: int = Property(
        0, min=0, doc="Segments of a playlist kept; older ones are deleted. 0 keeps all."
    )
    crf: int = Property(23, min=0, max=51, doc="Quality: 0 loses nothing, 18 looks it, 51 is worst.")
    preset: Preset = Property(Preset.VERYFAST, doc="x264's trade of time for size.")

    _muxer: FileMuxer | None = None

    def begin(self) -> None:
        """The file is opened when the size is known."""
        self._muxer = None
        self._encoder: Encoder | None = None
        self._caps: Caps | None = None
        self._offset: int | None = None
        self._frame_ticks = self._last = 0

    def write(self, frame: Frame) -> None:
        """Encodes one frame.

        Raises:
            StreamError: the size or format changed, which one file cannot hold.
        """
        self.check_pace(frame.pts)
        if frame.caps is not self._caps:
            self._follow(frame.caps)
        assert self._encoder is not None
        assert self._muxer is not None
        for packet in self._encoder.encode(frame.data, self._place(frame.pts)):
            self._muxer.mux(packet, can_play=self._last >= 2 * FRAGMENT_TICKS)

    def _follow(self, caps: Caps) -> None:
        pixel_format, size = str(caps["format"]), (caps.integer("width"), caps.integer("height"))
        encoder = self._encoder
        if encoder is None:
            rate = max(caps_rate(caps) or ASSUMED_RATE, MIN_RATE)
            self._frame_ticks = max(1, round(1 / rate / TIME_BASE))
            self._last = -self._frame_ticks
            self._muxer = FileMuxer(self.open_output(count=self.max_files), self.container())
            gop = KEYFRAME_INTERVAL
            if self.is_sent or self.is_playlist:
                gop = max(1, round(rate * (1 if self.is_sent else SEGMENT_NS // SECOND_NS)))
            is_live = self.is_sent or rate < MIN_HOLDING_RATE
            settings = EncoderSettings(
                quality=self.crf, gop=min(gop, KEYFRAME_INTERVAL), preset=self.preset, live=is_live
            )
            self._encoder = Encoder(settings, pixel_format, size, rate, self._muxer.container, TIME_BASE)
        elif (pixel_format, size) != (encoder.pixel_format, encoder.size):
            raise StreamError(
                f"{self.location}: one file holds one size and format, it began with {encoder.pixel_format} "
                f"{encoder.size[0]} x {encoder.size[1]} and now {pixel_format} {size[0]} x {size[1]} comes; "
                "put videoscale and a caps filter before it"
            )
        self._caps = caps

    def _place(self, pts: int | None) -> int:
        """The frame's time in the file; without one of its own that ascends, at the frame rate."""
        place = following = self._last + self._frame_ticks
        if pts is not None and self._muxer is not None:
            own = ticks(pts)
            if self._offset is None or own + self._offset <= self._last:
                self._offset = following - own
            place = own + self._offset
            self._muxer.check_pause(place - self._last)
        self._last = place
        return place

    def end(self) -> None:
        """Completes the file; at a stop, frames that the encoder takes too long for are left out."""
        if self._muxer is None or self._encoder is None:
            return
        deadline = time.monotonic() + (FLUSH_LIMIT_S if self.stopping.is_set() else math.inf)
        has_content = self._last >= 0
        try:
            for packet in self._encoder.finish() if has_content else ():
                self._muxer.mux(packet, can_play=False)
                if time.monotonic() > deadline:
                    self.post_warning(
                        f"{self.location}: the last frames are left out, encoding them takes more "
                        f"than {FLUSH_LIMIT_S:g} s; a faster preset may help"
                    )
                    break
        finally:
            self._muxer.finish(is_kept=has_content)

    def abandon(self) -> None:
        """Leaves the file as it is."""
        if self._muxer is not None:
            self._muxer.abandon()
