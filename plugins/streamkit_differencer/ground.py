"""What is known of each pixel of the canvas: its images, scrolled and warped together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, TypeVar, cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage, Slices
from streamkit_differencer.equations import LONGEST_WAIT

Image = TypeVar("Image", ByteImage, FloatImage)
# Values of `Ground.valid`.
UNKNOWN, PROVISIONAL, KNOWN = 0, 1, 255
# Mean deviation of an unknown pixel, grey levels.
UNKNOWN_DEVIATION = 5.0
# Value of each image where nothing is known, if it is not 0.
FILLS = {"deviation": UNKNOWN_DEVIATION, "waiting": LONGEST_WAIT}
FLOATS = ("background", "deviation")


class CanvasFrame(NamedTuple):
    """A frame on the canvas: uint8[h, w] each, the image and the mask of what it covers."""

    image: ByteImage
    seen: ByteImage

    def part(self, region: Slices) -> CanvasFrame:
        """Views of a region of the canvas."""
        return CanvasFrame(self.image[region], self.seen[region])


@dataclass(slots=True)
class Ground:
    """The state of every pixel of a canvas, or of a part of it.

    Attributes:
        background: float32[h, w], B; undefined where it is not valid.
        deviation: float32[h, w], mean absolute deviation of the background, grey levels.
        waiting: uint8[h, w], the counter D of equation 1, see `equations.count_down`.
        valid: uint8[h, w], `UNKNOWN`, `PROVISIONAL` or `KNOWN`.
        known_frames: uint8[h, w], frames that the background was seen at rest.
        other: uint8[h, w], the other value of each pixel, see `learning`.
        other_frames: uint8[h, w], frames that it was seen at rest.
        flicker: uint8[h, w], see `filters.flicker`.
        foreground_before: uint8[h, w], mask of the previous frame's foreground.
    """

    background: FloatImage
    deviation: FloatImage
    waiting: ByteImage
    valid: ByteImage
    known_frames: ByteImage
    other: ByteImage
    other_frames: ByteImage
    flicker: ByteImage
    foreground_before: ByteImage

    @classmethod
    def unknown(cls, size: tuple[int, int]) -> Ground:
        """Ground of which nothing is known, for a canvas of this width and height."""
        shape = size[1], size[0]
        return cls(
            **{
                field.name: np.full(
                    shape, FILLS.get(field.name, 0), np.float32 if field.name in FLOATS else np.uint8
                )
                for field in fields(cls)
            }
        )

    def part(self, region: Slices) -> Ground:
        """Views of a region of the canvas."""
        return Ground(*(getattr(self, field.name)[region] for field in fields(self)))

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        for name, image, fill in self._used():
            setattr(self, name, scrolled(image, dx, dy, fill))

    def warp(self, change: FloatArray) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        for name, image, fill in self._used():
            interpolation = cv2.INTER_CUBIC if name == "background" else cv2.INTER_NEAREST
            setattr(self, name, warped(image, change, fill, interpolation))
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid = cast("ByteImage", cv2.erode(self.valid, np.ones((3, 3), np.uint8)))

    def _used(self) -> Iterator[tuple[str, Any, float]]:
        """Name, image and fill value of the images that may hold anything else."""
        for field in fields(self):
            image, fill = getattr(self, field.name), FILLS.get(field.name, 0)
            if fill or cv2.countNonZero(image):
                yield field.name, image, fill


def scrolled(image: Image, dx: int, dy: int, fill: float) -> Image:
    """The image moved by whole pixels, with `fill` in the strips that enter."""
    height, width = image.shape
    if abs(dx) >= width or abs(dy) >= height:
        return np.full_like(image, fill)
    top, bottom, left, right = max(dy, 0), max(-dy, 0), max(dx, 0), max(-dx, 0)
    inside = image[bottom : height - top, right : width - left]
    border = cv2.BORDER_CONSTANT
    return cast("Image", cv2.copyMakeBorder(inside, top, bottom, left, right, border, value=fill))


def warped(image: Image, change: FloatArray, fill: float, interpolation: int = cv2.INTER_NEAREST) -> Image:
    """The image under a homography, of the same size, with `fill` where it has no value."""
    size = image.shape[1], image.shape[0]
    return cast("Image", cv2.warpPerspective(image, change, size, flags=interpolation, borderValue=fill))
