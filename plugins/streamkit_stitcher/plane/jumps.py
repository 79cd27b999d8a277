"""Steps of the camera too wide to be followed, as between the photographs of a survey."""

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray, translation

_WIDTH: Final = 160
_SMALLEST_SIDE: Final = 16
_FINE: Final = 1.0
_COARSE: Final = 4.0
_LEAST_SHARED: Final = 0.15
_LEAST_CORRELATION: Final = 0.2


def jump(earlier: GreyArray, current: GreyArray, factor: int) -> FloatArray | None:
    """Guesses how far the camera went, by the correlation of the ground that the pictures would share.

    It finds steps of up to four fifths of a picture where the camera hardly turned, good to a few pixels;
    whether they are true only a match can tell. Phase correlation, which wraps around, gives up at a third.

    Args:
        earlier: uint8[h, w], reduced by `factor`.
        current: uint8[h, w], the same.
        factor: the reduction.

    Returns:
        float64[3, 3], the shift of full-size pixels of `current` to those of `earlier`; None where no shift
        stands out.

    Source: Lewis, Fast normalized cross-correlation, 1995; Padfield, Masked object registration in the
    Fourier domain, IEEE TIP 2012, whose masks are rectangles here.
    """
    height, width = current.shape
    scale = min(1.0, _WIDTH / width)
    size = max(_SMALLEST_SIDE, round(width * scale)), max(_SMALLEST_SIDE, round(height * scale))
    first, second = _texture(earlier, size), _texture(current, size)
    shared, correlation = _correlation(first, second)
    # A small overlap correlates by chance: what counts is how far beyond chance it is.
    row, column = np.unravel_index(int(np.argmax(correlation * np.sqrt(shared))), shared.shape)
    if not correlation[row, column] > _LEAST_CORRELATION:
        return None
    across, down = int(column) - size[0], int(row) - size[1]
    return translation(factor * np.array([across * width / size[0], down * height / size[1]]))


def _texture(grey: GreyArray, size: tuple[int, int]) -> FloatArray:
    """A picture reduced to `size`, without its light and shade, float64[h, w]."""
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), _FINE) - cv2.GaussianBlur(small, (0, 0), _COARSE))


def _correlation(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shared pixels and normalised correlation of each shift of `second` on `first`.

    Returns:
        float64[2 h, 2 w] each; element [h + y, w + x] is of the shift by x, y; 0 where too little is shared.
    """
    height, width = first.shape
    wide = 2 * height, 2 * width
    product = np.fft.irfft2(np.fft.rfft2(first, wide) * np.fft.rfft2(second, wide).conj(), wide)
    product = np.fft.fftshift(product)
    down, across = np.arange(-height, height), np.arange(-width, width)
    # A shift of -h shares no row; it only makes the sides even.
    rows, columns = (
        (np.maximum(0, -down), np.minimum(height, height - down)),
        (
            np.maximum(0, -across),
            np.minimum(width, width - across),
        ),
    )
    shared = (rows[1] - rows[0])[:, np.newaxis] * (columns[1] - columns[0]).astype(np.float64)
    count = np.maximum(shared, 1.0)
    sums = []
    for texture, y, x in ((first, down, across), (second, np.zeros_like(down), np.zeros_like(across))):
        bounds = (rows[0] + y, rows[1] + y), (columns[0] + x, columns[1] + x)
        total, squares = _box_sums(texture, *bounds), _box_sums(texture**2, *bounds)
        sums.append((total, squares - total * total / count))
    power = np.sqrt(np.maximum(sums[0][1] * sums[1][1], 1e-12))
    correlation = (product - sums[0][0] * sums[1][0] / count) / power
    return shared, np.where(shared < _LEAST_SHARED * height * width, 0.0, correlation)


def _box_sums(
    values: FloatArray,
    rows: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]],
    columns: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]],
) -> FloatArray:
    """Sums over rows[0][i] to below rows[1][i] and columns[0][j] to below columns[1][j], float64[n, m]."""
    table = cv2.integral(values)
    bands = table[rows[1]] - table[rows[0]]
    return np.asarray(bands[:, columns[1]] - bands[:, columns[0]], dtype=np.float64)
