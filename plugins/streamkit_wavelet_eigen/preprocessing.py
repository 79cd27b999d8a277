"""Steps 1 to 5 of the paper: wavelet-domain equalisation and denoising of target windows, in batches."""

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_wavelet_eigen.recipe import Mode, Preprocessing, Threshold
from streamkit_wavelet_eigen.wavelet import FloatBatch, decompose, reconstruct

# Pixels per chunk: intermediate arrays fit the cache, and memory does not grow with the batch.
CHUNK_PIXELS = 64 * 32 * 32
MAX_LEVEL = np.float32(255.0)
# The LL band of a constant patch varies by float32 rounding, up to about 1e-4.
CONSTANT_SPAN = np.float32(1e-3)
# The median of |x| of a normal variable is 0.6745 standard deviations.
MEDIAN_TO_SIGMA = np.float32(0.6745)


def prepare(patches: FloatBatch, how: Preprocessing) -> FloatBatch:
    """Preprocesses windows.

    Args:
        patches: float32[n, h, w] in grey levels 0..255, all finite; h and w even unless the mode is `raw`.
        how: the steps.

    Returns:
        float32[n, h, w] in grey levels 0..255, h and w halved `approximation` times; the given array itself
        where there is no step. A constant window stays constant.

    Source: Zhang, Liu and Qu, section 2.3, steps 1 to 5. Step 2 equalises LL within its own range, so that it
        keeps its scale against the details; the paper does not say how it treats that real-valued band.
    """
    if how.mode is Mode.RAW and not how.approximation:
        return patches
    count, height, width = patches.shape
    prepared = np.empty((count, height >> how.approximation, width >> how.approximation), np.float32)
    chunk = max(CHUNK_PIXELS // max(height * width, 1), 1)
    for first in range(0, count, chunk):
        part = patches[first : first + chunk]
        if how.mode is not Mode.RAW:
            bands = decompose(part, how.wavelet)
            denoised = threshold_details(bands, how.threshold)
            if how.mode is Mode.PAPER:
                denoised[:, 0, :, 0] = equalised_in_own_range(bands[:, 0, :, 0])
            part = reconstruct(denoised, how.wavelet)
            part = equalised(part) if how.mode is Mode.PAPER else np.clip(part, 0.0, 255.0)
        for _ in range(how.approximation):
            # The LL band, scaled back to grey levels.
            part = np.float32(0.5) * decompose(part, how.wavelet)[:, 0, :, 0]
        prepared[first : first + chunk] = part
    return prepared


def equalised(patches: FloatBatch) -> FloatBatch:
    """Patches float32[n, h, w] with equal grey histograms; levels are rounded, and clipped to 0..255."""
    levels = np.clip(np.rint(patches), 0, MAX_LEVEL).astype(np.uint8)
    for level in levels:
        cv2.equalizeHist(level, level)
    return levels.astype(np.float32)


def equalised_in_own_range(bands: FloatBatch) -> FloatBatch:
    """Bands float32[n, h, w], each equalised within its own minimum and maximum."""
    bands = np.ascontiguousarray(bands)
    lowest = bands.min(axis=(1, 2), keepdims=True)
    span = bands.max(axis=(1, 2), keepdims=True) - lowest
    scale = np.zeros_like(span)
    np.divide(MAX_LEVEL, span, out=scale, where=span > CONSTANT_SPAN)
    levels = equalised((bands - lowest) * scale)
    levels *= span / MAX_LEVEL
    levels += lowest
    return levels


def threshold_details(bands: FloatBatch, rule: Threshold) -> FloatBatch:
    """Soft threshold of LH, HL and HH of each patch against its own noise; LL stays unchanged.

    The noise deviation sigma is median(|HH|) / 0.6745. VisuShrink: sigma * sqrt(2 ln N), N the pixels of the
    patch. BayesShrink: sigma squared over the deviation of the noise-free band, for each band.

    Args:
        bands: of `decompose`.
        rule: which of them.

    Returns:
        New sub-bands.

    Source: Donoho and Johnstone, Ideal spatial adaptation by wavelet shrinkage, 1994; Chang, Yu and Vetterli,
        Adaptive wavelet thresholding, 2000.
    """
    if rule is Threshold.NONE or not bands.size:
        return bands.copy()
    # np.median takes ten times as long as sorting, and np.clip twice as long as minimum and maximum
    levels = np.sort(np.abs(bands[:, 1, :, 1]).reshape(len(bands), -1), axis=1)
    last = levels.shape[1] - 1
    median = (levels[:, last // 2] + levels[:, (last + 1) // 2]) / 2
    sigma = (median / MEDIAN_TO_SIGMA)[:, None, None, None, None]
    if rule is Threshold.VISU:
        limits = sigma * np.float32(np.sqrt(2.0 * np.log(bands[0].size)))
    else:
        limits = _bayes_limits(bands, sigma)
    # x - clip(x, -t, t) is the soft threshold, in three passes over the data instead of five.
    shrunk: FloatBatch = bands - np.maximum(np.minimum(bands, limits), -limits)
    shrunk[:, 0, :, 0] = bands[:, 0, :, 0]
    return shrunk


def _bayes_limits(bands: FloatBatch, sigma: NDArray[np.float32]) -> NDArray[np.float32]:
    """float32[n, 2, 1, 2, 1]; the limit of a band of noise alone removes all of it."""
    noise = sigma * sigma
    power = np.mean(bands * bands, axis=(2, 4), keepdims=True)
    signal = np.sqrt(np.maximum(power - noise, 0.0))
    limits: NDArray[np.float32] = np.abs(bands).max(axis=(2, 4), keepdims=True)
    np.divide(noise, signal, out=limits, where=signal > 0)
    return limits
