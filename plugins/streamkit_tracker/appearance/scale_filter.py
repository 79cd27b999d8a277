"""A correlation filter over sizes: how much a target has grown."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from streamkit_tracker.appearance.gradient_histograms import CELL, gradient_channels
from streamkit_tracker.appearance.window_sampling import WindowSampler, shrink_factor
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, widened

SIZES = 17
STEP = 1.02
PEAK_WIDTH = 1.25  # steps
REGULARISATION = 0.01
LEARNING_RATE = 0.025
MAX_AREA = 512.0  # samples of a patch
COMMON_SHARE = np.float32(0.8)  # of the mean over the sizes that is taken off; what is left damps noise


class ScaleFilter:
    """Compares a target with itself at 17 sizes, 2 % apart.

    What is alike at all sizes says nothing of the size. Under the Hann window over the sizes it peaks at an
    unchanged size in every frame, so that the estimate would stay behind a target that grows or shrinks. Most
    of it is therefore taken off.

    Source: Danelljan, Haeger, Khan and Felsberg, Discriminative Scale Space Tracking, TPAMI 2017.

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        length, width = window[LENGTH : WIDTH + 1].tolist()
        shrink = min(1.0, math.sqrt(MAX_AREA / (length * width)))
        self._patch = (_cells(width * shrink), _cells(length * shrink))
        steps = np.arange(SIZES) - SIZES // 2
        self._factors = STEP ** steps.astype(np.float64)
        self._hann = np.hanning(SIZES + 2)[1:-1].astype(np.float32)
        peak = np.exp(-0.5 * (steps / PEAK_WIDTH) ** 2)
        self._wanted = np.fft.rfft(np.fft.ifftshift(peak)).conj()[:, None]
        spectra = self._read(sampler, window)
        self._numerator = self._wanted * spectra
        self._denominator = np.sum(np.abs(spectra) ** 2, axis=1)

    def growth(self, sampler: WindowSampler, window: FloatArray) -> float:
        """By what factor the target differs in size from a window at its position."""
        both = np.sum(self._numerator.conj() * self._read(sampler, window), axis=1)
        response = np.fft.fftshift(np.fft.irfft(both / (self._denominator + REGULARISATION), SIZES))
        best = int(response.argmax())
        steps = float(best - SIZES // 2)
        if 0 < best < SIZES - 1:
            steps += parabola_peak(*response[best - 1 : best + 2].tolist())
        return float(STEP**steps)

    def learn(self, sampler: WindowSampler, window: FloatArray, share: float) -> None:
        """Learns a window, as far as `share` says, above 0 to 1."""
        spectra, rate = self._read(sampler, window), share * LEARNING_RATE
        self._numerator = self._numerator + rate * (self._wanted * spectra - self._numerator)
        power = np.sum(np.abs(spectra) ** 2, axis=1)
        self._denominator = self._denominator + rate * (power - self._denominator)

    def _read(self, sampler: WindowSampler, window: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[Any]]:
        """Spectra complex[sizes // 2 + 1, features] over the sizes of a window."""
        windows = widened(np.repeat(window[None], SIZES, axis=0), self._factors[:, None])
        factor = shrink_factor(window, self._patch, sampler.shape)
        patches = sampler.sample(windows, self._patch, factor).reshape(SIZES, *self._patch)
        features = gradient_channels(patches).reshape(SIZES, -1)
        features -= COMMON_SHARE * features.mean(axis=0)
        return np.fft.rfft(np.fft.ifftshift(features * self._hann[:, None], axes=0), axis=0)


def parabola_peak(before: float, at: float, after: float) -> float:
    """Where between three samples the peak lies, -0.5 to 0.5."""
    curve = before - 2 * at + after
    return 0.0 if curve >= 0 else min(max(0.5 * (before - after) / curve, -0.5), 0.5)


def _cells(side: float) -> int:
    """Samples along a side: whole cells, two at least."""
    return CELL * max(2, round(side / CELL))
