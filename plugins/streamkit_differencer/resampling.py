"""Pictures of the canvas moved onto another canvas, and the ring of the last frames on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    Matrix = NDArray[np.float64]
    Slices = tuple[slice, slice]

Image = TypeVar("Image", "NDArray[np.uint8]", "NDArray[np.float32]")


def scrolled(image: Image, dx: int, dy: int, fill: float) -> Image:
    """The image moved by whole pixels, with `fill` where nothing came in."""
    result = np.full_like(image, fill)
    height, width = image.shape[:2]
    if abs(dx) < width and abs(dy) < height:
        rows, columns = max(0, dy), max(0, dx)
        source = image[max(0, -dy) : height - rows, max(0, -dx) : width - columns]
        result[rows : rows + source.shape[0], columns : columns + source.shape[1]] = source
    return result


def bounds_of(part: Slices, size: tuple[int, int]) -> Region:
    """Rows and columns of a picture of a width and height as kernels take them."""
    (top, bottom, _), (left, right, _) = part[0].indices(size[1]), part[1].indices(size[0])
    return top, bottom, left, right


def warped(image: Image, change: Matrix, fill: float, interpolation: int = cv2.INTER_NEAREST) -> Image:
    """The image under a homography, of the same size, with `fill` where nothing came in."""
    size = image.shape[1], image.shape[0]
    return cast("Image", cv2.warpPerspective(image, change, size, flags=interpolation, borderValue=fill))


@dataclass(slots=True)
class Remembered:
    """An earlier frame on the canvas and where it covered it."""

    image: ByteImage
    seen: ByteImage


@dataclass(slots=True)
class LastFrames:
    """The last frames on the canvas, the newest last.

    Attributes:
        shape: rows and columns of the canvas.
        length: frames that are kept.
    """

    shape: tuple[int, int]
    length: int
    _frames: deque[Remembered] = field(default_factory=deque)
    _spare: Remembered | None = None

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> Remembered:
        return self._frames[index]

    def room(self) -> Remembered:
        """Where the next frame may be drawn, so that `place` need not copy it: the mask is empty."""
        if self._spare is None:
            self._spare = Remembered(np.zeros(self.shape, np.uint8), np.zeros(self.shape, np.uint8))
        self._spare.seen.fill(0)
        return self._spare

    def place(self, image: ByteImage, seen: ByteImage, region: Slices) -> Remembered:
        """A frame on the canvas, in the arrays of the oldest where there are enough; `append` comes next.

        Args:
            image: uint8[h, w], the frame within the region; what is a view of `room` is there already.
            seen: uint8[h, w], mask of what it covers.
            region: of the canvas.
        """
        frame = self._spare
        if frame is None or image.base is not frame.image:
            frame = self.room()
            frame.image[region], frame.seen[region] = image, seen
        return frame

    def append(self, frame: Remembered) -> None:
        """Takes in a frame that was placed."""
        self._frames.append(frame)
        self._spare = self._frames.popleft() if len(self._frames) > self.length else None

    def scroll(self, dx: int, dy: int) -> None:
        """Moves the frames by whole pixels."""
        for frame in self._frames:
            frame.image, frame.seen = scrolled(frame.image, dx, dy, 0), scrolled(frame.seen, dx, dy, 0)

    def warp(self, change: Matrix) -> None:
        """Resamples the frames onto another canvas."""
        if not self._frames:
            return
        # Several pictures in one go cost less than one by one.
        images = cast("ByteImage", cv2.merge([frame.image for frame in self._frames]))
        masks = cast("ByteImage", cv2.merge([frame.seen for frame in self._frames]))
        images, masks = warped(images, change, 0, cv2.INTER_LINEAR), warped(masks, change, 0)
        for frame, image, seen in zip(self._frames, cv2.split(images), cv2.split(masks), strict=True):
            frame.image, frame.seen = cast("ByteImage", image), cast("ByteImage", seen)

    def follow(self, gain: float, offset: float) -> None:
        """Makes the frames brighter or darker: `gain` times the value plus `offset`."""
        for frame in self._frames:
            brighter = cv2.addWeighted(frame.image, gain, frame.image, 0.0, offset)
            frame.image = cast("ByteImage", brighter)
