"""videofilesink: frames to an H.264 file."""

from __future__ import annotations

import threading
from fractions import Fraction

from streamkit import Caps, Frame, Property, ResourceError, Sink, StreamError, write_remedy
from streamkit_media.codecs import caps_rate
from streamkit_media.container import MEDIA_ERRORS, reason_of
from streamkit_media.encoding.encoder import RAW_CAPS, EncoderSettings, Preset
from streamkit_media.encoding.videowriter import VideoWriter
from streamkit_media.location import local_path

ASSUMED_RATE = Fraction(25)
NO_CONTAINER = "Could not determine output format"
CLOSE_LIMIT_S = 2.0
FLUSH_LIMIT_S = 1.0
KEYFRAME_INTERVAL = 250


class VideoFileSink(Sink):
    """Encodes frames to an H.264 file that plays, also when the pipeline was interrupted.

    Odd sizes are extended by one repeated row or column at the lower or right edge.

    Example:
        videotestsrc num-buffers=50 ! videofilesink location=test.mp4
    """

    sink = RAW_CAPS

    location: str = Property("", doc="Path of the file, .mp4 or .mkv; an existing one is replaced.")
    crf: int = Property(23, min=0, max=51, doc="Quality: 0 loses nothing, 18 looks it, 51 is worst.")
    preset: Preset = Property(Preset.VERYFAST, doc="x264's trade of time for size.")

    def start(self) -> None:
        """Checks that the file can be written; it is made when the size is known."""
        self._writer: VideoWriter | None = None
        self._has_begun = False
        self._writing = threading.Lock()
        self._caps: Caps | None = None
        if not self.location:
            raise ResourceError("location= must name the file to write, it is empty; write location=out.mp4")
        self._path = local_path(self.location)
        try:
            self._path.open("wb").close()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ResourceError(
                f"{self.location}: cannot be written: {reason}; check that the directory exists and allows it"
            ) from None

    def render(self, frame: Frame) -> None:
        """Encodes one frame.

        Raises:
            StreamError: the size or format changed, which one file cannot hold.
            ResourceError: encoding or writing failed.
        """
        try:
            with self._writing:
                if frame.caps is not self._caps:
                    self._follow(frame.caps)
                assert self._writer is not None
                self._writer.write(frame.data, frame.pts)
        except MEDIA_ERRORS as error:
            raise self._failure(error) from error

    def drain(self) -> None:
        """EOS: the file is completed."""
        if not self._has_begun:
            self.post_warning(f"{self.location}: no frame came, the file is empty")
        self._close()

    def stop(self) -> None:
        """Completes the file if EOS did not; frames that the encoder takes too long for are left out."""
        self._close(FLUSH_LIMIT_S)

    def _follow(self, caps: Caps) -> None:
        shape = (str(caps["format"]), caps.integer("width"), caps.integer("height"))
        writer = self._writer
        self._has_begun = True
        if writer is None:
            rate = caps_rate(caps) or ASSUMED_RATE
            settings = EncoderSettings(quality=self.crf, gop=KEYFRAME_INTERVAL, preset=self.preset)
            self._writer = VideoWriter(self._path, *shape, rate, settings)
        elif shape != (writer.pixel_format, writer.width, writer.height):
            before = f"{writer.pixel_format} {writer.width} x {writer.height}"
            raise StreamError(
                f"{self.location}: one file holds one size and format, it began with {before} and now "
                f"{shape[0]} {shape[1]} x {shape[2]} comes; put videoscale and a caps filter before it"
            )
        self._caps = caps

    def _close(self, limit_s: float | None = None) -> None:
        # An encoder that two threads use hangs: where one is still at work the file cannot be completed.
        if not self._writing.acquire(timeout=CLOSE_LIMIT_S):
            raise ResourceError(
                f"{self.location}: the encoder has not come back within {CLOSE_LIMIT_S:g} s, the file is not "
                "complete; a faster preset may help"
            )
        try:
            writer, self._writer = self._writer, None
            self._caps = None
            if writer is not None and not writer.close(limit_s):
                self.post_warning(
                    f"{self.location}: the last frames are left out, encoding them takes more "
                    f"than {limit_s:g} s; a faster preset may help"
                )
        except MEDIA_ERRORS as error:
            raise self._failure(error) from error
        finally:
            self._writing.release()

    def _failure(self, error: Exception) -> ResourceError:
        reason = reason_of(error)
        remedy = "; let the name end in .mp4 or .mkv" if NO_CONTAINER in reason else write_remedy(error)
        return ResourceError(f"{self.location}: the video could not be written: {reason}{remedy}")
