"""What foreground is marked with, where the model tells more of it than that it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from streamkit_differencer.canvas_region import REGION
from streamkit_kernels import BYTES, compiled, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    ByteLine = NDArray[np.uint8]

# Foreground that changed lately, foreground that is quiet, and shadow.
FOREGROUND_CHANGED = 255
FOREGROUND_QUIET = 128
SHADOW = 50


@kernel(BYTES, BYTES, BYTES, REGION)
def mark(mask: ByteImage, quiet: ByteImage, marks: ByteImage, region: Region) -> None:
    """Marks the foreground with what it is.

    Args:
        mask: uint8[h, w], foreground.
        quiet: uint8[h, w], mask of the pixels that did not change lately.
        marks: uint8[h, w], becomes 0 for ground, else `FOREGROUND_CHANGED` or `FOREGROUND_QUIET`.
        region: of all three.
    """
    top, bottom, left, right = region
    for row in range(top, bottom):
        _mark(mask[row, left:right], quiet[row, left:right], marks[row, left:right])


@compiled
def _mark(mask: ByteLine, quiet: ByteLine, marks: ByteLine) -> None:
    for index in range(marks.size):
        kind = np.uint8(FOREGROUND_QUIET) if quiet[index] > 0 else np.uint8(FOREGROUND_CHANGED)
        marks[index] = kind & mask[index]
