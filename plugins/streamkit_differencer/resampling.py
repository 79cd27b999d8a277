"""Pictures of the canvas moved onto another canvas, and the ring of the last frames on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar, cast

import cv2
import numpy as np

from streamkit_differencer.sampling import drawn

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    Matrix = NDArray[np.float64]
    Slices = tuple[slice, slice]

Image = TypeVar("Image", "NDArray[np.uint8]", "NDArray[np.float32]")


def filled(shape: tuple[int, int], fill: float, kind: type[np.uint8] | type[np.float32]) -> Any:
    """A picture that `scrolled` moves at no cost, as it lies in memory longer than itself.

    Args:
        shape: rows and columns.
        fill: value of all pixels.
        kind: of its pixels.
    """
    result = _placed(shape, np.dtype(kind), _room(shape) // 2)
    result[:] = fill
    return result


def scrolled(image: Image, dx: int, dy: int, fill: float) -> Image:
    """The image moved by whole pixels, with `fill` where nothing came in.

    One that has room in its memory, as what `filled` and this function give, stays where it is and only
    begins elsewhere: it must not be used any more afterwards.
    """
    height, width = image.shape[:2]
    step, room = dy * width + dx, _room(image.shape)
    before = _pixels_before(image)
    if image.base is not None and before is not None and 0 <= before - step <= room:
        start = before - step
        result = cast("Image", image.base[start : start + image.size].reshape(image.shape))
        _fill_strips(result, dx, dy, fill)
        return result
    result = cast("Image", _placed((height, width), image.dtype, 3 * room // 4 if step > 0 else room // 4))
    if abs(dx) < width and abs(dy) < height:
        rows, columns = max(0, dy), max(0, dx)
        source = image[max(0, -dy) : height - rows, max(0, -dx) : width - columns]
        result[rows : rows + source.shape[0], columns : columns + source.shape[1]] = source
    _fill_strips(result, dx, dy, fill)
    return result


def _placed(shape: tuple[int, int], kind: np.dtype[Any], start: int) -> Any:
    """A picture that begins at a pixel of new memory with room."""
    size = shape[0] * shape[1]
    return np.empty(size + _room(shape), kind)[start : start + size].reshape(shape)


def _room(shape: tuple[int, ...]) -> int:
    """Pixels that memory is longer than a picture in it: by half as many lines."""
    return shape[0] // 2 * shape[1]


def _pixels_before(image: Image) -> int | None:
    """How much of an image's memory lies before it; None where that has no room to move."""
    base = image.base
    if base is None or base.ndim != 1 or base.size != image.size + _room(image.shape):
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
            self._spare = Remembered(filled(self.shape, 0, np.uint8), filled(self.shape, 0, np.uint8))
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
        to_before = np.asarray(np.linalg.inv(change), np.float64)
        pairs = np.empty(self.shape, np.uint16)
        for frame in self._frames:
            image = np.zeros(self.shape, np.uint8)
            # In less than half of OpenCV's time, and pictures are resampled as frames are.
            drawn(frame.image, pairs, to_before, image, (0, self.shape[0], 0, self.shape[1]))
            frame.image[:], frame.seen[:] = image, warped(frame.seen, change, 0)

    def follow(self, gain: float, offset: float) -> None:
        """Makes the frames brighter or darker: `gain` times the value plus `offset`."""
        for frame in self._frames:
            frame.image[:] = cv2.addWeighted(frame.image, gain, frame.image, 0.0, offset)
