"""Pictures to coded packets."""

from __future__ import annotations

from fractions import Fraction

from av.codec.context import CodecContext
from av.packet import Packet
from av.stream import Stream
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame

from streamkit_media.encoding.videowriter import Pixels, even, picture_of

TIME_BASE = Fraction(1, 1_000_000)
COARSE_TIME_BASE = Fraction(1, 50_000)  # MPEG-4 Part 2 counts in 16 bits
SECOND_NS = 1_000_000_000
# The name users write, to FFmpeg's encoder and the name of what it makes.
ENCODERS = {
    "h264": ("libx264", "h264"),
    "h265": ("libx265", "hevc"),
    "av1": ("libsvtav1", "av1"),
    "vp8": ("libvpx", "vp8"),
    "vp9": ("libvpx-vp9", "vp9"),
    "mpeg4": ("mpeg4", "mpeg4"),
    "mjpeg": ("mjpeg", "mjpeg"),
    "ffv1": ("ffv1", "ffv1"),
}
WITH_PRESET = frozenset({"h264", "h265"})


class Encoder:
    """Encodes pictures of one format and size; packets can be decoded with nothing but themselves.

    Args:
        codec: a key of `ENCODERS`.
        pixel_format: of the arrays: GRAY8, I420, NV12, BGR or RGB.
        size: width, height, px; an odd one is extended by one repeated row or column.
        framerate: frames per second, for the rate control.
        bit_rate: bit/s; 0 asks for constant quality.
        quality: constant quality, 0 best to 51 worst, for h264 and h265.
        gop: pictures from key frame to key frame.
        preset: of x264 and x265.
        is_live: no picture is held back.

    Raises:
        UnknownCodecError: this FFmpeg lacks the encoder.
        FFmpegError: it does not take the settings.
    """

    def __init__(
        self,
        codec: str,
        pixel_format: str,
        size: tuple[int, int],
        framerate: Fraction,
        bit_rate: int,
        quality: int,
        gop: int,
        preset: str,
        is_live: bool,
    ) -> None:
        encoder, self.codec = ENCODERS[codec]
        context = CodecContext.create(encoder, "w")
        assert isinstance(context, VideoCodecContext)
        self._context, self.pixel_format, self.size = context, pixel_format, size
        context.width, context.height = even(size[0]), even(size[1])
        context.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        self.time_base = COARSE_TIME_BASE if codec == "mpeg4" else TIME_BASE
        context.time_base, context.framerate = self.time_base, framerate
        context.gop_size = gop
        if bit_rate:
            context.bit_rate = bit_rate
        context.options = _options(codec, bit_rate, quality, preset, is_live)
        if is_live:
            context.max_b_frames = 0
        context.open()
        self._last = -1

    @property
    def extradata(self) -> bytes:
        """Headers outside the packets; b"" where these hold all."""
        return self._context.extradata or b""

    def encode(self, pixels: Pixels, pts: int) -> list[Packet[Stream]]:
        """The packets that are complete with this picture, times in units of `time_base`.

        Args:
            pixels: uint8 array in the encoder's format and size.
            pts: ns; must ascend.

        Raises:
            FFmpegError: encoding failed.
        """
        picture: VideoFrame = picture_of(pixels, self.pixel_format)
        if self._context.pix_fmt != picture.format.name:
            picture = picture.reformat(format=self._context.pix_fmt)
        self._last = max(self._last + 1, self.ticks(pts))
        picture.pts, picture.time_base = self._last, self.time_base
        return list(self._context.encode(picture))

    def ticks(self, pts: int) -> int:
        """A time in ns in units of `time_base`."""
        return round(pts * self.time_base.denominator / SECOND_NS)

    def finish(self) -> list[Packet[Stream]]:
        """The packets still held; nothing may be encoded after it."""
        return list(self._context.encode(None))


def _options(codec: str, bit_rate: int, quality: int, preset: str, is_live: bool) -> dict[str, str]:
    options = {}
    if codec in WITH_PRESET:
        options["preset"] = preset
        if not bit_rate:
            options["crf"] = str(quality)
        if is_live:
            options["tune"] = "zerolatency"
    if codec == "h265":
        options["x265-params"] = "log-level=error"
    return options
