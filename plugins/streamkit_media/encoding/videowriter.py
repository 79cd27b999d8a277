"""Pictures to an H.264 file that plays everywhere, with each picture at its own time."""

from __future__ import annotations

import time
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.container import OutputContainer
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
TIME_BASE = Fraction(1, 90_000)
NS = Fraction(1, 1_000_000_000)
NEUTRAL_CHROMA = 128
PACKED = {"BGR": "bgr24", "RGB": "rgb24"}


class VideoWriter:
    """Writes one MP4 (or any container the file's name asks for) with H.264 video in yuv420p.

    H.264 in this form needs even sizes: an odd picture is extended at its right or lower edge by repeating
    the last column or row, so that pixel coordinates stay.

    Args:
        path: file to write.
        pixel_format: of the arrays: GRAY8, I420, NV12, BGR or RGB.
        width: px.
        height: px.
        framerate: frames per second; paces pictures without a time, and the encoder's rate control.
        crf: constant quality, 0 (lossless) to 51.
        preset: of x264, ultrafast to veryslow.

    Raises:
        FFmpegError: the file cannot be written.
        ValueError: the name tells no container.
    """

    def __init__(
        self,
        path: Path,
        pixel_format: str,
        width: int,
        height: int,
        framerate: Fraction,
        crf: int,
        preset: str,
    ) -> None:
        self.pixel_format, self.width, self.height = pixel_format, width, height
        self._shape = shape_of(pixel_format, width, height)
        self._frame_ticks = max(1, round(1 / framerate / TIME_BASE))
        self._reformatter = VideoReformatter()
        self._offset: int | None = None
        self._last = -self._frame_ticks
        self._failure: Exception | None = None
        self._container: OutputContainer | None = av.open(
            f"file:{path}", "w", container_options={"movflags": "+faststart"}
        )
        self._stream = self._new_stream(self._container, framerate, {"crf": str(crf), "preset": preset})

    def _new_stream(
        self, container: OutputContainer, framerate: Fraction, options: dict[str, str]
    ) -> VideoStream:
        stream = container.add_stream("libx264", rate=framerate, options=options)
        stream.width, stream.height = even(self.width), even(self.height)
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = TIME_BASE
        return stream

    def write(self, pixels: Pixels, pts: int | None) -> None:
        """Encodes one picture.

        Args:
            pixels: uint8 array in the writer's format, of the writer's size.
            pts: its time, ns; the first one becomes 0. None, or one that does not ascend (a source that
                began again), follows the last at the frame rate.

        Raises:
            ValueError: the array is of another shape or type; FFmpeg would stretch it unseen.
            FFmpegError: encoding or writing failed, this time or before: a container that could not be
                written is left alone, FFmpeg crashes at the next packet where its head was not.
        """
        assert self._container is not None
        if self._failure is not None:
            raise self._failure
        if pixels.shape != self._shape or pixels.dtype != np.uint8:
            raise ValueError(
                f"{self.pixel_format} of {self.width} x {self.height} must be uint8{list(self._shape)}, "
                f"got {pixels.dtype}{list(pixels.shape)}; give the frame caps of what it holds"
            )
        picture = picture_of(pixels, self.pixel_format)
        if picture.format.name != "yuv420p":
            picture = self._reformatter.reformat(picture, format="yuv420p")
        picture.pts, picture.time_base = self._ticks(pts), TIME_BASE
        try:
            self._container.mux(self._stream.encode(picture))
        except Exception as error:
            self._failure = error
            raise

    def close(self, limit_s: float | None = None) -> bool:
        """Writes what the encoder holds and the file's index: it plays from now on. Safe to call twice.

        Args:
            limit_s: time for the pictures still in the encoder; those that do not make it are left out.
                None waits for all.

        Returns:
            Whether every picture is in the file, but for those that `write` has refused.

        Raises:
            FFmpegError: writing failed.
        """
        container, self._container = self._container, None
        if container is None:
            return True
        try:
            return self._last < 0 or self._failure is not None or self._flush(container, limit_s)
        finally:
            container.close()

    def _flush(self, container: OutputContainer, limit_s: float | None) -> bool:
        deadline = None if limit_s is None else time.monotonic() + limit_s
        for packet in self._stream.encode_lazy(None):
            container.mux(packet)
            if deadline is not None and time.monotonic() > deadline:
                return False
        return True

    def _ticks(self, pts: int | None) -> int:
        following = self._last + self._frame_ticks
        ticks = following
        if pts is not None:
            own = round(pts * NS / TIME_BASE)
            if self._offset is None or own + self._offset <= self._last:
                self._offset = following - own
            ticks = own + self._offset
        self._last = ticks
        return ticks


def even(size: int) -> int:
    """The size itself, or one more where it is odd."""
    return size + size % 2


def shape_of(pixel_format: str, width: int, height: int) -> tuple[int, ...]:
    """The shape of an array of one picture in that format; width and height in px."""
    if pixel_format in PACKED:
        return height, width, 3
    return (height, width) if pixel_format == "GRAY8" else (height * 3 // 2, width)


def pad_to_even(pixels: Pixels) -> Pixels:
    """uint8[h, w, ...] with its last row and column repeated where the height or width is odd."""
    rows, columns = pixels.shape[0] % 2, pixels.shape[1] % 2
    if not rows and not columns:
        return pixels
    return np.pad(pixels, [(0, rows), (0, columns)] + [(0, 0)] * (pixels.ndim - 2), mode="edge")


def grey_as_i420(luma: Pixels) -> Pixels:
    """uint8[h * 3 // 2, w]: the luma over neutral chroma, without a converter's change of range."""
    height, width = luma.shape
    pixels = np.full((height * 3 // 2, width), NEUTRAL_CHROMA, np.uint8)
    pixels[:height] = luma
    return pixels


def picture_of(pixels: Pixels, pixel_format: str) -> VideoFrame:
    """An FFmpeg picture of even size out of an array.

    Args:
        pixels: uint8 array in the layout of `pixel_format`.
        pixel_format: GRAY8, I420, NV12, BGR or RGB.
    """
    if pixel_format in PACKED:
        return VideoFrame.from_ndarray(np.ascontiguousarray(pad_to_even(pixels)), PACKED[pixel_format])
    if pixel_format == "NV12":
        return VideoFrame.from_ndarray(np.ascontiguousarray(pixels), "nv12")
    if pixel_format == "GRAY8":
        return VideoFrame.from_ndarray(grey_as_i420(pad_to_even(pixels)), "yuv420p")
    return VideoFrame.from_ndarray(np.ascontiguousarray(pixels), "yuv420p")
