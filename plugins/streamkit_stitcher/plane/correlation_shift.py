"""Camera shifts too large for optical flow, as between survey photographs, by cross-correlation."""

from dataclasses import replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, translation
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel
from streamkit_stitcher.registration.pairwise import PairwiseMotion, WorkingImage, register

_WIDTH: Final = 160
_SMALLEST_SIDE: Final = 16
_FINE: Final = 1.0
_COARSE: Final = 4.0
_MIN_OVERLAP: Final = 0.15
_MIN_CORRELATION: Final = 0.2
_Index = npt.NDArray[np.int64]


def search_shift(earlier: GreyArray, current: GreyArray, factor: int) -> FloatArray | None:
    """Estimates a shift by normalised cross-correlation of the overlap; None without a clear maximum.

    Finds shifts of up to four fifths of an image without much rotation, to a few pixels; a match must confirm
    them. Phase correlation, which wraps around, fails at a third. Both images are reduced by `factor`; the
    result maps full-size pixels of `current` to those of `earlier`.

    Source: Lewis, Fast normalized cross-correlation, 1995; Padfield, Masked object registration in the
    Fourier domain, IEEE TIP 2012, with rectangular masks.
    """
    height, width = current.shape
    scale = min(1.0, _WIDTH / width)
    size = max(_SMALLEST_SIDE, round(width * scale)), max(_SMALLEST_SIDE, round(height * scale))
    overlap, correlation = _correlation(_texture(earlier, size), _texture(current, size))
    # A small overlap correlates by chance: weigh the correlation by its significance.
    row, column = np.unravel_index(int(np.argmax(correlation * np.sqrt(overlap))), overlap.shape)
    if not correlation[row, column] > _MIN_CORRELATION:
        return None
    x, y = int(column) - size[0], int(row) - size[1]
    return translation(factor * np.array([x * width / size[0], y * height / size[1]]))


def motion_since(
    earlier: WorkingImage, current: WorkingImage, guess: FloatArray, limits: FitLimits, lost: int
) -> PairwiseMotion:
    """The motion since an earlier frame, searched by cross-correlation after a large shift.

    Args:
        earlier: the last registered frame.
        current: the frame.
        guess: predicted motion of full-size pixels, `current` to `earlier`.
        limits: what a motion must reach.
        lost: frames between the two.
    """
    reach = replace(limits, max_step=min(1.0, limits.max_step * (1 + lost)))
    motion = register(earlier, current, guess, reach)
    shift = None if motion.model is not None else search_shift(earlier.grey, current.grey, current.factor)
    if shift is None:
        return motion
    shifted = register(earlier, current, shift, replace(limits, max_step=1.0))
    return shifted if shifted.model is MotionModel.HOMOGRAPHY else motion


def _texture(grey: GreyArray, size: tuple[int, int]) -> FloatArray:
    """Band-pass filtered image at `size`, float64[h, w]."""
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), _FINE) - cv2.GaussianBlur(small, (0, 0), _COARSE))


def _correlation(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Overlap in pixels and normalised correlation for each shift of `second` on `first`.

    Returns:
        float64[2 h, 2 w] each; element [h + y, w + x] is of the shift by x, y; 0 for a small overlap.
    """
    height, width = first.shape
    wide = 2 * height, 2 * width
    product = np.fft.irfft2(np.fft.rfft2(first, wide) * np.fft.rfft2(second, wide).conj(), wide)
    product = np.fft.fftshift(product)
    # A shift of -h has no overlap; it only makes the sides even.
    y, x = np.arange(-height, height), np.arange(-width, width)
    rows = np.maximum(0, -y), np.minimum(height, height - y)
    columns = np.maximum(0, -x), np.minimum(width, width - x)
    overlap = (rows[1] - rows[0])[:, np.newaxis] * (columns[1] - columns[0]).astype(np.float64)
    count = np.maximum(overlap, 1.0)
    sums = []
    for texture, down, across in ((first, y, x), (second, 0 * y, 0 * x)):
        bounds = (rows[0] + down, rows[1] + down), (columns[0] + across, columns[1] + across)
        total, squares = _box_sums(texture, *bounds), _box_sums(texture**2, *bounds)
        sums.append((total, squares - total * total / count))
    power = np.sqrt(np.maximum(sums[0][1] * sums[1][1], 1e-12))
    correlation = (product - sums[0][0] * sums[1][0] / count) / power
    return overlap, np.where(overlap < _MIN_OVERLAP * height * width, 0.0, correlation)


def _box_sums(values: FloatArray, rows: tuple[_Index, _Index], columns: tuple[_Index, _Index]) -> FloatArray:
    """Sums over rows[0][i] to below rows[1][i] and columns[0][j] to below columns[1][j], float64[n, m]."""
    table = cv2.integral(values)
    bands = table[rows[1]] - table[rows[0]]
    return np.asarray(bands[:, columns[1]] - bands[:, columns[0]], dtype=np.float64)
