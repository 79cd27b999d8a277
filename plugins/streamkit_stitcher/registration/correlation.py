"""Cross-correlation of images, and shifts too large for optical flow, as between survey photographs."""

from typing import Any, Final

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from streamkit.geometry.homography import FloatArray, GreyArray, translation

_WIDTH: Final = 160
_MIN_SIDE: Final = 16
_FINE: Final = 1.0
_COARSE: Final = 4.0
_MIN_OVERLAP: Final = 0.15
_MIN_CORRELATION: Final = 0.2
_MIN_SHARED: Final = 1 / 12


def search_shift(earlier: GreyArray, current: GreyArray) -> FloatArray | None:
    """Estimates a shift by normalised cross-correlation of the overlap; None without a clear maximum.

    Finds shifts of up to four fifths of an image without much rotation, to a few pixels; a match must confirm
    them. Phase correlation, which wraps around, fails at a third. The result maps pixels of `current` to
    those of `earlier`, float64[3, 3].

    Source: Lewis, Fast normalized cross-correlation, 1995; Padfield, Masked object registration in the
    Fourier domain, IEEE TIP 2012, of textures whose mean is 0.
    """
    height, width = current.shape
    scale = min(1.0, _WIDTH / width)
    columns, rows = max(_MIN_SIDE, round(width * scale)), max(_MIN_SIDE, round(height * scale))
    small = [cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA) for image in (earlier, current)]
    x, y, correlation = texture_shift(*(band_pass(image, _FINE, _COARSE) for image in small))
    if not correlation > _MIN_CORRELATION:
        return None
    return translation(np.array([x * width / columns, y * height / rows]))


def texture_shift(first: FloatArray, second: FloatArray) -> tuple[int, int, float]:
    """The most significant shift between textures of mean 0, float[h, w], see `search_shift`.

    Returns:
        The shift from `second` to `first` in x and in y, px, and the correlation of their overlap.
    """
    rows, columns = first.shape
    overlap = np.multiply.outer(*(side - np.abs(np.arange(-side, side)) for side in first.shape))
    # The sum over what the second image covers under a shift is that of its own part under the opposite one.
    power = _overlap_sums(first**2) * _overlap_sums((second**2)[::-1, ::-1])
    correlation = _correlate(first, second) / np.sqrt(np.maximum(power, 1e-6))
    correlation[overlap < _MIN_OVERLAP * rows * columns] = 0.0
    # A small overlap correlates by chance: weigh the correlation by its significance.
    significance = correlation * np.sqrt(overlap)
    y, x = np.unravel_index(int(np.argmax(significance)), overlap.shape)
    return int(x) - columns, int(y) - rows, float(correlation[y, x])


def band_pass(grey: npt.NDArray[Any], fine: float, coarse: float) -> FloatArray:
    """An image without what is smaller or larger than Gaussians of these deviations, px, float64[h, w]."""
    smooth = cv2.GaussianBlur(grey.astype(np.float64), (0, 0), fine)
    return np.asarray(smooth - cv2.GaussianBlur(smooth, (0, 0), coarse))


def overlap_correlation(first: FloatArray, second: FloatArray, to_second: FloatArray) -> float:
    """Normalised correlation of two images, float64[h, w], over their overlap, -1 to 1.

    0 where less than a twelfth overlaps or one side is flat. `to_second` maps pixels of the first image to
    those of the second, float64[3, 3].
    """
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    moved = cv2.warpPerspective(second, to_second, first.shape[::-1], flags=flags, borderValue=float("nan"))
    shared = np.isfinite(moved)
    if np.count_nonzero(shared) < _MIN_SHARED * shared.size:
        return 0.0
    one, two = first[shared] - first[shared].mean(), moved[shared] - moved[shared].mean()
    power = float(np.sqrt((one**2).sum() * (two**2).sum()))
    return float((one * two).sum()) / power if power > 1e-9 else 0.0


def _overlap_sums(values: FloatArray) -> FloatArray:
    """Sums over the overlap with an image of the same size, laid out as by `_correlate`."""
    rows, columns = (np.arange(-size, size) for size in values.shape)
    height, width = values.shape
    sums = cv2.integral(values)
    down = sums[np.clip(rows + height, 0, height)] - sums[np.clip(rows, 0, height)]
    across = down[:, np.clip(columns + width, 0, width)] - down[:, np.clip(columns, 0, width)]
    return np.asarray(across, dtype=np.float64)


def _correlate(first: FloatArray, second: FloatArray) -> FloatArray:
    """Sums of products over the overlap, float64[2 h, 2 w]; element [h + y, w + x] is of a shift by x, y."""
    height, width = first.shape
    size = tuple(scipy.fft.next_fast_len(2 * side, real=True) for side in first.shape)
    product = scipy.fft.irfft2(scipy.fft.rfft2(first, size) * scipy.fft.rfft2(second, size).conj(), size)
    return np.asarray(np.roll(product, (height, width), (0, 1))[: 2 * height, : 2 * width], dtype=np.float64)
