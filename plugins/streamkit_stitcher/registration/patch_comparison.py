"""Compiled comparison of a keyframe's patches with a frame."""

from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray
from streamkit_kernels import compiled
from streamkit_stitcher.registration.patches import RADIUS

_SIDE: Final = 2 * RADIUS + 1
_PIXELS: Final = _SIDE**2
_MARGIN: Final = RADIUS + 3
_ONE: Final = 65536


@compiled
def probe(
    image: GreyArray,
    centres: FloatArray,
    probes: npt.NDArray[np.float32],
    numbers: npt.NDArray[np.int64],
    usable: MaskArray,
    matrix: FloatArray,
    products: FloatArray,
    seen: MaskArray,
) -> int:
    """One Gauss-Newton step of each patch from its position under a motion.

    Each is compared with the image resampled bilinearly through the homography's local affine part.
    `centres` float64[n, 2] are px of the keyframe; `probes` and `numbers` see `PatchLevel`. Results:
    `products` float64[3, n], shift in x and y, px of the keyframe, and correlation, 0 out of view; `seen`
    bool[n], usable and in view. Returns the number of patches in view.
    """
    height, width = image.shape
    pixels, below = image.ravel(), np.uintp(width)
    last_x, last_y = (width - 1) * _ONE - 1, (height - 1) * _ONE - 1
    middle_x, middle_y = (width - 1) / 2, (height - 1) / 2
    inner_x, inner_y = middle_x + (0.5 - _MARGIN), middle_y + (0.5 - _MARGIN)
    fraction, count = np.float32(1 / _ONE), 0
    for patch in range(len(centres)):
        products[0, patch] = products[1, patch] = products[2, patch] = 0.0
        x, y = centres[patch, 0], centres[patch, 1]
        weight = 1 / (matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2])
        to_x = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) * weight
        to_y = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) * weight
        seen[patch] = usable[patch] and abs(to_x - middle_x) < inner_x and abs(to_y - middle_y) < inner_y
        if not seen[patch]:
            continue
        count += 1
        xx, xy = (matrix[0, 0] - matrix[2, 0] * to_x) * weight, (matrix[0, 1] - matrix[2, 1] * to_x) * weight
        yx, yy = (matrix[1, 0] - matrix[2, 0] * to_y) * weight, (matrix[1, 1] - matrix[2, 1] * to_y) * weight
        step_x, step_y = np.int64(xx * _ONE), np.int64(yx * _ONE)
        number = numbers[patch]
        total = squares = across = down = correlation = np.float32(0)
        pixel = 0
        for row in range(-RADIUS, RADIUS + 1):
            at_x = np.int64((to_x + xy * row - xx * RADIUS) * _ONE)
            at_y = np.int64((to_y + yy * row - yx * RADIUS) * _ONE)
            for _ in range(_SIDE):
                # Edge pixels repeat beyond the border.
                low_x, low_y = min(max(at_x, 0), last_x), min(max(at_y, 0), last_y)
                place = np.uintp((low_y >> 16) * width + (low_x >> 16))
                right, lower = np.float32(low_x & 65535) * fraction, np.float32(low_y & 65535) * fraction
                first, second = np.float32(pixels[place]), np.float32(pixels[place + below])
                first += right * (np.float32(pixels[place + np.uintp(1)]) - first)
                second += right * (np.float32(pixels[place + below + np.uintp(1)]) - second)
                value = first + lower * (second - first)
                total += value
                squares += value * value
                across += value * probes[number, 0, pixel]
                down += value * probes[number, 1, pixel]
                correlation += value * probes[number, 2, pixel]
                pixel += 1
                at_x += step_x
                at_y += step_y
        mean = total / np.float32(_PIXELS)
        deviation = np.sqrt(max(squares / np.float32(_PIXELS) - mean * mean, np.float32(1e-6)))
        products[0, patch], products[1, patch] = across / deviation, down / deviation
        products[2, patch] = correlation / deviation
    return count
