"""One-level wavelet transform of a batch of patches, as two matrix products.

For an even length, the periodized transform of a signal is multiplication by a square matrix W, so a patch
becomes `W_h @ x @ W_w.T`: one BLAS call for a whole batch instead of a loop of filters. For an orthogonal
wavelet W is orthogonal, and the patch comes back as `W_h.T @ y @ W_w`.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pywt
from numpy.typing import NDArray

FloatBatch: TypeAlias = NDArray[np.float32]

# Largest element of W W^T - I; the filters of orthogonal wavelets are tabled to about 1e-11.
ORTHOGONALITY_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class Subbands:
    """The four quarters of a one-level transform, views of one array.

    PyWavelets calls them cA, cH, cV, cD; texts disagree on which mixed band is LH, so the names here say it
    out: the first letter is the filter along x (columns), the second along y (rows).

    Attributes:
        coefficients: float32[n, h, w]: LL top left, HL top right, LH bottom left, HH bottom right.
    """

    coefficients: FloatBatch

    @property
    def quarters(self) -> FloatBatch:
        """float32[n, 2, h / 2, 2, w / 2], view: patch, low or high in y, y, low or high in x, x."""
        count, height, width = self.coefficients.shape
        return self.coefficients.reshape(count, 2, height // 2, 2, width // 2)

    @property
    def ll(self) -> FloatBatch:
        """Low-pass in x and y, float32[n, h / 2, w / 2]; values reach 2 times the grey level."""
        return self.quarters[:, 0, :, 0]

    @property
    def lh(self) -> FloatBatch:
        """Low-pass in x, high-pass in y: horizontal edges (PyWavelets' cH)."""
        return self.quarters[:, 1, :, 0]

    @property
    def hl(self) -> FloatBatch:
        """High-pass in x, low-pass in y: vertical edges (PyWavelets' cV)."""
        return self.quarters[:, 0, :, 1]

    @property
    def hh(self) -> FloatBatch:
        """High-pass in both: diagonal detail and noise (PyWavelets' cD)."""
        return self.quarters[:, 1, :, 1]


@lru_cache(maxsize=32)
def transform_matrix(wavelet: str, length: int) -> FloatBatch:
    """Returns the matrix of the periodized one-level transform of `length` samples.

    Args:
        wavelet: PyWavelets name of a discrete wavelet, e.g. `db8`.
        length: number of samples, even and at least 2.

    Returns:
        float32[length, length], read-only; the upper half of the rows gives the low-pass coefficients.

    Raises:
        ValueError: there is no such discrete wavelet, or the length is odd or below 2.

    Source: Mallat, A Wavelet Tour of Signal Processing, section 7.3 (periodic filter banks).
    """
    return _frozen(_exact_matrix(wavelet, length))


@lru_cache(maxsize=32)
def inverse_matrix(wavelet: str, length: int) -> FloatBatch:
    """Returns the inverse of `transform_matrix`, float32[length, length], read-only.

    For an orthogonal wavelet it is the transpose. For a biorthogonal one it is the inverse, the matrix of the
    dual filters; for dmey too, whose truncated filters in PyWavelets miss the picture by a grey level.

    Raises:
        ValueError: as `transform_matrix`.
    """
    matrix = _exact_matrix(wavelet, length)
    defect = float(np.abs(matrix @ matrix.T - np.eye(length)).max())
    return _frozen(matrix.T if defect < ORTHOGONALITY_LIMIT else np.linalg.inv(matrix))


def _exact_matrix(wavelet: str, length: int) -> NDArray[np.float64]:
    if length < 2 or length % 2:
        raise ValueError(f"wavelet transform: a side must be even and at least 2, got {length}; use 32 or 64")
    if wavelet not in pywt.wavelist(kind="discrete"):
        raise ValueError(
            f'wavelet transform: no discrete wavelet "{wavelet}"; use e.g. db8, haar, sym4, coif2, bior2.2'
        )
    low, high = pywt.dwt(np.eye(length), wavelet, mode="periodization", axis=0)
    matrix: NDArray[np.float64] = np.vstack([low, high])
    return matrix


def _frozen(matrix: NDArray[np.floating]) -> FloatBatch:
    result = np.ascontiguousarray(matrix, np.float32)
    result.setflags(write=False)
    return result


def decompose(patches: FloatBatch, wavelet: str = "db8") -> Subbands:
    """Splits patches into their four sub-bands (periodized border, no growth).

    Args:
        patches: float32[n, h, w], h and w even.
        wavelet: PyWavelets name of a discrete wavelet.

    Returns:
        The sub-bands, in one new array.

    Raises:
        ValueError: a side is odd, or there is no such wavelet.
    """
    height, width = patches.shape[1:]
    rows, columns = transform_matrix(wavelet, height), transform_matrix(wavelet, width)
    return Subbands(rows @ (patches @ columns.T))


def reconstruct(subbands: Subbands, wavelet: str = "db8") -> FloatBatch:
    """Inverse of `decompose`: float32[n, h, w]."""
    height, width = subbands.coefficients.shape[1:]
    rows, columns = inverse_matrix(wavelet, height), inverse_matrix(wavelet, width)
    result: FloatBatch = rows @ (subbands.coefficients @ columns.T)
    return result
