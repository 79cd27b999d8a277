"""Compares many windows of a frame with eigen templates."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import MAX_PRODUCT, compiled
from streamkit_tracker.appearance.eigen_template import DEVIATION_FLOOR
from streamkit_tracker.appearance.frame_crops import QuadArray
from streamkit_tracker.appearance.window_sampling import sample_window
from streamkit_tracker.window_geometry import Float32Array, FloatArray, IntArray

MAX_TOGETHER = 32  # patches that are compared at once


@compiled
def template_distances(
    quads: QuadArray,
    parts: IntArray,
    factor: int,
    windows: FloatArray,
    grid: Float32Array,
    rows: Float32Array,
    constants: Float32Array,
    results: FloatArray,
    first_patches: Float32Array,
) -> None:
    """Compares windows with eigen templates, as many at once as stay in the cache.

    Args:
        quads: int32[total], see `Crops`; they hold the windows, one part for each template.
        parts: int64[t, 5].
        factor: by how much the parts are averaged down.
        windows: float64[t, n, 5], n for each template.
        grid: float32[2, p], see `unit_grid`.
        rows: float32[t, k + 2, p], see `EigenTemplate.rows`.
        constants: float32[t, 2, k + 1], see `EigenTemplate.constants`.
        results: float64[t, n], is filled: mean squared residuals, 0 for a perfect match, about 2 for an
            unrelated patch.
        first_patches: float32[t, p], is filled: the first patch of each template, grey levels minus 128.
    """
    pixels, columns = grid.shape[1], rows.shape[1]
    together = max(1, min(MAX_PRODUCT // (columns * pixels), MAX_TOGETHER, windows.shape[1]))
    near, between = np.empty(pixels, np.int32), np.empty((2, pixels), np.float32)
    patches, products = np.empty((together, pixels), np.float32), np.empty((together, columns), np.float32)
    powers, moments = np.empty(together, np.float32), np.empty((3, together))
    for target in range(len(windows)):
        template = rows[target].T
        for start in range(0, windows.shape[1], together):
            count = min(together, windows.shape[1] - start)
            for index in range(count):
                window = windows[target, start + index]
                sample_window(quads, parts[target], factor, window, grid, near, between, patches[index])
            if start == 0:
                for pixel in range(pixels):
                    first_patches[target, pixel] = patches[0, pixel]
            np.dot(patches[:count], template, products[:count])
            for index in range(count):
                powers[index] = np.dot(patches[index], patches[index])
            sums, along_mean = constants[target]
            outside = results[target, start : start + count]
            find_residuals(products, powers, sums, along_mean, pixels, moments, outside)


@compiled
def find_residuals(
    products: Float32Array,
    powers: Float32Array,
    sums: Float32Array,
    along_mean: Float32Array,
    pixels: int,
    moments: FloatArray,
    residuals: FloatArray,
) -> None:
    """What of normalised patches lies outside an eigen space, mean squares; all patches side by side.

    Args:
        products: float32[n or more, k + 2], the patches times [basis, mean, 1].
        powers: float32[n or more], their sums of squares.
        sums: float32[k + 1], of basis and mean.
        along_mean: float32[k + 1], products of basis and mean with the mean.
        pixels: of a patch.
        moments: float64[3, n or more], is overwritten.
        residuals: float64[n], is filled.
    """
    known, count = products.shape[1] - 2, len(residuals)
    averages, deviations, along = moments
    for patch in range(count):
        average = products[patch, known + 1] / pixels
        variance = max(powers[patch] / pixels - average**2, 0.0)
        deviation = max(np.sqrt(variance), DEVIATION_FLOOR)
        like_mean = (products[patch, known] - average * sums[known]) / deviation
        residuals[patch] = pixels * variance / deviation**2 - 2 * like_mean + along_mean[known]
        averages[patch], deviations[patch] = average, deviation
    for component in range(known):
        total, middle = sums[component], along_mean[component]
        for patch in range(count):
            along[patch] = products[patch, component]
        for patch in range(count):
            share = (along[patch] - averages[patch] * total) / deviations[patch] - middle
            residuals[patch] -= share * share
    for patch in range(count):
        residuals[patch] = max(residuals[patch], 0.0) / pixels
