"""Pictures as bytes: arrays to JPEG or PNG and back, with a bound on what a stranger's picture may become."""

from __future__ import annotations

import enum
import struct
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]

PICTURE_LIMIT_BYTES = 64 * 1024 * 1024
PIXEL_LIMIT = 128 * 1024 * 1024
_TO_BGR = {
    "RGB": cv2.COLOR_RGB2BGR,
    "BGRA": cv2.COLOR_BGRA2BGR,
    "RGBA": cv2.COLOR_RGBA2BGR,
    "I420": cv2.COLOR_YUV2BGR_I420,
    "NV12": cv2.COLOR_YUV2BGR_NV12,
}
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
# What a still picture needs. Text and colour profiles may be bombs, animations are no pictures.
_PNG_CHUNKS = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND", b"sBIT", b"pHYs", b"gAMA", b"sRGB"))
# JPEG markers that begin a frame and carry its size; C4, C8 and CC lie among them and do not.
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class PictureFormat(enum.StrEnum):
    """How a picture becomes bytes."""

    JPEG = "jpeg"
    PNG = "png"


class BadPicture(ValueError):
    """Bytes that are no picture, or one that is too large; says why."""


def displayable(data: Picture, pixel_format: str) -> Picture:
    """The picture as uint8[h, w] or uint8[h, w, 3] BGR, of raw video in one of streamkit's formats.

    Raises:
        ValueError: the format is not known.
    """
    if pixel_format in ("GRAY8", "BGR"):
        return data
    if pixel_format not in _TO_BGR:
        raise ValueError(
            f"a picture must be GRAY8, BGR or {', '.join(_TO_BGR)}, got {pixel_format}; "
            "put a videoconvert before"
        )
    return np.asarray(cv2.cvtColor(data, _TO_BGR[pixel_format]), dtype=np.uint8)


def scaled_to_width(picture: Picture, width: int) -> Picture:
    """The picture at this width, its shape kept; 0 and what is not smaller leave it as it is."""
    height, before = picture.shape[:2]
    if width <= 0 or width >= before:
        return picture
    size = (width, max(1, round(height * width / before)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def encode_picture(picture: Picture, form: PictureFormat, quality: int = 80) -> bytes:
    """The picture as JPEG of a quality, 1 to 100, or as PNG.

    Raises:
        BadPicture: it cannot be written in this form, for example a JPEG of more than 65535 px a side.
    """
    end, options = (
        (".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality]) if form is PictureFormat.JPEG else (".png", [])
    )
    try:
        done, buffer = cv2.imencode(end, picture, options)
    except cv2.error as error:
        raise BadPicture(f"{form} of {picture.shape}: {error}") from None
    if not done:
        raise BadPicture(f"{form} of {picture.shape} cannot be written")
    return bytes(buffer)


def decode_picture(data: bytes) -> Picture:
    """uint8[h, w] or uint8[h, w, 3] BGR from JPEG or PNG; its size is looked at before anything is decoded.

    Raises:
        BadPicture: it is none, or larger than `PIXEL_LIMIT` pixels.
    """
    if len(data) > PICTURE_LIMIT_BYTES:
        raise BadPicture(f"{len(data)} bytes are too many for a picture, {PICTURE_LIMIT_BYTES} is the limit")
    size = picture_size(data)
    if size is None:
        raise BadPicture(f"neither JPEG nor PNG [{len(data)} bytes]")
    if size[0] * size[1] > PIXEL_LIMIT or 0 in size:
        raise BadPicture(f"{size[0]}x{size[1]} px: a picture has 1 to {PIXEL_LIMIT} pixels")
    if data.startswith(_PNG_MAGIC) and not _is_whole_png(data):
        raise BadPicture(f"a PNG that is broken or more than a still picture [{len(data)} bytes]")
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR)
    except cv2.error as error:
        raise BadPicture(str(error)) from None
    if picture is None or picture.dtype != np.uint8:
        raise BadPicture(f"a picture that cannot be decoded [{len(data)} bytes]")
    return np.asarray(picture)


def _is_whole_png(data: bytes) -> bool:
    """Whether its chunks are whole: OpenCV believes lengths that lie, and takes seconds and gigabytes."""
    place = len(_PNG_MAGIC)
    while place + 12 <= len(data):
        size, kind = int.from_bytes(data[place : place + 4], "big"), data[place + 4 : place + 8]
        end = place + 8 + size
        checksum = int.from_bytes(data[end : end + 4], "big")
        if kind not in _PNG_CHUNKS or end + 4 > len(data):
            return False
        if zlib.crc32(data[place + 4 : end]) != checksum:
            return False
        if kind == b"IEND":
            return True
        place = end + 4
    return False


def picture_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that a JPEG or PNG says it has, px; None where it is neither."""
    if data.startswith(_PNG_MAGIC) and len(data) >= 24 and data[12:16] == b"IHDR":
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if data[:2] != b"\xff\xd8":
        return None
    place = 2
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker = data[place + 1]
        if marker in _START_OF_FRAME:
            height, width = struct.unpack(">HH", data[place + 5 : place + 9])
            return width, height
        place += 2 + int.from_bytes(data[place + 2 : place + 4], "big") if marker != 0xFF else 1
    return None
