"""The foreground without what surrounds an object: its halo, and the soft shadow that it stands in.

Blurred working pixels and hysteresis widen an object by a pixel. A person or a vehicle takes light from the
ground around it, and the shadow joins neighbours.
"""

from __future__ import annotations

import numpy as np
from numba import types

from streamkit_differencer.arrays import ByteImage, FloatArray, FloatImage, LabelImage
from streamkit_differencer.foreground import MAX_BACKGROUND
from streamkit_differencer.refinement import background_at
from streamkit_kernels import FLOAT32, FLOAT64, INT32, UINT8, UINT8_STRIDED, compiled, kernel

# Pixels with less than this share of an object's mean contrast are its halo. Half-covered pixels have more;
# parts of an object that are almost as grey as the background may have less.
HALO_SHARE = 0.12
# A soft shadow has less than this share of that contrast, takes less than this share of the light, and keeps
# the texture of the ground: the ratio of frame to background hardly varies.
SHADOW_SHARE, SHADOW_DEPTH = 0.5, 0.25
MAX_DEVIATION = 0.04
# Marks removed pixels until all are found.
TRIMMED = 1


@kernel(UINT8, UINT8_STRIDED, UINT8_STRIDED, FLOAT64, INT32, types.int64)
def object_contrasts(
    mask: ByteImage,
    image: ByteImage,
    background: ByteImage,
    to_background: FloatArray,
    blocks: LabelImage,
    count: int,
) -> tuple[ByteImage, FloatImage]:
    """The background under the foreground, and the contrast to it.

    Args:
        mask: uint8[h, w], foreground.
        image: uint8[h, w], the frame at the same scale.
        background: uint8, its border is replicated.
        to_background: float64[3, 3], frame pixels to those of `background`.
        blocks: int32[n, 3], the components of the foreground, see `components_of`.
        count: number of components.

    Returns:
        uint8[h, w], the background under each foreground pixel, at least 1; float32[h / 2 + 1, w / 2 + 1],
        the mean contrast of the component that each block of two by two pixels belongs to.
    """
    ground = np.zeros(mask.shape, np.uint8)
    contrast = np.zeros((mask.shape[0] // 2 + 1, mask.shape[1] // 2 + 1), np.float32)
    sums, pixels = np.zeros(count), np.zeros(count)
    for index in range(len(blocks)):
        for offset in range(4):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
            if mask[row, column] > MAX_BACKGROUND:
                ground[row, column] = max(background_at(background, to_background, row, column), 1)
                sums[blocks[index, 2]] += abs(np.int64(image[row, column]) - np.int64(ground[row, column]))
                pixels[blocks[index, 2]] += 1.0
    for index in range(len(blocks)):
        component = blocks[index, 2]
        mean = sums[component] / max(pixels[component], 1.0)
        contrast[blocks[index, 0] // 2, blocks[index, 1] // 2] = mean
    return ground, contrast


@kernel(UINT8, UINT8_STRIDED, INT32, UINT8, FLOAT32, types.float64, types.float64)
def trim(
    mask: ByteImage,
    image: ByteImage,
    blocks: LabelImage,
    ground: ByteImage,
    contrast: FloatImage,
    halo_share: float,
    shadow_share: float,
) -> None:
    """Removes halo or soft shadow from the foreground, from its edges inwards.

    Args:
        mask: uint8[h, w], foreground; updated in place.
        image: uint8[h, w], the frame at the same scale.
        blocks: int32[n, 3], see `components_of`.
        ground: uint8[h, w], see `object_contrasts`, as `contrast`.
        contrast: float32[h / 2 + 1, w / 2 + 1].
        halo_share: of an object's mean contrast; pixels with less are its halo.
        shadow_share: of an object's mean contrast; darker pixels with less may be soft shadow.

    Source: the ratio test of Rosin and Ellis, "Image difference threshold strategies and shadow detection",
        BMVC 1995, with the variance in a window.
    """
    # A halo is one pixel wide.
    at_edge, inwards = (halo_share, shadow_share), (0.0, shadow_share)
    removed, total = np.empty((4 * len(blocks), 2), np.int64), 0
    for index in range(len(blocks)):
        for offset in range(4):
            row, column = blocks[index, 0] + offset // 2, blocks[index, 1] + offset % 2
            if _is_edge(mask, row, column) and _is_surrounding(
                mask, image, ground, contrast, row, column, at_edge
            ):
                removed[total, 0], removed[total, 1] = row, column
                mask[row, column] = TRIMMED
                total += 1
    first = 0
    while first < total and shadow_share > 0.0:
        for row, column in _neighbours(removed[first, 0], removed[first, 1], mask.shape):
            if _is_surrounding(mask, image, ground, contrast, row, column, inwards):
                removed[total, 0], removed[total, 1] = row, column
                mask[row, column] = TRIMMED
                total += 1
        first += 1
    for index in range(total):
        mask[removed[index, 0], removed[index, 1]] = 0


@compiled
def _is_surrounding(
    mask: ByteImage,
    image: ByteImage,
    ground: ByteImage,
    contrast: FloatImage,
    row: int,
    column: int,
    shares: tuple[float, float],
) -> bool:
    """Whether a pixel is foreground that may be halo or soft shadow."""
    mean = contrast[row // 2, column // 2]
    if mask[row, column] <= MAX_BACKGROUND or mean == 0.0:
        return False
    known = np.int64(ground[row, column])
    darkening = known - np.int64(image[row, column])
    if abs(darkening) < shares[0] * mean:
        return True
    is_soft = 0 < darkening < min(shares[1] * mean, SHADOW_DEPTH * known)
    return is_soft and _is_even(mask, image, ground, row, column)


@compiled
def _is_even(mask: ByteImage, image: ByteImage, ground: ByteImage, row: int, column: int) -> bool:
    """Whether the ratio of frame to background hardly varies among the foreground around a pixel."""
    count, total, squares = 0, 0.0, 0.0
    for y in range(max(row - 1, 0), min(row + 2, mask.shape[0])):
        for x in range(max(column - 1, 0), min(column + 2, mask.shape[1])):
            if mask[y, x] > MAX_BACKGROUND or mask[y, x] == TRIMMED:
                ratio = image[y, x] / np.int64(ground[y, x])
                count, total, squares = count + 1, total + ratio, squares + ratio * ratio
    mean = total / count
    return bool(squares / count - mean * mean <= MAX_DEVIATION**2)


@compiled
def _is_edge(mask: ByteImage, row: int, column: int) -> bool:
    """Whether a pixel is foreground and one of its four neighbours is background."""
    if mask[row, column] <= MAX_BACKGROUND:
        return False
    for y, x in _neighbours(row, column, mask.shape):
        if mask[y, x] <= MAX_BACKGROUND and mask[y, x] != TRIMMED:
            return True
    return False


@compiled
def _neighbours(row: int, column: int, shape: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    """Row and column of the four neighbours of a pixel; the border is replicated."""
    above, below = max(row - 1, 0), min(row + 1, shape[0] - 1)
    before, after = max(column - 1, 0), min(column + 1, shape[1] - 1)
    return (above, column), (below, column), (row, before), (row, after)
