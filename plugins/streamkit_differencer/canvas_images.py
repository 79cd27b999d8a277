"""Images of the canvas: allocating, scrolling and warping them."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar, cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage

Image = TypeVar("Image", ByteImage, FloatImage)


def allocated(shape: tuple[int, int], fill: float, kind: type[np.uint8] | type[np.float32]) -> Any:
    """An image with spare memory around it, which `scrolled` moves without a copy.

    Args:
        shape: rows and columns.
        fill: value of all pixels.
        kind: type of the pixels.
    """
    result = _view(shape, np.dtype(kind), _spare(shape) // 2)
    result[:] = fill
    return result


def scrolled(image: Image, dx: int, dy: int, fill: float) -> Image:
    """The image moved by whole pixels, with `fill` in the strips that enter.

    With enough spare memory, as from `allocated` and this function, the result is another view of the same
    memory: do not use the argument afterwards.
    """
    height, width = image.shape[:2]
    step, spare = dy * width + dx, _spare(image.shape)
    before = _pixels_before(image)
    if image.base is not None and before is not None and 0 <= before - step <= spare:
        start = before - step
        result = cast("Image", image.base[start : start + image.size].reshape(image.shape))
        _fill_strips(result, dx, dy, fill)
        return result
    result = cast("Image", _view((height, width), image.dtype, 3 * spare // 4 if step > 0 else spare // 4))
    if abs(dx) < width and abs(dy) < height:
        rows, columns = max(0, dy), max(0, dx)
        source = image[max(0, -dy) : height - rows, max(0, -dx) : width - columns]
        result[rows : rows + source.shape[0], columns : columns + source.shape[1]] = source
    _fill_strips(result, dx, dy, fill)
    return result


def _view(shape: tuple[int, int], kind: np.dtype[Any], start: int) -> Any:
    """A new image that starts at pixel `start` of its memory."""
    size = shape[0] * shape[1]
    return np.empty(size + _spare(shape), kind)[start : start + size].reshape(shape)


def _spare(shape: tuple[int, ...]) -> int:
    """Spare pixels of an image's memory: half as many rows as the image has."""
    return shape[0] // 2 * shape[1]


def _pixels_before(image: Image) -> int | None:
    """Spare pixels before an image; None without spare memory."""
    base = image.base
    if base is None or base.ndim != 1 or base.size != image.size + _spare(image.shape):
        return None
    first, memory = (array.__array_interface__["data"][0] for array in (image, base))
    return int(first - memory) // image.itemsize


def _fill_strips(image: Image, dx: int, dy: int, fill: float) -> None:
    """Fills the rows and columns that entered."""
    height, width = image.shape[:2]
    image[: max(dy, 0)] = fill
    image[max(height + min(dy, 0), 0) :] = fill
    image[:, : max(dx, 0)] = fill
    image[:, max(width + min(dx, 0), 0) :] = fill


def warped(image: Image, change: FloatArray, fill: float, interpolation: int = cv2.INTER_NEAREST) -> Image:
    """The image under a homography, of the same size, with `fill` where it has no value."""
    size = image.shape[1], image.shape[0]
    return cast("Image", cv2.warpPerspective(image, change, size, flags=interpolation, borderValue=fill))


class Scratch:
    """Images of the canvas that hold nothing from frame to frame; allocating them each time is slow.

    Attributes:
        quiet: uint8[h, w], mask of D = 0.
        rounded: uint8[h, w], the background before the frame.
        levels: uint8[h, w], see `pixel_classes.classify`; at the end the mask with its values.
        mask: uint8[h, w], foreground.
        updates: uint8[h, w], see `learning.learn`.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.quiet, self.rounded, self.levels, self.mask, self.updates = np.zeros((5, *shape), np.uint8)


class CanvasFrame(NamedTuple):
    """A frame on the canvas: uint8[h, w] each, the image and the mask of what it covers."""

    image: ByteImage
    seen: ByteImage
