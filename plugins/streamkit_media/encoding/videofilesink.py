"""videofilesink: frames as H.264 to a file, pipe, network or playlist, at the intervals they came at."""

from __future__ import annotations

import math
import time
from fractions import Fraction

from av.packet import Packet
from av.stream import Stream

from streamkit import SECOND_NS, Caps, Frame, Property, StreamError
from streamkit_media.codecs import caps_rate, coded_caps
from streamkit_media.encoding.encoder import ASSUMED_RATE, RAW_CAPS, Encoder, EncoderSettings, Preset, even
from streamkit_media.recording.formats import FORMATS
from streamkit_media.recording.mediaoutput import SEGMENT_NS, MediaOutput
from streamkit_media.recording.packetwriter import TIME_BASE, PacketWriter
from streamkit_media.streams import nanoseconds, ticks

FLUSH_LIMIT_S = 1.0
KEYFRAME_INTERVAL = 250
# Hybrid fragmented MP4: indexed when closed. FFmpeg's muxer crashes on some damaged streams, so it is used
# for frames encoded here only. Without empty_moov it misreads the first fragment of a file not closed.
# A file not closed has frames that are later by those that are reordered. One that is closed needs no edit
# list, since its offsets may be negative; FFmpeg's ends a frame early where the last frame decoded is not the
# last shown, and players then leave that out.
HYBRID = {
    "movflags": "hybrid_fragmented+frag_keyframe+negative_cts_offsets+empty_moov",
    "frag_duration": "500000",
    "use_editlist": "0",
}
OWN_FORMATS = {
    suffix: item._replace(options=HYBRID) if item.is_mp4 else item for suffix, item in FORMATS.items()
}
# The encoder holds back a dozen frames; at lower rates that is more than a second.
MIN_HOLDING_RATE = 12
MIN_RATE = Fraction(1, 3600)  # for the encoder; MP4 cannot hold a frame of 7 hours


