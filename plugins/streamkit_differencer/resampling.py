"""Pictures of the canvas moved onto another canvas, and the ring of the last frames on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar, cast

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    IntArray = NDArray[np.intp]
    Matrix = NDArray[np.float64]
    Region = tuple[slice, slice]

# Rows that are looked at together where only parts of a picture have something in them.
BAND = 96
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


def parts(mask: ByteImage, band: int = BAND) -> list[Region]:
    """The parts of a mask that have something in them: a rectangle for each `band` of so many rows.

    Movers are few: a rectangle around all of them would often be the whole frame.
    """
    found = []
    for first in range(0, len(mask), band):
        left, top, width, rows = cv2.boundingRect(mask[first : first + band])
        if width:
            found.append(np.s_[first + top : first + top + rows, left : left + width])
    return found


def apart(regions: list[Region], margin: int, shape: tuple[int, ...]) -> list[Region]:
    """Rectangles with a margin where the picture has one; those that then overlap become one."""
    result: list[Region] = []
    for region in regions:
        (rows, columns), _ = padded(region, margin, shape)
        while True:
            hits = [other for other in result if overlap(other[0], rows) and overlap(other[1], columns)]
            if not hits:
                break
            for down, across in hits:
                rows = slice(min(rows.start, down.start), max(rows.stop, down.stop))
                columns = slice(min(columns.start, across.start), max(columns.stop, across.stop))
            result = [other for other in result if other not in hits]
        result.append((rows, columns))
    return result


def overlap(first: slice, second: slice) -> bool:
    """Whether two ranges have something in common."""
    return bool(first.start < second.stop and second.start < first.stop)


def held(indices: IntArray, length: int) -> IntArray:
    """Rows or columns, those beyond a border as on it; for some hundred np.clip would take thrice as long."""
    return np.minimum(np.maximum(indices, 0), length - 1)


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
    _spare: Remembered | None = None
    _room: ByteImage | None = None

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> Remembered:
        return self._frames[index]

    def room(self, region: Region) -> tuple[ByteImage, ByteImage]:
        """Where the next frame and what it covers may be drawn, so that `append` need not copy them.

        Both are uint8 of the region's shape; the image has anything in it, the mask is empty.
        """
        if self._spare is None:
            self._spare = Remembered(np.zeros(self.shape, np.uint8), np.zeros(self.shape, np.uint8))
        self._spare.seen.fill(0)
        self._room = self._spare.image[region]
        return self._room, self._spare.seen[region]

    def append(self, image: ByteImage, seen: ByteImage, region: Region) -> None:
        """Takes in a frame, in the arrays of the oldest where there are enough."""
        if image is not self._room:
            room, covered = self.room(region)
            room[:], covered[:] = image, seen
        assert self._spare is not None
        self._frames.append(self._spare)
        self._spare = self._frames.popleft() if len(self._frames) > self.length else None
        self._room = None

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
