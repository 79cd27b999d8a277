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
    """The image moved by whole pixels, with `fill` where nothing came in.

    What comes back lies in memory longer than itself: moved once more it stays where it is and only begins
    elsewhere. An image that came from here must not be used any more once it was moved again.
    """
    height, width = image.shape[:2]
    step, room = dy * width + dx, _room(image)
    before = _pixels_before(image)
    if image.base is not None and before is not None and 0 <= before - step <= room:
        start = before - step
        result = cast("Image", image.base[start : start + image.size].reshape(image.shape))
        _fill_strips(result, dx, dy, fill)
        return result
    start = 3 * room // 4 if step > 0 else room // 4
    memory = np.empty(image.size + room, image.dtype)
    result = memory[start : start + image.size].reshape(image.shape)
    if abs(dx) < width and abs(dy) < height:
        rows, columns = max(0, dy), max(0, dx)
        source = image[max(0, -dy) : height - rows, max(0, -dx) : width - columns]
        result[rows : rows + source.shape[0], columns : columns + source.shape[1]] = source
    _fill_strips(result, dx, dy, fill)
    return result


def _room(image: Image) -> int:
    """Pixels that memory is longer than an image in it: by half as many lines."""
    return int(image.shape[0] // 2 * image.shape[1])


def _pixels_before(image: Image) -> int | None:
    """How much of an image's memory lies before it; None where that has no room to move."""
    base = image.base
    if base is None or base.ndim != 1 or base.size != image.size + _room(image):
        return None
    first, memory = (array.__array_interface__["data"][0] for array in (image, base))
    return int(first - memory) // image.itemsize


def _fill_strips(image: Image, dx: int, dy: int, fill: float) -> None:
    """Fills the lines and columns that came in."""
    height, width = image.shape[:2]
    image[: max(dy, 0)] = fill
    image[max(height + min(dy, 0), 0) :] = fill
    image[:, : max(dx, 0)] = fill
    image[:, max(width + min(dx, 0), 0) :] = fill


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
        if frame is None or not np.may_share_memory(image, frame.image):
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
