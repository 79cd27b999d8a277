"""One-level wavelet transform of a batch of patches, as two matrix products.

For an even length, the periodized transform of a signal is multiplication by a square matrix W, so a patch
becomes `W_h @ x @ W_w.T`: one BLAS call for a whole batch instead of a loop of filters. For an orthogonal
wavelet W is orthogonal, and the patch comes back as `W_h.T @ y @ W_w`.
"""

from functools import lru_cache
from typing import TypeAlias

import numpy as np
import pywt
from numpy.typing import NDArray

FloatBatch: TypeAlias = NDArray[np.float32]


@lru_cache(maxsize=32)
def transform_matrix(wavelet: str, length: int) -> FloatBatch:
    """The matrix of the periodized one-level transform of `length` samples.

    Args:
        wavelet: PyWavelets name of a discrete wavelet, e.g. `db8`.
        length: number of samples, even and at least 2.

    Returns:
        float32[length, length], read-only; the upper half of the rows gives the low-pass coefficients.

    Raises:
        ValueError: there is no such discrete wavelet, or the length is odd or below 2.

    Source: Mallat, A Wavelet Tour of Signal Processing, section 7.3 (periodic filter banks).
    """
    return _read_only(_exact_matrix(wavelet, length))


@lru_cache(maxsize=32)
def inverse_matrix(wavelet: str, length: int) -> FloatBatch:
    """The inverse of `transform_matrix`, float32[length, length], read-only.

    It is computed, as the filters in PyWavelets are not all exact: those of dmey are off by a grey level.

    Raises:
        ValueError: as `transform_matrix`.
    """
    return _read_only(np.linalg.inv(_exact_matrix(wavelet, length)))


def _exact_matrix(wavelet: str, length: int) -> NDArray[np.float64]:
    if length < 2 or length % 2:
        raise ValueError(f"wavelet transform: a side must be even and at least 2, got {length}; use 32 or 64")
    if wavelet not in pywt.wavelist(kind="discrete"):
        raise ValueError(
            f'wavelet transform: no discrete wavelet "{wavelet}"; use e.g. db8, haar, sym4, coif2, bior2.2'
        )
    return np.vstack(pywt.dwt(np.eye(length), wavelet, mode="periodization", axis=0))


def _read_only(matrix: NDArray[np.floating]) -> FloatBatch:
    result = np.ascontiguousarray(matrix, np.float32)
    result.setflags(write=False)
    return result


def decompose(patches: FloatBatch, wavelet: str = "db8") -> FloatBatch:
    """The sub-bands float32[n, 2, h / 2, 2, w / 2] of patches float32[n, h, w].

    The second axis is low or high along y, the fourth along x. LL is `[:, 0, :, 0]`, and reaches 2 times the
    grey level. Texts disagree on which mixed band is LH: here the first letter is the filter along x, so that
    LH, `[:, 1, :, 0]`, is PyWavelets' cH (horizontal edges).

    Raises:
        ValueError: as `transform_matrix`.
    """
    count, height, width = patches.shape
    rows, columns = transform_matrix(wavelet, height), transform_matrix(wavelet, width)
    return np.asarray(rows @ (patches @ columns.T)).reshape(count, 2, height // 2, 2, width // 2)


def reconstruct(bands: FloatBatch, wavelet: str = "db8") -> FloatBatch:
    """Inverse of `decompose`: float32[n, h, w]."""
    count, height, width = len(bands), 2 * bands.shape[2], 2 * bands.shape[4]
    rows, columns = inverse_matrix(wavelet, height), inverse_matrix(wavelet, width)
    return np.asarray(rows @ (bands.reshape(count, height, width) @ columns.T))
