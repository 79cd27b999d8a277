"""Overlaid graphics: what stands still in the frames while the ground moves, such as a logo or a HUD."""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import MaskArray
from streamkit_stitcher.mosaic.tiles import ImageArray

SignArray = npt.NDArray[np.int8]

# Pairs of frames in which even a pixel that is always an edge can be distinguished from chance.
_FEWEST: Final = 16
_WORKING_WIDTH: Final = 640
# Grey levels per px, beyond noise.
_MIN_GRADIENT: Final = 8.0
# Side of a window, as a part of the width: about a letter's.
_WINDOW: Final = 1 / 100
# Pixels that one gradient is computed from: neighbours are no evidence of their own.
_CORRELATED_PX: Final = 9
# Standard deviations of a sum of random signs: one window in 30 000 is beyond them.
_SIGNIFICANT: Final = 4.0
# Part of the area up to which what graphics enclose is theirs.
_MAX_HOLE: Final = 1 / 20


class OverlaidGraphics:
    """Finds the pixels of a stream's frames that show overlaid graphics.

    Edges of the ground that meet at a pixel in two frames are alike in sign by chance only, those of graphics
    always. The sum of the products of signs, over all pairs of successive frames and a window, is tested
    against chance; so graphics that come and go are found, too.

    Attributes:
        given: uint8[h, w], other than 0 where graphics are known to be; None for unknown.
    """

    given: ImageArray | None = None

    def __init__(self) -> None:
        self._before: list[SignArray] = []
        self._alike = self._both = np.zeros((0, 0), np.int32)
        self._shape, self._pairs = (0, 0), 0

    def add(self, pixels: ImageArray) -> None:
        """Compares uint8[h, w(, 3)] with the frame before it, which showed the ground elsewhere."""
        signs = _signs(pixels)
        if pixels.shape[:2] != self._shape:
            self._shape, self._before, self._pairs = pixels.shape[:2], [], 0
            self._alike, self._both = np.zeros((2, *signs[0].shape), np.int32)
        for old, new in zip(self._before, signs, strict=False):
            product = old * new
            self._alike += product
            self._both += np.abs(product)
        self._pairs += len(self._before) > 0
        self._before = signs

    def mask(self, shape: tuple[int, int]) -> MaskArray | None:
        """Pixels on or inside of graphics, bool of any size, for frames of a shape; None for none."""
        found, given = self._found(shape), self.given
        if given is None or given.shape != shape:
            return found
        if found is None:
            return np.asarray(given > 0)
        return found | (cv2.resize(given, found.shape[::-1], interpolation=cv2.INTER_AREA) > 0)

    def _found(self, shape: tuple[int, int]) -> MaskArray | None:
        """What was found, bool of the working size."""
        if self._shape != shape or self._pairs < _FEWEST:
            return None
        totals = self._alike.astype(np.float32), self._both.astype(np.float32)
        window = (max(3, round(_WINDOW * self._alike.shape[1])) | 1,) * 2
        alike, both = (cv2.boxFilter(one, -1, window, normalize=False) for one in totals)
        still = (alike > _SIGNIFICANT * np.sqrt(_CORRELATED_PX * np.maximum(both, 1))).astype(np.uint8)
        found = cv2.morphologyEx(still, cv2.MORPH_CLOSE, np.ones(window, np.uint8))
        if not found.any():
            return None
        _, labels, statistics, _ = cv2.connectedComponentsWithStats(1 - found, connectivity=4)
        is_hole = statistics[:, cv2.CC_STAT_AREA] < _MAX_HOLE * found.size
        return np.asarray((found > 0) | is_hole[labels])


def _signs(pixels: ImageArray) -> list[SignArray]:
    """Signs of the gradients along x and y at working size, 0 where there is no edge, int8[h, w] each."""
    factor = -(-pixels.shape[1] // _WORKING_WIDTH)
    size = pixels.shape[1] // factor, pixels.shape[0] // factor
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    grey = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
    least = 8 * _MIN_GRADIENT
    gradients = [cv2.Sobel(grey, cv2.CV_16S, dx, dy) for dx, dy in ((1, 0), (0, 1))]
    return [(one > least).astype(np.int8) - (one < -least).astype(np.int8) for one in gradients]
