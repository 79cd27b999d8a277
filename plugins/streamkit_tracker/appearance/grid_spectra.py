"""Fourier transforms of small square grids as matrix products: no set-up, many channels at once."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from streamkit_kernels import product

Float32Array = NDArray[np.float32]
ComplexArray = NDArray[np.complex64]


def spectra_of(images: Float32Array) -> ComplexArray:
    """Two-dimensional transforms of real images.

    Args:
        images: float32[..., g, g], g even.

    Returns:
        complex64[..., g, g // 2 + 1], the half that is not the mirror image of the other, as of `rfft2`.
    """
    side = images.shape[-1]
    down, along, _ = _transforms(side)
    half = product(images.reshape(-1, side), along).view(np.complex64)
    return np.asarray(np.matmul(down, half.reshape(*images.shape[:-1], side // 2 + 1)))


def images_of(spectra: ComplexArray) -> Float32Array:
    """The real images float32[..., g, g] of spectra complex64[..., g, g // 2 + 1]."""
    side = spectra.shape[-2]
    down, _, back = _transforms(side)
    half = np.matmul(down.conj() / np.float32(side), spectra)
    images = product(half.view(np.float32).reshape(-1, side + 2), back)
    return images.reshape(*spectra.shape[:-1], side)


class Cutter:
    """Sets images to zero outside a rectangle, given their spectra.

    Only the rows that are kept are ever made; along these, to the image, the mask and back are one matrix.

    Args:
        down: bool[g], which rows are kept.
        along: bool[g], which columns.
    """

    def __init__(self, down: NDArray[np.bool_], along: NDArray[np.bool_]) -> None:
        transform, there, back = _transforms(len(down))
        self._rows = np.ascontiguousarray(transform[down].conj() / np.float32(len(down)))
        self._along = (back * along) @ there
        self._columns = np.ascontiguousarray(transform[:, down])

    def __call__(self, spectra: ComplexArray) -> ComplexArray:
        """Spectra complex64[n, g, g // 2 + 1] of the images that are cut."""
        half = np.matmul(self._rows, spectra)
        cut = product(half.view(np.float32).reshape(-1, len(self._along)), self._along)
        return np.asarray(np.matmul(self._columns, cut.view(np.complex64).reshape(half.shape)))


@cache
def _transforms(side: int) -> tuple[ComplexArray, Float32Array, Float32Array]:
    """The transform of columns, that of real rows to half spectra, and the way back from those.

    The first is complex64[g, g]. The others, float32[g, g + 2] and float32[g + 2, g], have the real and the
    imaginary parts of the half spectra side by side, as complex numbers lie in memory.
    """
    steps = np.arange(side)
    full = np.exp(-2j * np.pi * np.outer(steps, steps) / side)
    half = full[:, : side // 2 + 1]
    twice = np.full((side // 2 + 1, 1), 2.0)  # for the mirror image that is left out, which the ends have not
    twice[[0, -1]] = 1.0
    back = np.empty((side + 2, side))
    back[0::2], back[1::2] = twice * half.real.T / side, twice * half.imag.T / side
    along = np.ascontiguousarray(half).astype(np.complex64).view(np.float32)
    return full.astype(np.complex64), along, back.astype(np.float32)
