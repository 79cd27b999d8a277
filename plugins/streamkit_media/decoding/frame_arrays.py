"""FFmpeg's decoded frames as arrays, sharing memory where the layout allows."""

from __future__ import annotations

import numpy as np
from av.video.frame import VideoFrame
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]

# 8-bit formats whose first plane is the luma, alone.
LUMA_FIRST = frozenset(
    {
        "gray", "yuv420p", "yuvj420p", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "yuv440p", "yuvj440p",
        "yuv411p", "yuvj411p", "yuv410p", "yuva420p", "yuva422p", "yuva444p", "nv12", "nv21", "nv16", "nv24",
        "nv42",
    }
)  # fmt: skip
SAME_AS_I420 = frozenset({"yuv420p", "yuvj420p"})
PACKED = {"BGR": "bgr24", "RGB": "rgb24"}
PLANAR = frozenset({"I420", "NV12"})
NAMES = {"I420": "yuv420p", "NV12": "nv12", **PACKED}


class OddSize(ValueError):
    """The format needs even width and height."""


class FrameReader:
    """Converts decoded frames to arrays of one format.

    Args:
        pixel_format: GRAY8, I420, NV12, BGR or RGB.
    """

    def __init__(self, pixel_format: str) -> None:
        if pixel_format not in ("GRAY8", *NAMES):
            raise ValueError(
                f"a frame's format must be one of GRAY8, {', '.join(NAMES)}, got {pixel_format!r}"
            )
        self.pixel_format = pixel_format
        self._reformatter = VideoReformatter()

    def read(self, frame: VideoFrame) -> Pixels:
        """The frame as a read-only array, which keeps FFmpeg's memory alive.

        GRAY8 is the decoder's own luma plane, in the range of the video (16 to 235 in most), uint8[h, w];
        only where there is none (more than 8 bits, RGB, palettes) it is converted. I420 and NV12 are
        uint8[h * 3 // 2, w], one copy. BGR and RGB are uint8[h, w, 3].

        Raises:
            OddSize: I420 or NV12 is asked for a frame of odd width or height.
        """
        name, wanted = frame.format.name, NAMES.get(self.pixel_format, "")
        if self.pixel_format == "GRAY8":
            if name not in LUMA_FIRST:
                # To yuv420p where it is YUV: swscale would stretch the range on the way to gray.
                grey = "yuv420p" if name.startswith(("yuv", "p0")) else "gray"
                frame = self._reformatter.reformat(frame, format=grey)
            pixels = first_plane(frame)
        else:
            if self.pixel_format not in PACKED and (frame.width % 2 or frame.height % 2):
                raise OddSize(
                    f"{self.pixel_format} needs even width and height, the frame is {frame.width} x "
                    f"{frame.height}; ask for GRAY8, BGR or RGB instead"
                )
            if wanted != "yuv420p" or name not in SAME_AS_I420:
                frame = self._reformatter.reformat(frame, format=wanted)
            pixels = np.asarray(frame.to_ndarray(), np.uint8)
        pixels.flags.writeable = False
        return pixels


def first_plane(frame: VideoFrame) -> Pixels:
    """The first plane as uint8[height, width], a view that keeps the frame alive."""
    plane = frame.planes[0]
    line = plane.line_size
    rows: Pixels = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, abs(line))
    rows = rows[: plane.height, : frame.width]
    return rows[::-1] if line < 0 else rows


def oriented(pixels: Pixels, pixel_format: str, degrees: int, *, is_flipped: bool) -> Pixels:
    """A frame upside down where flipped, then rotated counter-clockwise.

    Args:
        pixels: GRAY8, BGR or RGB as uint8[h, w] or uint8[h, w, 3], I420 or NV12 as uint8[h * 3 // 2, w].
        pixel_format: one of these.
        degrees: a multiple of 90.
        is_flipped: whether the frame is turned upside down first.
    """
    if pixel_format not in PLANAR:
        return _turned(pixels, degrees, is_flipped=is_flipped)
    width, rows = pixels.shape[1], pixels.shape[0] * 2 // 3
    luma, chroma = pixels[:rows], pixels[rows:].reshape(-1)
    if pixel_format == "I420":
        planes = [luma, *chroma.reshape(2, rows // 2, width // 2)]
    else:
        planes = [luma, chroma.reshape(rows // 2, width // 2, 2)]
    turned = [_turned(plane, degrees, is_flipped=is_flipped) for plane in planes]
    return np.concatenate([plane.reshape(-1) for plane in turned]).reshape(-1, turned[0].shape[1])


def _turned(plane: Pixels, degrees: int, *, is_flipped: bool) -> Pixels:
    """uint8[h, w] or uint8[h, w, n]."""
    return np.ascontiguousarray(np.rot90(plane[::-1] if is_flipped else plane, degrees // 90))
