"""Ground: the images that hold the state of each pixel of the canvas; they move together."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar, cast

import cv2
import numpy as np
from numba import types

from streamkit_differencer.arrays import (
    BOUNDS,
    SPANS,
    Bounds,
    ByteImage,
    CountImage,
    FloatArray,
    FloatImage,
    Slices,
    Spans,
)
from streamkit_differencer.equations import MAX_WAIT
from streamkit_kernels import FLOAT32, UINT8, UINT16, named_tuple

Image = TypeVar("Image", ByteImage, CountImage, FloatImage)
# Values of `Ground.valid`.
UNKNOWN, PROVISIONAL, KNOWN = 0, 1, 255
# Value of a frame on the canvas where it does not show the scene; its black is raised to 1.
UNSEEN = 0
BLACK = np.uint8(1)
# Deviations are counted in such parts of a grey level; that of an unknown pixel, in grey levels.
DEVIATION_STEPS = 16
UNKNOWN_DEVIATION = 5.0
# Value of each image where nothing is known, if it is not 0.
FILLS = {"deviation": int(UNKNOWN_DEVIATION * DEVIATION_STEPS), "waiting": MAX_WAIT}
# Type of each image that is not of bytes.
TYPES = {
    "background": np.float32,
    "known_frames": np.uint16,
    "other_frames": np.uint16,
}


class CanvasFrame(NamedTuple):
    """A frame on the canvas.

    Attributes:
        image: uint8, of the whole canvas, `UNSEEN` around the frame.
        bounds: the part of the canvas that the frame covers.
        spans: int64[h, 2], of each of these rows the first column that shows the frame, and the one after the
            last, counted on the canvas.
        is_resampled: whether the frame was resampled, so that edges may be misplaced.
    """

    image: ByteImage
    bounds: Bounds
    spans: Spans
    is_resampled: bool

    @property
    def region(self) -> Slices:
        """The rows and columns within the bounds."""
        top, bottom, left, right = self.bounds
        return slice(top, bottom), slice(left, right)

    @property
    def covered(self) -> ByteImage:
        """uint8[h, w], the part of the image within the bounds; a view."""
        return self.image[self.region]


CANVAS_FRAME = named_tuple(CanvasFrame, UINT8, BOUNDS, SPANS, types.boolean)


class Ground(NamedTuple):
    """The state of every pixel of a canvas; kernels update its images in place.

    Attributes:
        background: float32[h, w], B; undefined where it is not valid.
        deviation: uint8[h, w], mean absolute deviation of the background, in parts of a grey level.
        waiting: uint8[h, w], the counter D of equation 1, see `equations.count_down`.
        valid: uint8[h, w], `UNKNOWN`, `PROVISIONAL` or `KNOWN`.
        known_frames: uint16[h, w], frames that the background was seen at rest.
        other: uint8[h, w], the other value of each pixel, see `learning`.
        other_frames: uint16[h, w], frames that it was seen at rest.
    """

    background: FloatImage
    deviation: ByteImage
    waiting: ByteImage
    valid: ByteImage
    known_frames: CountImage
    other: ByteImage
    other_frames: CountImage

    @classmethod
    def unknown(cls, size: tuple[int, int]) -> Ground:
        """Ground of which nothing is known, for a canvas of this width and height."""
        images = {
            name: np.full(size[::-1], FILLS.get(name, 0), TYPES.get(name, np.uint8)) for name in cls._fields
        }
        return cls(**images)

    def moved(self, change: FloatArray, is_scroll: bool) -> Ground:
        """The same on another canvas of the same size.

        Args:
            change: float64[3, 3], maps this canvas to that one.
            is_scroll: whether that is a shift by whole pixels, which changes no value.
        """
        images: dict[str, Any] = {}
        for name, image in self._asdict().items():
            interpolation = cv2.INTER_CUBIC if name == "background" else cv2.INTER_NEAREST
            images[name] = moved(image, change, is_scroll, FILLS.get(name, 0), interpolation)
        if not is_scroll:
            # Cubic resampling of the background mixes pixels across the border of what is known.
            images["valid"] = cv2.erode(images["valid"], np.ones((3, 3), np.uint8))
        return Ground(**images)


GROUND = named_tuple(Ground, FLOAT32, UINT8, UINT8, UINT8, UINT16, UINT8, UINT16)


def moved(
    image: Image,
    change: FloatArray,
    is_scroll: bool,
    fill: float = 0,
    interpolation: int = cv2.INTER_NEAREST,
) -> Image:
    """The image under a homography, of the same size, with `fill` where it has no value."""
    height, width = image.shape
    if not fill and not cv2.countNonZero(image):
        return image
    if not is_scroll:
        flags = interpolation
        return cast(
            "Image", cv2.warpPerspective(image, change, (width, height), flags=flags, borderValue=fill)
        )
    dx, dy = np.clip(np.round(change[:2, 2]), (-width, -height), (width, height)).astype(int).tolist()
    top, bottom, left, right = max(dy, 0), max(-dy, 0), max(dx, 0), max(-dx, 0)
    inside = image[bottom : height - top, right : width - left]
    if not inside.size:
        return np.full_like(image, fill)
    return cast(
        "Image", cv2.copyMakeBorder(inside, top, bottom, left, right, cv2.BORDER_CONSTANT, value=fill)
    )