class VideoFileSink(MediaOutput):
    """Encodes frames to an H.264 file that plays while it grows, and however the process ended.

    The first frame is at 0 s, as players expect it, and the others are at their distance from it. A video to
    be matched with records needs the times of the stream: encode ! packetsink keeps them. Over UDP there is
    a keyframe each second, so that a receiver may join at any time. Odd sizes are extended by one repeated
    row or column at the lower or right edge. A name with a number or time, out-%05d.mp4, gets a file for
    each size that comes; with one file another size is an error.

    Example:
        videotestsrc num-buffers=50 ! videofilesink location=test.mp4
    """

    sink = RAW_CAPS
    formats = OWN_FORMATS
    example = "out.mp4"

    location: str = Property(
        "",
        file="write",
        doc="File to write, with a number or time, out-%05d.mp4, one for each size; missing folders are "
        "made. Or - (the standard output), udp://HOST:PORT, srt://HOST:PORT, or a playlist of segments "
        "(HLS), live.m3u8.",
    )
    max_files: int = Property(
        0, min=0, doc="Segments of a playlist kept; older ones are deleted. 0 keeps all."
    )
    crf: int = Property(23, min=0, max=51, doc="Quality: 0 loses nothing, 18 looks it, 51 is worst.")
    preset: Preset = Property(Preset.VERYFAST, doc="x264's trade of time for size.")

    _writer: PacketWriter | None = None

    def begin(self) -> None:
        """The file is opened when the size is known."""
        self._writer = None
        self._encoder: Encoder | None = None
        self._caps: Caps | None = None

    def write(self, frame: Frame) -> None:
        """Encodes one frame.

        Raises:
            StreamError: the size or format changed, which one file cannot hold.
        """
        self.check_pace(frame.pts)
        if frame.caps is not self._caps:
            self._adapt_to(frame.caps)
        assert self._encoder is not None
        pts = ticks(self._file_time_ns(frame.pts), self._encoder.time_base)
        for packet in self._encoder.encode(frame.data, pts):
            self._write_packet(packet)

    def _write_packet(self, packet: Packet[Stream]) -> None:
        assert self._writer is not None
        pts, dts = (nanoseconds(time or 0, packet.time_base) for time in (packet.pts, packet.dts))
        self._writer.write_video(bytes(packet), pts, dts, None, packet.is_keyframe)

    def _adapt_to(self, caps: Caps) -> None:
        """Begins a file with the first frame, and the next where another size or format comes."""
        pixel_format, size = str(caps["format"]), (caps.integer("width"), caps.integer("height"))
        encoder = self._encoder
        if encoder is not None and (pixel_format, size) != (encoder.pixel_format, encoder.size):
            if not self.names.is_several:
                is_other = self.is_sent or self.is_playlist
                number = "" if is_other else "give the name a number, out-%05d.mp4, or "
                raise StreamError(
                    f"{self.location}: one file holds one size and format, it began with "
                    f"{encoder.pixel_format} {encoder.size[0]} x {encoder.size[1]} and now {pixel_format} "
                    f"{size[0]} x {size[1]} comes; {number}put videoscale and a caps filter before it"
                )
            self.end()
            self._writer = None  # complete, whatever becomes of the next
        if self._encoder is None:
            self._begin_file(pixel_format, size, max(caps_rate(caps) or ASSUMED_RATE, MIN_RATE))
        self._caps = caps

    def _begin_file(self, pixel_format: str, size: tuple[int, int], rate: Fraction) -> None:
        self._offset_ns: int | None = None
        self._frame_ns = round(SECOND_NS / rate)
        self._last_ns = -self._frame_ns
        gop = KEYFRAME_INTERVAL
        if self.is_sent or self.is_playlist:
            gop = max(1, round(rate * (1 if self.is_sent else SEGMENT_NS // SECOND_NS)))
        is_live = self.is_sent or rate < MIN_HOLDING_RATE
        settings = EncoderSettings(
            quality=self.crf, gop=min(gop, KEYFRAME_INTERVAL), preset=self.preset, live=is_live
        )
        self._encoder = Encoder(settings, pixel_format, size, rate)
        output = self.open_output(count=self.max_files)
        coded = coded_caps(self._encoder.codec, even(size[0]), even(size[1]))
        self._writer = PacketWriter(output, self.container(), coded, rate=rate)

    def _file_time_ns(self, pts: int | None) -> int:
        """The frame's time in the file, ns; without one of its own that ascends, at the frame rate."""
        time_ns = following_ns = self._last_ns + self._frame_ns
        if pts is not None and self._writer is not None:
            if self._offset_ns is None or pts + self._offset_ns <= self._last_ns:
                self._offset_ns = following_ns - pts
            time_ns = pts + self._offset_ns
            self._writer.check_pause(ticks(time_ns - self._last_ns, TIME_BASE))
        self._last_ns = time_ns
        return time_ns

    def end(self) -> None:
        """Completes the file; at a stop, frames that the encoder takes too long for are left out."""
        encoder, self._encoder = self._encoder, None  # x264 holds tens of megabytes
        if self._writer is None or encoder is None:
            return
        try:
            if self._last_ns >= 0:  # a frame was encoded
                self._flush(encoder)
        finally:
            self._writer.close()

    def _flush(self, encoder: Encoder) -> None:
        deadline = time.monotonic() + (FLUSH_LIMIT_S if self.stopping.is_set() else math.inf)
        for packet in encoder.finish():
            self._write_packet(packet)
            if time.monotonic() > deadline:
                self.post_warning(
                    f"{self.location}: the last frames are left out, encoding them takes more "
                    f"than {FLUSH_LIMIT_S:g} s; a faster preset may help"
                )
                return

    def abandon(self) -> None:
        """Leaves the file as it is."""
        self._encoder = None
        if self._writer is not None:
            self._writer.abandon()
