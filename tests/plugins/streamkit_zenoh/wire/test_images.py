"""Images are encoded as JPEG and PNG; the size is checked before decoding."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from streamkit_zenoh.wire.images import (
    IMAGE_LIMIT_BYTES,
    BadImage,
    Image,
    ImageFormat,
    decode_image,
    encode_image,
    grey_or_bgr,
    image_size,
    scaled_to_width,
)


def _image(shape: tuple[int, ...]) -> Image:
    return cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, shape, np.uint8), (9, 9), 5).astype(
        np.uint8
    )


@pytest.mark.parametrize("shape", [(40, 64), (40, 64, 3)])
def test_png_is_lossless_and_jpeg_is_close(shape: tuple[int, ...]) -> None:
    """Grey stays grey, colour stays BGR."""
    image = _image(shape)
    np.testing.assert_array_equal(decode_image(encode_image(image, ImageFormat.PNG)), image)
    near = decode_image(encode_image(image, ImageFormat.JPEG, 95))
    assert near.shape == shape
    assert np.abs(near.astype(int) - image).mean() < 3


@pytest.mark.parametrize("form", ImageFormat)
def test_the_size_is_read_without_decoding(form: ImageFormat) -> None:
    """Width and height are in the header of both."""
    assert image_size(encode_image(_image((30, 50, 3)), form)) == (50, 30)


def test_images_are_only_scaled_down() -> None:
    """The aspect ratio is kept; 0 does not scale."""
    image = _image((40, 64))
    assert scaled_to_width(image, 32).shape == (20, 32)
    assert scaled_to_width(image, 0) is image
    assert scaled_to_width(image, 100) is image


@pytest.mark.parametrize("name", ["GRAY8", "BGR", "RGB", "BGRA", "RGBA", "I420", "NV12"])
def test_every_raw_format_is_converted(name: str) -> None:
    """A grey level is the same in every format."""
    shapes = {"GRAY8": (8, 8), "BGR": (8, 8, 3), "RGB": (8, 8, 3), "BGRA": (8, 8, 4), "RGBA": (8, 8, 4)}
    data = np.full(shapes.get(name, (12, 8)), 128, np.uint8)
    shown = grey_or_bgr(data, name)
    assert shown.shape[:2] == (8, 8)
    assert abs(int(shown.mean()) - 128) <= 3


def test_an_unknown_format_is_refused() -> None:
    """The remedy is in the error."""
    with pytest.raises(ValueError, match="got YUY2; put a videoconvert before"):
        grey_or_bgr(np.zeros((4, 8), np.uint8), "YUY2")


def _png_of(width: int, height: int) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunk = b"IHDR" + header
    return (
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(header)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"GIF89a",
        b"\xff\xd8\xff",
        b"\xff\xd8" + b"\xff" * 1000,
        _png_of(60_000, 60_000),
        _png_of(0, 10),
        b"\xff\xd8\xff\xc0\x00\x11\x08\xff\xff\xff\xff" + bytes(20),
        encode_image(np.zeros((8, 8), np.uint8), ImageFormat.PNG)[:40],
        bytes(IMAGE_LIMIT_BYTES + 1),
    ],
)
def test_invalid_images_are_refused(data: bytes) -> None:
    """Other data, damaged files, and sizes that would exhaust memory."""
    with pytest.raises(BadImage):
        decode_image(data)


def test_too_large_images_are_refused() -> None:
    """JPEG has at most 65535 px a side."""
    with pytest.raises(BadImage, match="jpeg of"):
        encode_image(np.zeros((1, 70_000), np.uint8), ImageFormat.JPEG)
