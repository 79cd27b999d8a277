"""Pictures of the canvas moved onto another canvas, and the ring of the last frames on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    Matrix = NDArray[np.float64]
    Region = tuple[slice, slice]

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


def parts(mask: ByteImage, band: int) -> Iterator[Region]:
    """The parts of a mask that have something in them: a rectangle for each `band` of so many rows.

    Movers are few: a rectangle around all of them would often be the whole frame.
    """
    for first in range(0, len(mask), band):
        left, top, width, rows = cv2.boundingRect(mask[first : first + band])
        if width:
            yield np.s_[first + top : first + top + rows, left : left + width]


def padded(part: Region, margin: int, shape: tuple[int, ...]) -> tuple[Region, Region]:
    """The part with a margin where the picture has one, and the part within that."""
    rows, columns = part
    top, left = max(0, rows.start - margin), max(0, columns.start - margin)
    outer = np.s_[top : min(shape[0], rows.stop + margin), left : min(shape[1], columns.stop + margin)]
    inner = np.s_[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return outer, inner


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

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> Remembered:
        return self._frames[index]

    def append(self, image: ByteImage, seen: ByteImage, region: Region) -> None:
        """Takes in a frame, in the arrays of the oldest where there are enough."""
        if len(self._frames) < self.length:
            oldest = Remembered(np.zeros(self.shape, np.uint8), np.zeros(self.shape, np.uint8))
        else:
            oldest = self._frames.popleft()
        oldest.seen[:] = 0
        oldest.image[region], oldest.seen[region] = image, seen
        self._frames.append(oldest)

    def scroll(self, dx: int, dy: int) -> None:
        """Moves the frames by whole pixels."""
        for frame in self._frames:
            frame.image, frame.seen = scrolled(frame.image, dx, dy, 0), scrolled(frame.seen, dx, dy, 0)

    def warp(self, change: Matrix) -> None:
        """Resamples the frames onto another canvas."""
        for frame in self._frames:
            frame.image = warped(frame.image, change, 0, cv2.INTER_LINEAR)
            frame.seen = warped(frame.seen, change, 0)

    def follow(self, gain: float, offset: float) -> None:
        """Makes the frames brighter or darker: `gain` times the value plus `offset`."""
        for frame in self._frames:
            brighter = cv2.addWeighted(frame.image, gain, frame.image, 0.0, offset)
            frame.image = cast("ByteImage", brighter)
