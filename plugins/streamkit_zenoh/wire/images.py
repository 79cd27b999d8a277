"""Image codec: arrays to JPEG or PNG and back, with bounds on images from the network."""

from __future__ import annotations

import enum
import struct
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

IMAGE_LIMIT_BYTES = 64 * 1024 * 1024
PIXEL_LIMIT = 128 * 1024 * 1024
_TO_BGR = {
    "RGB": cv2.COLOR_RGB2BGR,
    "BGRA": cv2.COLOR_BGRA2BGR,
    "RGBA": cv2.COLOR_RGBA2BGR,
    "I420": cv2.COLOR_YUV2BGR_I420,
    "NV12": cv2.COLOR_YUV2BGR_NV12,
}
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
# Chunks of a still image. Compressed text and colour profiles may expand without bound.
_PNG_CHUNKS = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND", b"sBIT", b"pHYs", b"gAMA", b"sRGB"))
# JPEG markers of a start of frame, which holds the size; C4, C8 and CC are other markers.
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class ImageFormat(enum.StrEnum):
    """Image file format."""

    JPEG = "jpeg"
    PNG = "png"


class BadImage(ValueError):
    """Bytes that are not a valid image, or one that is too large; the message says why."""


def grey_or_bgr(data: Image, pixel_format: str) -> Image:
    """Converts raw video to uint8[h, w] grey or uint8[h, w, 3] BGR.

    Raises:
        ValueError: the format is unknown.
    """
    if pixel_format in ("GRAY8", "BGR"):
        return data
    if pixel_format not in _TO_BGR:
        raise ValueError(
            f"a frame must be GRAY8, BGR or {', '.join(_TO_BGR)}, got {pixel_format}; "
            "put a videoconvert before"
        )
    return np.asarray(cv2.cvtColor(data, _TO_BGR[pixel_format]), dtype=np.uint8)


def scaled_to_width(image: Image, width: int) -> Image:
    """Scales a wider image to this width, keeping its aspect ratio; 0 never scales."""
    height, before = image.shape[:2]
    if width <= 0 or width >= before:
        return image
    size = (width, max(1, round(height * width / before)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def encode_image(image: Image, image_format: ImageFormat, quality: int = 80) -> bytes:
    """Encodes an image as JPEG of a quality, 1 to 100, or as PNG.

    Raises:
        BadImage: the format does not allow it, for example a JPEG of more than 65535 px a side.
    """
    end, options = (
        (".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality]) if image_format is ImageFormat.JPEG else (".png", [])
    )
    try:
        done, buffer = cv2.imencode(end, image, options)
    except cv2.error as error:
        raise BadImage(f"{image_format} of {image.shape}: {error}") from None
    if not done:
        raise BadImage(f"{image_format} of {image.shape} cannot be written")
    return bytes(buffer)


def decode_image(data: bytes) -> Image:
    """Decodes JPEG or PNG to uint8[h, w] or uint8[h, w, 3] BGR; its size is checked before.

    Raises:
        BadImage: the data is invalid, or has more than `PIXEL_LIMIT` pixels.
    """
    if len(data) > IMAGE_LIMIT_BYTES:
        raise BadImage(f"{len(data)} bytes are too many for an image, {IMAGE_LIMIT_BYTES} is the limit")
    size = image_size(data)
    if size is None:
        raise BadImage(f"neither JPEG nor PNG [{len(data)} bytes]")
    if size[0] * size[1] > PIXEL_LIMIT or 0 in size:
        raise BadImage(f"{size[0]}x{size[1]} px: an image has 1 to {PIXEL_LIMIT} pixels")
    if data.startswith(_PNG_MAGIC) and not _is_whole_png(data):
        raise BadImage(f"a PNG that is broken or not a still image [{len(data)} bytes]")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR)
    except cv2.error as error:
        raise BadImage(str(error)) from None
    if image is None or image.dtype != np.uint8:
        raise BadImage(f"an image that cannot be decoded [{len(data)} bytes]")
    return np.asarray(image)


def _is_whole_png(data: bytes) -> bool:
    """Whether all chunks are valid: with wrong lengths OpenCV takes seconds and gigabytes."""
    position = len(_PNG_MAGIC)
    while position + 12 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, position)
        content, end = data[position + 4 : position + 8 + size], position + 12 + size
        checksum = int.from_bytes(data[end - 4 : end], "big")
        if kind not in _PNG_CHUNKS or end > len(data) or zlib.crc32(content) != checksum:
            return False
        if kind == b"IEND":
            return True
        position = end
    return False


def image_size(data: bytes) -> tuple[int, int] | None:
    """Width and height in the header of a JPEG or PNG, px; None for other data."""
    if data.startswith(_PNG_MAGIC) and len(data) >= 24 and data[12:16] == b"IHDR":
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if data[:2] != b"\xff\xd8":
        return None
    position = 2
    while position + 9 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker in _START_OF_FRAME:
            height, width = struct.unpack(">HH", data[position + 5 : position + 9])
            return width, height
        position += 2 + int.from_bytes(data[position + 2 : position + 4], "big") if marker != 0xFF else 1
    return None
