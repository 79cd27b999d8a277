"""Frames to coded packets with FFmpeg's encoders."""

from __future__ import annotations

import enum
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from av.codec.context import CodecContext
from av.packet import Packet
from av.stream import Stream
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter

from streamkit.settings import setting
from streamkit_media.decoding.frame_arrays import PACKED, Pixels

NEUTRAL_CHROMA = 128
ASSUMED_RATE = Fraction(25)  # frames/s, for the rate control, where the caps have none
TIME_BASE = Fraction(1, 1_000_000)
COARSE_TIME_BASE = Fraction(1, 50_000)  # MPEG-4 Part 2 holds the denominator in 16 bits
VP8_MAX_BIT_RATE = 1_000_000_000  # libvpx needs one for VP8 also at constant quality
# Formats whose frames all have even width and height, and formats that are extended where they are odd.
RAW_CAPS = (
    "video/x-raw, format=I420, width=[ 2, 16384, 2 ], height=[ 2, 16384, 2 ]; "
    "video/x-raw, format=NV12, width=[ 2, 16384, 2 ], height=[ 2, 16384, 2 ]; "
    "video/x-raw, format={ BGR, RGB, GRAY8 }, width=[ 1, 16384 ], height=[ 1, 16384 ]"
)


Codec = enum.StrEnum("Codec", "H264 H265 AV1 VP8 VP9 MPEG4 MJPEG FFV1")
# The presets of x264 and x265.
Preset = enum.StrEnum("Preset", "ULTRAFAST SUPERFAST VERYFAST FASTER FAST MEDIUM SLOW SLOWER VERYSLOW")
# FFmpeg's encoder, and its name of the codec.
ENCODERS = {
    Codec.H264: ("libx264", "h264"),
    Codec.H265: ("libx265", "hevc"),
    Codec.AV1: ("libsvtav1", "av1"),
    Codec.VP8: ("libvpx", "vp8"),
    Codec.VP9: ("libvpx-vp9", "vp9"),
    Codec.MPEG4: ("mpeg4", "mpeg4"),
    Codec.MJPEG: ("mjpeg", "mjpeg"),
    Codec.FFV1: ("ffv1", "ffv1"),
}


@dataclass(frozen=True)
class EncoderSettings:
    """How to encode; each field is a property of `encode`."""

    codec: Codec = setting(Codec.H264, doc="What to encode to.")
    bitrate: int = setting(0, min=0, max=1_000_000, unit="kbit/s", doc="0 is constant quality instead.")
    quality: int = setting(23, min=0, max=51, doc="Without bitrate: 0 best, 51 worst, as x264 counts.")
    gop: int = setting(50, min=1, max=10_000, unit="frames", doc="From keyframe to keyframe.")
    preset: Preset = setting(Preset.VERYFAST, doc="Trade of time for size, for h264 and h265.")
    live: bool = setting(False, doc="Hold no frame back; costs some quality.")


class Encoder:
    """Encodes frames of one format and size; odd sizes are extended at the lower or right edge.

    Args:
        settings: how to encode.
        pixel_format: of the arrays: GRAY8, I420, NV12, BGR or RGB.
        size: width, height, px.
        framerate: frames per second, for the rate control.

    Attributes:
        codec: FFmpeg's name of the codec.
        time_base: of the packets.

    Raises:
        UnknownCodecError: this FFmpeg lacks the encoder.
        FFmpegError: it does not take the settings.
    """

    def __init__(
        self, settings: EncoderSettings, pixel_format: str, size: tuple[int, int], framerate: Fraction
    ) -> None:
        name, self.codec = ENCODERS[settings.codec]
        self.pixel_format, self.size = pixel_format, size
        context = CodecContext.create(name, "w")
        assert isinstance(context, VideoCodecContext)
        self._context = context
        self._reformatter = VideoReformatter()
        context.width, context.height = even(size[0]), even(size[1])
        context.pix_fmt = "yuvj420p" if settings.codec is Codec.MJPEG else "yuv420p"
        self.time_base = COARSE_TIME_BASE if settings.codec is Codec.MPEG4 else TIME_BASE
        context.time_base, context.framerate = self.time_base, framerate
        context.gop_size = settings.gop
        context.bit_rate = settings.bitrate * 1000 or (VP8_MAX_BIT_RATE if settings.codec is Codec.VP8 else 0)
        if settings.live:
            context.max_b_frames = 0
        context.options = _options(settings)
        if settings.codec is Codec.AV1:
            os.environ.setdefault("SVT_LOG", "1")  # errors only; FFmpeg has no option for it
        with _usual_scheduling():
            context.open()

    @property
    def extradata(self) -> bytes:
        """Codec headers outside the packets; b"" where the packets hold them."""
        return self._context.extradata or b""

    def encode(self, pixels: Pixels, ticks: int) -> list[Packet[Stream]]:
        """The packets that are complete with this frame.

        Args:
            pixels: uint8 array in the encoder's format and size.
            ticks: presentation time in units of `time_base`; must ascend.

        Raises:
            ValueError: the array is of another shape or type; FFmpeg would stretch it unseen.
            FFmpegError: encoding failed.
        """
        expected = f"uint8{list(shape_of(self.pixel_format, *self.size))}"
        is_array = isinstance(pixels, np.ndarray)  # whatever an application or fakesrc puts under the caps
        found = f"{pixels.dtype}{list(pixels.shape)}" if is_array else type(pixels).__name__
        if found != expected:
            raise ValueError(
                f"{self.pixel_format} of {self.size[0]} x {self.size[1]} must be {expected}, got {found}; "
                "give the frame caps of what it holds"
            )
        frame = video_frame(pixels, self.pixel_format, str(self._context.pix_fmt))
        if frame.format.name != self._context.pix_fmt:
            frame = self._reformatter.reformat(frame, format=self._context.pix_fmt)
        frame.pts, frame.time_base = ticks, self.time_base
        return [self._timed(packet) for packet in self._context.encode(frame)]

    def finish(self) -> Iterator[Packet[Stream]]:
        """The packets still held, each when it is asked for; nothing may be encoded after it."""
        return map(self._timed, self._context.encode_lazy(None))

    def _timed(self, packet: Packet[Stream]) -> Packet[Stream]:
        packet.time_base = self.time_base
        return packet


