"""The header of a JPEG file: Exif, XMP and size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

_EXIF: Final = b"Exif\0\0"
_XMP: Final = b"http://ns.adobe.com/xap/1.0/\0"
_APPLICATION_1: Final = 0xE1
_SCAN: Final = 0xDA
# C0 to CF begin a frame with its size, except three that hold tables.
_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_FRAME_BYTES: Final = 5


@dataclass(frozen=True, slots=True)
class JpegHeader:
    """Metadata of a JPEG file.

    Attributes:
        exif: the TIFF structure of its Exif data, empty without any.
        xmp: its XMP packet, empty without any.
        size: width and height, px; None where the file ends before it.
    """

    exif: bytes = b""
    xmp: bytes = b""
    size: tuple[int, int] | None = None


def read_header(data: bytes) -> JpegHeader:
    """Reads a JPEG file up to its first scan; what is not JPEG gives an empty header.

    Args:
        data: the file, or as much of it as there is.

    Source: ITU-T T.81, annex B.
    """
    exif = xmp = b""
    size: tuple[int, int] | None = None
    for marker, content in _segments(data):
        if marker == _APPLICATION_1 and content.startswith(_EXIF):
            exif = exif or content[len(_EXIF) :]
        elif marker == _APPLICATION_1 and content.startswith(_XMP):
            xmp = xmp or content[len(_XMP) :]
        elif marker in _FRAMES and len(content) >= _FRAME_BYTES:
            size = int.from_bytes(content[3:5], "big"), int.from_bytes(content[1:3], "big")
    return JpegHeader(exif, xmp, size)


def _segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Marker and content of each segment before the first scan."""
    if data[:2] != b"\xff\xd8":
        return
    place = 2
    while place + 4 <= len(data) and data[place] == 0xFF:
        marker, length = data[place + 1], int.from_bytes(data[place + 2 : place + 4], "big")
        if marker == 0xFF:  # a fill byte
            place += 1
            continue
        if marker == _SCAN or length < 2:
            return
        yield marker, data[place + 4 : place + 2 + length]
        place += 2 + length
