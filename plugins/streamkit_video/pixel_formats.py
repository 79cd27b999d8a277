"""Raw pixel formats: their array layouts and conversion between them.

All arrays are uint8. GRAY8 is [h, w]; BGR and RGB [h, w, 3]; BGRA and RGBA [h, w, 4]; I420 and NV12
[h * 3 // 2, w] with the luma plane on top. Conversion between colour and I420 or NV12 assumes limited range
(16 to 235) BT.601. GRAY8 is the luma plane unchanged, limited range or not, and 0 to 255 when made from
colour.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

ByteArray = NDArray[np.uint8]

PLANAR = ("I420", "NV12")
FORMATS = ("I420", "NV12", "BGR", "RGB", "BGRA", "RGBA", "GRAY8")
ANY_FORMAT = f"video/x-raw, format={{ {', '.join(FORMATS)} }}"
NEUTRAL_CHROMA = 128


def supports_size(pixel_format: str, width: int, height: int) -> bool:
    """Whether a format allows this frame size: I420 and NV12 need an even width and height."""
    return pixel_format not in PLANAR or (width % 2 == 0 and height % 2 == 0)


def by_preference(pixel_format: str) -> tuple[str, ...]:
    """All formats, the best to convert to or from `pixel_format` first.

    The format itself, then those of its kind (planar or packed), which cost least, then the others. GRAY8 is
    of the planar kind, but comes last where it would lose the colours.
    """
    kind = PLANAR if pixel_format in (*PLANAR, "GRAY8") else ("BGR", "RGB", "BGRA", "RGBA")
    ranks = {name: (name != pixel_format, name == "GRAY8", name not in kind) for name in FORMATS}
    return tuple(sorted(FORMATS, key=ranks.__getitem__))


def convert(data: ByteArray, source: str, target: str) -> ByteArray:
    """Converts a frame to another format.

    Args:
        data: uint8, laid out as `source`.
        source: format of `data`.
        target: format wanted.

    Returns:
        uint8, laid out as `target`: `data` itself for the same format, a view for the luma of I420 or NV12,
        else a new array.

    Raises:
        ValueError: I420 or NV12 of an odd size, or a format that is none of `FORMATS`.
    """
    for name in (source, target):
        if name not in FORMATS:
            raise ValueError(f"raw pixel format must be one of {', '.join(FORMATS)}, got {name!r}")
    if source == target:
        return data
    height, width = image_height(data, source), data.shape[1]
    if not (supports_size(source, width, height) and supports_size(target, width, height)):
        raise ValueError(odd_size_error(source if source in PLANAR else target, width, height))
    if source in PLANAR:
        return _from_planar(data, source, target, height)
    if target in PLANAR:
        return _to_planar(data, source, target)
    return _cvt_color(data, f"{source}2{target}".replace("GRAY8", "GRAY"))


def image_height(data: ByteArray, pixel_format: str) -> int:
    """The height in px of a frame laid out as `pixel_format`; planar arrays have more rows."""
    rows = int(data.shape[0])
    return (rows * 2 + 1) // 3 if pixel_format in PLANAR else rows


def map_planes(
    data: ByteArray, pixel_format: str, function: Callable[[ByteArray, int], ByteArray]
) -> ByteArray:
    """A new frame of what a function makes of each plane, [h, w] or [h, w, channels], and its subsampling."""
    if pixel_format not in PLANAR:
        return np.ascontiguousarray(function(data, 1))
    rows, columns = image_height(data, pixel_format), data.shape[1]
    shape = (2, rows // 2, columns // 2) if pixel_format == "I420" else (1, rows // 2, columns // 2, 2)
    luma = function(data[:rows], 1)
    chroma = np.stack([function(plane, 2) for plane in data[rows:].reshape(shape)])
    return np.concatenate([luma, chroma.reshape(-1, luma.shape[1])])


def odd_size_error(pixel_format: str, width: int, height: int) -> str:
    """The error text for a planar format of an odd size."""
    return (
        f"{pixel_format} needs an even width and height, got {width}x{height}: "
        "use a packed format or GRAY8, or scale to an even size"
    )


def _from_planar(data: ByteArray, source: str, target: str, height: int) -> ByteArray:
    if target == "GRAY8":
        return data[:height]
    if target not in PLANAR:
        return _cvt_color(data, f"YUV2{target}_{source}")
    chroma = data[height:].reshape((2, -1) if source == "I420" else (-1, 2)).T
    return np.concatenate([data[:height], chroma.reshape(-1, data.shape[1])])


def _to_planar(data: ByteArray, source: str, target: str) -> ByteArray:
    if source == "GRAY8":
        height, width = data.shape
        planar = np.full((height * 3 // 2, width), NEUTRAL_CHROMA, np.uint8)
        planar[:height] = data
        return planar
    planar = _cvt_color(data, f"{source}2YUV_I420")
    return planar if target == "I420" else _from_planar(planar, "I420", target, data.shape[0])


def _cvt_color(data: ByteArray, code: str) -> ByteArray:
    return np.asarray(cv2.cvtColor(data, getattr(cv2, f"COLOR_{code}")), np.uint8)
