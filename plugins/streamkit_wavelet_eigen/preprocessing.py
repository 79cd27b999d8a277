"""Steps 1 to 5 of the paper: wavelet-domain equalisation and denoising of target windows, in batches."""

from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.wavelet import FloatBatch, Subbands, decompose, reconstruct, transform_matrix

# The median of |x| of a normal variable is 0.6745 standard deviations.
MEDIAN_TO_SIGMA = 0.6745
# Pixels worked on at once: intermediate arrays stay in the cache, and memory does not grow with the batch.
CHUNK_PIXELS = 64 * 32 * 32
# The LL band of a constant patch varies by float32 rounding, up to about 1e-4.
CONSTANT_SPAN = 1e-3


class Mode(StrEnum):
    """How a window is prepared before it is made a vector."""

    PAPER = "paper"
    DENOISE = "denoise"
    RAW = "raw"


class Threshold(StrEnum):
    """How the soft threshold of the detail sub-bands is chosen."""

    VISU = "visu"
    BAYES = "bayes"
    NONE = "none"


@dataclass(frozen=True)
class Preprocessing:
    """What is done to a window before projection.

    Attributes:
        mode: `paper` all five steps; `denoise` transform, threshold and inverse only; `raw` nothing.
        threshold: rule for the detail sub-bands.
        wavelet: PyWavelets name of a discrete wavelet.
        approximation: how many times, after these steps, the window is replaced by its low-pass quarter LL;
            each halves the sides. 0 keeps the whole window.
    """

    mode: Mode = Mode.PAPER
    threshold: Threshold = Threshold.VISU
    wavelet: str = "db8"
    approximation: int = 0

    def check(self, patch_size: tuple[int, int]) -> None:
        """Raises ValueError when patches of this (height, width) cannot be prepared this way."""
        if self.approximation < 0:
            raise ValueError(f"preprocessing: approximation must be at least 0, got {self.approximation}")
        for side in patch_size:
            if self.mode is not Mode.RAW or self.approximation:
                transform_matrix(self.wavelet, side)
            for level in range(1, self.approximation):
                transform_matrix(self.wavelet, side >> level if side % (1 << level) == 0 else 1)

    def prepared_size(self, patch_size: tuple[int, int]) -> tuple[int, int]:
        """(height, width) of a prepared window of (height, width) `patch_size`."""
        height, width = patch_size
        return height >> self.approximation, width >> self.approximation


