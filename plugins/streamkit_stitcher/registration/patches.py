"""Sub-pixel alignment of small patches of a keyframe, one by one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, MaskArray, project

RADIUS: Final = 7
# Smallest deviation of a patch, px: lens, shutter and terrain do not quite follow a plane's homography.
SMALLEST_STD: Final = 0.04
# Squared residual by the median one beyond which a patch is off the plane.
OFF_PLANE: Final = 9.0
_ITERATIONS: Final = 6
_CONVERGED: Final = 0.1
_ENOUGH: Final = 0.85
_SETTLED: Final = 1.5
_MAX_SHIFT: Final = 4.0
_MIN_CONTRAST: Final = 2.0
_MIN_CORRELATION: Final = 0.6
_MOSTLY: Final = 0.7
_SingleArray = npt.NDArray[np.float32]


def _offsets(radius: int) -> _SingleArray:
    """Homogeneous offsets of a patch's pixels from its centre, float32[3, (2 radius + 1) ** 2]."""
    reach = np.arange(-radius, radius + 1, dtype=np.float32)
    across, down = np.meshgrid(reach, reach)
    return np.stack([across, down, np.ones_like(across)]).reshape(3, -1)


_PIXELS: Final = (2 * RADIUS + 1) ** 2
_OFFSETS: Final = _offsets(RADIUS)
_EVEN: Final[_SingleArray] = np.full(_PIXELS, 1 / _PIXELS, dtype=np.float32)


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
    """Patches of one pyramid level, prepared for alignment.

    Attributes:
        centres: float64[n, 2], px of this level.
        probes: float32[n, 3, 225]; their products with a sampled patch, divided by its deviation, are the
            Gauss-Newton step in x and in y, px, and the correlation.
        inverse_hessian: float64[n, 2, 2], of the gradients at unit deviation.
        usable: bool[n], patches with contrast in both directions.
    """

    centres: FloatArray
    probes: _SingleArray
    inverse_hessian: FloatArray
    usable: MaskArray

    def part(self, chosen: npt.NDArray[np.int64] | slice) -> "PatchLevel":
        """Some of the patches, by their indices or a slice."""
        return PatchLevel(
            self.centres[chosen], self.probes[chosen], self.inverse_hessian[chosen], self.usable[chosen]
        )


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
    return PatchLevel(centres, probes, inverse_hessian, usable)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Patches of a keyframe found in a frame.

    Attributes:
        key_points: float64[k, 2], in the keyframe.
        frame_points: float64[k, 2], in the frame.
        patches: int64[k], their indices.
        variances: float64[k], of one coordinate of a position, px squared, by correlation and contrast.
        visible_count: number of patches in view, k or more.
    """

    key_points: FloatArray
    frame_points: FloatArray
    patches: npt.NDArray[np.int64]
    variances: FloatArray
    visible_count: int


def align(
    level: PatchLevel, image: GreyArray, key_to_frame: FloatArray, tolerance: float = _CONVERGED
) -> Alignment:
    """Aligns patches of the keyframe with a frame, to a few hundredths of a pixel.

    Each patch is compared with the frame resampled through the homography's local affine part; brightness
    and contrast are normalised patch by patch.

    Args:
        level: patches of the keyframe.
        image: the frame at the same reduction.
        key_to_frame: prediction in px of this level, right to about 3 px.
        tolerance: largest last step of most patches.
    """
    visible = level.usable & _inside(_affine_parts(key_to_frame, level.centres)[:, :, 2], image.shape)
    chosen = np.flatnonzero(visible)
    visible_count = len(chosen)
    if not visible_count:
        return Alignment(np.empty((0, 2)), np.empty((0, 2)), chosen, np.empty(0), 0)
    if len(chosen) < _MOSTLY * len(visible):
        level, visible = level.part(chosen), visible[chosen]
    else:
        # Copying most of the patches costs more than aligning the few that are out of view.
        chosen = np.arange(len(visible))
    shift, correlation, step = _iterate(level, image, key_to_frame, visible, tolerance)
    settled = visible & (step < _SETTLED * tolerance) & (correlation > _MIN_CORRELATION)
    good = settled & (np.hypot(shift[:, 0], shift[:, 1]) < _MAX_SHIFT)
    key_points = level.centres[good]
    # Images of unit deviation with correlation c differ by 2 - 2 c.
    variances = (1 - correlation[good]) * np.trace(level.inverse_hessian[good], axis1=1, axis2=2)
    frame_points = project(key_to_frame, key_points + shift[good])
    return Alignment(key_points, frame_points, chosen[good], np.maximum(variances, 0.0), visible_count)


def in_view(level: PatchLevel, key_to_frame: FloatArray, shape: Sequence[int]) -> MaskArray:
    """Usable patches inside an image of `shape` under a motion, bool[n]."""
    return level.usable & _inside(project(key_to_frame, level.centres), shape)


def _iterate(
    level: PatchLevel, image: GreyArray, key_to_frame: FloatArray, visible: MaskArray, tolerance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Newton iterations of each patch's shift: (shift, correlation, length of the last step)."""
    parts = _affine_parts(key_to_frame, level.centres)
    # The patches' shifts are mapped by the same affine parts.
    local, places = parts[:, :, :2], parts[:, :, 2].copy()
    shift = np.zeros((2, len(visible)))
    enough = _ENOUGH * np.count_nonzero(visible)
    for _ in range(_ITERATIONS):
        products = _probed(level, image, parts)
        update = products[:2]
        shift = np.minimum(np.maximum(shift + update, -2 * _MAX_SHIFT), 2 * _MAX_SHIFT)
        step = np.hypot(update[0], update[1])
        if np.count_nonzero(visible & (step < tolerance)) > enough:
            break
        parts[:, :, 2] = places + np.einsum("nij,jn->ni", local, shift)
    return shift.T, products[2], step


