"""videofilesink: frames to an H.264 file."""

from __future__ import annotations

from streamkit import Caps, Frame, OutputFileSink, Property, StreamError
from streamkit_media.codecs import caps_rate
from streamkit_media.container import MEDIA_ERRORS
from streamkit_media.encoding.encoder import ASSUMED_RATE, RAW_CAPS, EncoderSettings, Preset
from streamkit_media.encoding.videowriter import VideoWriter
from streamkit_media.recording.filemuxer import FORMATS

FLUSH_LIMIT_S = 1.0
KEYFRAME_INTERVAL = 250


class VideoFileSink(OutputFileSink):
    """Encodes frames to an H.264 file that plays while it grows, and however the process ended.

    Odd sizes are extended by one repeated row or column at the lower or right edge.

    Example:
        videotestsrc num-buffers=50 ! videofilesink location=test.mp4
    """

    sink = RAW_CAPS
    suffixes = tuple(FORMATS)
    example = "out.mp4"
    write_errors = (*MEDIA_ERRORS, OSError)

    crf: int = Property(23, min=0, max=51, doc="Quality: 0 loses nothing, 18 looks it, 51 is worst.")
    preset: Preset = Property(Preset.VERYFAST, doc="x264's trade of time for size.")

    _writer: VideoWriter | None = None

    def begin(self) -> None:
        """The file is opened when the size is known."""
        self._writer = None
        self._caps: Caps | None = None

    def write(self, frame: Frame) -> None:
        """Encodes one frame.

        Raises:
            StreamError: the size or format changed, which one file cannot hold.
        """
        if frame.caps is not self._caps:
            self._follow(frame.caps)
        assert self._writer is not None
        self._writer.write(frame.data, frame.pts)

    def _follow(self, caps: Caps) -> None:
        shape = (str(caps["format"]), caps.integer("width"), caps.integer("height"))
        writer = self._writer
        if writer is None:
            rate = caps_rate(caps) or ASSUMED_RATE
            settings = EncoderSettings(quality=self.crf, gop=KEYFRAME_INTERVAL, preset=self.preset)
            self._writer = VideoWriter(self.open_file(), *shape, rate, settings)
        elif shape != (writer.pixel_format, writer.width, writer.height):
            before = f"{writer.pixel_format} {writer.width} x {writer.height}"
            raise StreamError(
                f"{self.location}: one file holds one size and format, it began with {before} and now "
                f"{shape[0]} {shape[1]} x {shape[2]} comes; put videoscale and a caps filter before it"
            )
        self._caps = caps

    def end(self) -> None:
        """Completes the file; at a stop, frames that the encoder takes too long for are left out."""
        limit_s = FLUSH_LIMIT_S if self.stopping.is_set() else None
        if self._writer is not None and not self._writer.close(limit_s):
            self.post_warning(
                f"{self.location}: the last frames are left out, encoding them takes more "
                f"than {limit_s:g} s; a faster preset may help"
            )

    def abandon(self) -> None:
        """Leaves the file as it is."""
        if self._writer is not None:
            self._writer.abandon()