def prepare(patches: FloatBatch, how: Preprocessing) -> FloatBatch:
    """Prepares windows as the paper does, or leaves steps out.

    Args:
        patches: float32[n, h, w] in grey levels 0..255, all finite; h and w even unless the mode is `raw`.
        how: the steps.

    Returns:
        float32[n, h, w] in grey levels 0..255, with h and w halved `approximation` times; the given array
        itself where nothing is done. A constant window stays constant: there is nothing in it to equalise.

    Source: Zhang, Liu and Qu, section 2.3, steps 1 to 5. Step 2 equalises LL within the range it has, so that
        it keeps its scale against the details; the paper does not say how it treats that real-valued band.
    """
    if how.mode is Mode.RAW and not how.approximation:
        return patches
    count, height, width = patches.shape
    prepared = np.empty((count, *how.prepared_size((height, width))), np.float32)
    chunk = max(CHUNK_PIXELS // max(height * width, 1), 1)
    for first in range(0, count, chunk):
        part = patches[first : first + chunk]
        part = part if how.mode is Mode.RAW else _prepare_chunk(part, how)
        prepared[first : first + chunk] = _approximated(part, how)
    return prepared


def _prepare_chunk(patches: FloatBatch, how: Preprocessing) -> FloatBatch:
    bands = decompose(patches, how.wavelet)
    paper = how.mode is Mode.PAPER
    denoised = threshold_details(bands, how.threshold)
    if paper:
        denoised.ll[...] = equalise_own_range(bands.ll)
    restored = np.clip(reconstruct(denoised, how.wavelet), 0.0, 255.0)
    return equalise(restored) if paper else restored


def _approximated(patches: FloatBatch, how: Preprocessing) -> FloatBatch:
    """The low-pass quarter of the low-pass quarter ..., scaled back to grey levels."""
    for _ in range(how.approximation):
        height, width = patches.shape[1:]
        rows, columns = transform_matrix(how.wavelet, height), transform_matrix(how.wavelet, width)
        low: FloatBatch = rows[: height // 2] @ (patches @ columns[: width // 2].T)
        low *= np.float32(0.5)
        patches = low
    return patches


def equalise(patches: FloatBatch) -> FloatBatch:
    """Equalises the grey histogram of each patch: float32[n, h, w] in 0..255 to the same."""
    grey = np.rint(patches).astype(np.uint8)
    for patch in grey:
        cv2.equalizeHist(patch, dst=patch)
    return grey.astype(np.float32)


def equalise_own_range(bands: FloatBatch) -> FloatBatch:
    """Equalises each band within its own minimum and maximum: float32[n, h, w] to the same."""
    lowest = bands.min(axis=(1, 2), keepdims=True)
    span = bands.max(axis=(1, 2), keepdims=True) - lowest
    scale = np.divide(255.0, span, out=np.zeros_like(span), where=span > CONSTANT_SPAN)
    equalised: FloatBatch = equalise((bands - lowest) * scale) * (span / np.float32(255.0)) + lowest
    return equalised


def threshold_details(bands: Subbands, rule: Threshold) -> Subbands:
    """Softly thresholds LH, HL and HH of each patch against its own noise; LL stays as it is.

    The noise deviation is median(|HH|) / 0.6745. VisuShrink: sigma * sqrt(2 ln N) with N the pixels of the
    patch. BayesShrink: sigma squared over the deviation of the clean band, band by band.

    Returns:
        New sub-bands, which share nothing with the given ones.

    Source: Donoho and Johnstone, Ideal spatial adaptation by wavelet shrinkage, 1994; Chang, Yu and Vetterli,
        Adaptive wavelet thresholding, 2000.
    """
    if rule is Threshold.NONE or not bands.coefficients.size:
        return Subbands(bands.coefficients.copy())
    sigma = _noise_deviation(bands.hh)
    if rule is Threshold.VISU:
        shrunk = _shrunk_by_one_limit(bands.coefficients, sigma)
    else:
        limits = _bayes_limits(bands.quarters, sigma[:, None, None, None, None])
        # x - clip(x, -t, t) is the soft threshold, in two passes over the data instead of five.
        quarters = bands.quarters - np.clip(bands.quarters, -limits, limits)
        shrunk = Subbands(quarters.reshape(bands.coefficients.shape))
    shrunk.ll[...] = bands.ll
    return shrunk


def _shrunk_by_one_limit(coefficients: FloatBatch, sigma: NDArray[np.float32]) -> Subbands:
    """All coefficients of a patch against one limit: long rows run several times faster than quarters."""
    rows = coefficients.reshape(len(coefficients), -1)
    limits = (sigma * np.float32(np.sqrt(2.0 * np.log(rows.shape[1]))))[:, None]
    clipped = np.clip(rows, -limits, limits)
    np.subtract(rows, clipped, out=clipped)
    return Subbands(clipped.reshape(coefficients.shape))


def _noise_deviation(band: FloatBatch) -> NDArray[np.float32]:
    """Noise of each band, float32[n]. One partition takes a fraction of np.median's time."""
    magnitudes = np.abs(band).reshape(len(band), band.shape[1] * band.shape[2])
    middle = magnitudes.shape[1] // 2
    magnitudes.partition(middle, axis=1)
    upper = magnitudes[:, middle]
    lower = upper if magnitudes.shape[1] % 2 else magnitudes[:, :middle].max(axis=1)
    return np.asarray((lower + upper) / np.float32(2 * MEDIAN_TO_SIGMA), np.float32)


def _bayes_limits(coefficients: FloatBatch, sigma: NDArray[np.float32]) -> NDArray[np.float32]:
    """float32[n, 2, 1, 2, 1]; a band that holds no more than noise is removed whole."""
    noise = sigma * sigma
    power = np.mean(coefficients * coefficients, axis=(2, 4), keepdims=True)
    signal = np.sqrt(np.maximum(power - noise, 0.0))
    limits: NDArray[np.float32] = np.abs(coefficients).max(axis=(2, 4), keepdims=True)
    np.divide(noise, signal, out=limits, where=signal > 0)
    return limits
