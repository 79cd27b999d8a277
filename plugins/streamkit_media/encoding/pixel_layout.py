"""Arrays as FFmpeg's frames: GRAY8, I420, NV12, BGR and RGB, with even width and height."""

from __future__ import annotations

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]
NEUTRAL_CHROMA = 128
PACKED = {"BGR": "bgr24", "RGB": "rgb24"}


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
    height, width = luma.shape
    pixels = np.full((height * 3 // 2, width), NEUTRAL_CHROMA, np.uint8)
    pixels[:height] = luma
    return pixels


def video_frame(pixels: Pixels, pixel_format: str) -> VideoFrame:
    """FFmpeg's frame of even size with the pixels of an array in `pixel_format`."""
    if pixel_format in PACKED:
        return VideoFrame.from_ndarray(np.ascontiguousarray(pad_to_even(pixels)), PACKED[pixel_format])
    if pixel_format == "GRAY8":
        return VideoFrame.from_ndarray(grey_as_i420(pad_to_even(pixels)), "yuv420p")
    name = "nv12" if pixel_format == "NV12" else "yuv420p"
    return VideoFrame.from_ndarray(np.ascontiguousarray(pixels), name)
