"""Small patches of a keyframe, prepared for alignment with other frames, and image pyramids."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from numba import types

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray
from streamkit_kernels import BOOL_1D, FLOAT64, FLOAT64_1D, kernel

RADIUS: Final = 7
# Smallest deviation of a patch, px: lens, shutter and terrain do not quite follow a plane's homography.
MIN_STD: Final = 0.04
# Squared residual by the median one beyond which a patch is off the plane.
OFF_PLANE: Final = 9.0
_MIN_CONTRAST: Final = 2.0
# Patches nearer to the border of an image are out of view, px.
_MARGIN: Final = RADIUS + 3
_PIXELS: Final = (2 * RADIUS + 1) ** 2
_SingleArray = npt.NDArray[np.float32]


def pyramid(images: Sequence[GreyArray], levels: int) -> tuple[GreyArray, ...]:
    """Extends an image pyramid by 2 x 2 block averages to `levels`, fewer where a side would fall below 1 px.

    An odd last row or column is dropped, so that pixel x of level k stays at full-size
    x * 2**k + (2**k - 1) / 2.
    """
    result = list(images)
    while len(result) < levels and min(result[-1].shape) >= 2:
        result.append(halved(result[-1]))
    return tuple(result)


def halved(grey: GreyArray) -> GreyArray:
    """Averages 2 x 2 blocks of uint8[h, w, ...] into uint8[h // 2, w // 2, ...]."""
    height, width = grey.shape[0] // 2, grey.shape[1] // 2
    even = grey[: height * 2, : width * 2]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class PatchLevel:
    """Patches of one pyramid level, prepared for alignment, each leading part spread over the whole frame.

    Attributes:
        centres: float64[n, 2], px of this level.
        probes: float32[m, 3, 225], of all patches of the keyframe; their products with a sampled patch,
            divided by its deviation, are the Gauss-Newton step in x and in y, px, and the correlation.
        inverse_hessian: float64[n, 2, 2], of the gradients at unit deviation.
        usable: bool[n], patches with contrast in both directions.
        numbers: int64[n], their numbers in the keyframe, below m.
    """

    centres: FloatArray
    probes: _SingleArray
    inverse_hessian: FloatArray
    usable: MaskArray
    numbers: npt.NDArray[np.int64]


def spread_order(count: int) -> npt.NDArray[np.int64]:
    """The numbers below `count`, each leading part evenly spread, int64[count].

    Source: van der Corput, Verteilungsfunktionen, 1935.
    """
    numbers, reversed_bits = np.arange(count), np.zeros(count, dtype=np.int64)
    for bit in range(max(1, count - 1).bit_length()):
        reversed_bits = reversed_bits << 1 | numbers >> bit & 1
    return np.argsort(reversed_bits, kind="stable")


def cut_patches(image: GreyArray, centres: FloatArray) -> GreyArray:
    """Cuts uint8[n, 17, 17] around centres at whole pixels; edge pixels repeat beyond the border."""
    reach = RADIUS + 1
    bordered = cv2.copyMakeBorder(image, reach, reach, reach, reach, cv2.BORDER_REPLICATE)
    windows = np.lib.stride_tricks.sliding_window_view(bordered, (2 * reach + 1, 2 * reach + 1))
    columns, rows = np.rint(centres).astype(np.int64).T
    inside = np.clip(rows, 0, image.shape[0] - 1), np.clip(columns, 0, image.shape[1] - 1)
    return np.asarray(windows[inside], dtype=np.uint8)


def prepare(patches: GreyArray, centres: FloatArray) -> PatchLevel:
    """Computes gradients and Hessians of patches from `cut_patches`, for any number of alignments.

    Source: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004, section 3.2 (inverse compositional).
    """
    count = len(patches)
    grey = patches.astype(np.float32)
    inner = grey[:, 1:-1, 1:-1].reshape(count, 1, _PIXELS)
    appearance = inner - inner.mean(axis=2, keepdims=True)
    deviation = np.sqrt((appearance**2).mean(axis=2, keepdims=True))
    scale = np.maximum(deviation, 1e-3)
    appearance /= scale
    # Sobel gradients: with low contrast, plain differences are half noise, and the steps fall short.
    across = grey[:, :, 2:] - grey[:, :, :-2]
    down = grey[:, 2:] - grey[:, :-2]
    steepest = np.empty((count, 2, _PIXELS), dtype=np.float32)
    steepest[:, 0] = (across[:, :-2] + 2 * across[:, 1:-1] + across[:, 2:]).reshape(count, _PIXELS)
    steepest[:, 1] = (down[:, :, :-2] + 2 * down[:, :, 1:-1] + down[:, :, 2:]).reshape(count, _PIXELS)
    steepest /= 8 * scale
    # Remove what a change of brightness or contrast explains as well.
    steepest -= steepest.mean(axis=2, keepdims=True)
    steepest -= np.matmul(steepest, appearance.transpose(0, 2, 1)) / _PIXELS * appearance
    hessian = np.matmul(steepest, steepest.transpose(0, 2, 1)).astype(np.float64)
    determinant = hessian[:, 0, 0] * hessian[:, 1, 1] - hessian[:, 0, 1] ** 2
    trace = hessian[:, 0, 0] + hessian[:, 1, 1]
    usable = (deviation[:, 0, 0] > _MIN_CONTRAST) & (determinant > 0.01 * trace**2)
    hessian[~usable] = np.eye(2)
    inverse_hessian = np.linalg.inv(hessian)
    probes = np.empty((count, 3, _PIXELS), dtype=np.float32)
    np.matmul(-inverse_hessian.astype(np.float32), steepest, out=probes[:, :2])
    np.divide(appearance[:, 0], _PIXELS, out=probes[:, 2])
    return PatchLevel(centres, probes, inverse_hessian, usable, np.arange(count))


@kernel(FLOAT64, BOOL_1D, FLOAT64_1D, types.float64, FLOAT64, types.int64, types.int64, types.int64)
def in_view(
    centres: FloatArray,
    usable: MaskArray,
    scores: FloatArray,
    most_suspect: float,
    key_to_frame: FloatArray,
    height: int,
    width: int,
    count: int,
) -> npt.NDArray[np.int64]:
    """The first usable patches inside an image under a motion, int64[k].

    Args:
        centres: float64[n, 2], px of the keyframe.
        usable: bool[n].
        scores: float64[n], how often each was off the plane lately.
        most_suspect: patches with this score or more are left out.
        key_to_frame: float64[3, 3].
        height: of the image, px.
        width: of the image, px.
        count: most patches.
    """
    chosen, found = np.empty(len(centres), np.int64), 0
    middle_x, middle_y = (width - 1) / 2, (height - 1) / 2
    most_x, most_y = middle_x + (0.5 - _MARGIN), middle_y + (0.5 - _MARGIN)
    for patch in range(len(centres)):
        if found == count or not usable[patch] or scores[patch] >= most_suspect:
            continue
        x, y = centres[patch, 0], centres[patch, 1]
        weight = 1 / (key_to_frame[2, 0] * x + key_to_frame[2, 1] * y + key_to_frame[2, 2])
        across = (key_to_frame[0, 0] * x + key_to_frame[0, 1] * y + key_to_frame[0, 2]) * weight
        down = (key_to_frame[1, 0] * x + key_to_frame[1, 1] * y + key_to_frame[1, 2]) * weight
        if abs(across - middle_x) < most_x and abs(down - middle_y) < most_y:
            chosen[found] = patch
            found += 1
    return chosen[:found]