def _probed(level: PatchLevel, image: GreyArray, parts: _SingleArray) -> FloatArray:
    """Steps and correlations of the patches at some positions, float64[3, n]."""
    maps = (parts.reshape(-1, 3) @ _OFFSETS).reshape(-1, 2, _PIXELS)
    # Patches in view are off the border: no border mode is needed.
    resampled = cv2.remap(image, maps[:, 0], maps[:, 1], cv2.INTER_LINEAR)
    sampled = np.asarray(resampled, dtype=np.float32)
    mean = sampled @ _EVEN
    variance = np.einsum("np,np->n", sampled, sampled) / _PIXELS - mean * mean
    products = np.matmul(level.probes, sampled[:, :, np.newaxis])[:, :, 0]
    return np.asarray(products.T / np.sqrt(np.maximum(variance, 1e-6)), dtype=np.float64)


def _affine_parts(matrix: FloatArray, points: FloatArray) -> _SingleArray:
    """A homography's affine part at each of some points, float32[n, 2, 3]."""
    (a, b, _), (d, e, _), (g, h, _) = matrix.tolist()
    mapped = points @ matrix[:, :2].T
    mapped += matrix[:, 2]
    terms = np.empty((len(points), 5))
    weights = np.divide(1.0, mapped[:, 2:], out=terms[:, :1])
    places = np.multiply(mapped[:, :2], weights, out=terms[:, 3:])
    np.multiply(places, weights, out=terms[:, 1:3])
    factors = np.array(
        [
            [a, b, 0, d, e, 0],
            [-g, -h, 0, 0, 0, 0],
            [0, 0, 0, -g, -h, 0],
            [0, 0, 1, 0, 0, 0],
            [0, 0, 0, 0, 0, 1],
        ]
    )
    return np.asarray(terms @ factors, dtype=np.float32).reshape(-1, 2, 3)


def _inside(centres: FloatArray | _SingleArray, shape: Sequence[int]) -> MaskArray:
    """Patches inside an image of `shape`, by their centres there."""
    margin = RADIUS + 3
    middle = np.array([(shape[1] - 1) / 2, (shape[0] - 1) / 2], dtype=np.float32)
    apart = np.abs(centres - middle) < middle + (0.5 - margin)
    return np.asarray(apart[:, 0] & apart[:, 1], dtype=np.bool_)
