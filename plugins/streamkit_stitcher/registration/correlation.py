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
_LEAST_POWER: Final = 1e-6
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


def texture_shift(first: npt.NDArray[Any], second: npt.NDArray[Any]) -> tuple[int, int, float]:
    """The most significant shift between textures of mean 0, float[h, w], see `ShiftSearch`."""
    return ShiftSearch(first).shift_from(second)


class ShiftSearch:
    """Correlates a texture of mean 0 with others of its size, and keeps what that needs of its own.

    Args:
        texture: float[h, w].
    """

    def __init__(self, texture: npt.NDArray[Any]) -> None:
        self._shape = texture.shape
        self._size = tuple(scipy.fft.next_fast_len(2 * side, real=True) for side in texture.shape)
        self._spectrum, self._power = self._transformed(texture), _overlap_sums(texture)
        overlap = np.multiply.outer(*(side - np.abs(np.arange(-side, side)) for side in texture.shape))
        # A small overlap correlates by chance: weigh the correlation by its significance.
        is_large = overlap >= _MIN_OVERLAP * texture.size
        self._weights = np.where(is_large, np.sqrt(overlap), 0.0).astype(np.float32)

    def shift_from(self, other: npt.NDArray[Any]) -> tuple[int, int, float]:
        """The most significant shift, see `search_shift`.

        Args:
            other: float[h, w], of the same size.

        Returns:
            The shift from `other` to the texture in x and in y, px, and the correlation of their overlap.
        """
        product = scipy.fft.irfft2(self._spectrum * self._transformed(other).conj(), self._size)
        rows, columns = self._shape
        # The element [rows + y, columns + x] is of a shift by x, y.
        shifted = np.roll(product, (rows, columns), (0, 1))[: 2 * rows, : 2 * columns]
        # The sum over what the other covers under a shift is that of its own part under the opposite one.
        power = np.sqrt(np.maximum(self._power * _overlap_sums(other[::-1, ::-1]), _LEAST_POWER))
        significance = shifted * self._weights / power
        y, x = np.unravel_index(int(np.argmax(significance)), significance.shape)
        correlation = float(shifted[y, x] / power[y, x]) if self._weights[y, x] > 0 else 0.0
        return int(x) - columns, int(y) - rows, correlation

    def _transformed(self, texture: npt.NDArray[Any]) -> npt.NDArray[np.complex64]:
        return np.asarray(scipy.fft.rfft2(texture.astype(np.float32), self._size), np.complex64)


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


def _overlap_sums(texture: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Sums of the squares over the overlap with an image of the same size, for each shift."""
    sums = cv2.integral(np.square(texture, dtype=np.float64))
    down = np.concatenate([sums[:-1], sums[-1:] - sums[:-1]])
    across = np.concatenate([down[:, :-1], down[:, -1:] - down[:, :-1]], axis=1)
    return across.astype(np.float32)