@contextmanager
def _usual_scheduling() -> Iterator[None]:
    """Undoes what SVT-AV1 does as root: it gives its threads, and that of its caller, real-time priority.

    They would starve every other process of the machine.
    """
    if sys.platform != "linux":
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    earlier = set(os.listdir("/proc/self/task")) - {str(threading.get_native_id())}
    try:
        yield
    finally:
        for thread in set(os.listdir("/proc/self/task")) - earlier:
            with suppress(ProcessLookupError):
                os.sched_setscheduler(int(thread), policy, parameters)


def _options(settings: EncoderSettings) -> dict[str, str]:
    options = {} if settings.bitrate else _constant_quality(settings.codec, settings.quality)
    if settings.codec in (Codec.H264, Codec.H265):
        options["preset"] = settings.preset.value
        if settings.live:
            options["tune"] = "zerolatency"
    if settings.codec is Codec.H265:
        options["x265-params"] = "log-level=error"
    if settings.codec is Codec.FFV1:
        options["level"] = "1"  # later versions have headers outside the packets, which PyAV gives no muxer
    return options


def _constant_quality(codec: Codec, quality: int) -> dict[str, str]:
    """FFmpeg's options for a quality of 0 to 51 on x264's scale.

    Source: ITU-T H.264, table 8-15: the quantiser step is 0.625 * 2^(QP / 6); in MPEG-4 Part 2 it is 2 QP.
    """
    level = str(round(quality * 63 / 51))
    if codec in (Codec.H264, Codec.H265):
        return {"crf": str(quality)}
    if codec in (Codec.MPEG4, Codec.MJPEG):
        quantiser = str(min(max(round(0.3125 * 2 ** (quality / 6)), 1), 31))
        return {"qmin": quantiser, "qmax": quantiser}
    if codec is Codec.VP8:
        return {"crf": level, "qmin": level}
    return {"crf": level} if codec in (Codec.AV1, Codec.VP9) else {}


def shape_of(pixel_format: str, width: int, height: int) -> tuple[int, ...]:
    """The shape of an array of one frame in a format; width and height in px."""
    if pixel_format in PACKED:
        return height, width, 3
    return (height, width) if pixel_format == "GRAY8" else (height * 3 // 2, width)


def even(size: int) -> int:
    """The size, or one more where it is odd."""
    return size + size % 2


def pad_to_even(pixels: Pixels) -> Pixels:
    """uint8[h, w, ...] with its last row and column repeated where the height or width is odd."""
    rows, columns = pixels.shape[0] % 2, pixels.shape[1] % 2
    if not rows and not columns:
        return pixels
    return np.pad(pixels, [(0, rows), (0, columns)] + [(0, 0)] * (pixels.ndim - 2), mode="edge")


def grey_as_i420(luma: Pixels) -> Pixels:
    """uint8[h * 3 // 2, w]: the luma with neutral chroma; a converter would change its range."""
    return np.pad(luma, [(0, len(luma) // 2), (0, 0)], constant_values=NEUTRAL_CHROMA)


def video_frame(pixels: Pixels, pixel_format: str, planar: str = "yuv420p") -> VideoFrame:
    """Converts an array to FFmpeg's frame of even size; GRAY8 becomes the luma of a `planar` format."""
    if pixel_format == "GRAY8":
        pixels, name = grey_as_i420(pad_to_even(pixels)), planar
    elif pixel_format in PACKED:
        pixels, name = pad_to_even(pixels), PACKED[pixel_format]
    else:
        name = "nv12" if pixel_format == "NV12" else "yuv420p"
    return VideoFrame.from_ndarray(np.ascontiguousarray(pixels), name)
