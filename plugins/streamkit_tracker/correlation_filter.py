"""Tells a target from the ground around it: a correlation filter over oriented gradients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from streamkit_tracker.constrained_filter import ConstrainedFilter
from streamkit_tracker.frame_crops import Float32Array
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray
from streamkit_tracker.window_sampling import WindowSampler, shrink_factor

ComplexArray = NDArray[np.complex64]

CELL = 3
GRID = 32
SAMPLES = CELL * GRID
DIRECTIONS = 8
CHANNELS = DIRECTIONS + 1
CONTRAST_FLOOR = 3.0
GREY_SHARE = 0.5
SIDELOBE = 5  # cells around the peak that do not count as ground


@dataclass(frozen=True)
class FilterSettings:
    """How a correlation filter sees and learns.

    Attributes:
        padding: ground around the target on both sides together, relative to the mean side of the target.
        peak_width: standard deviation of the wanted response, relative to the target's sides.
        regularisation: of the ridge regression, relative to the mean power of the first patch.
        learning_rate: weight of a new patch.
    """

    padding: float = 2.0
    peak_width: float = 0.08
    regularisation: float = 0.01
    learning_rate: float = 0.025


@dataclass(frozen=True, eq=False)
class Response:
    """What the filter found around a window.

    Attributes:
        position: x and y of the peak, px.
        sides: length and width of the window it was found with, px.
        angle: of that window, rad.
        peak: its height; about 1 for what was learnt.
        sharpness: peak to sidelobe ratio.
    """

    position: tuple[float, float]
    sides: tuple[float, float]
    angle: float
    peak: float
    sharpness: float


class CorrelationFilter:
    """A linear filter over gradient channels, trained against every shifted patch around the target.

    The ground around a target is what it has to be told from; a template that only knows the target cannot
    say which of two likely places is the better one. The patch is taken in the window's own turn and size,
    so that the filter needs neither. The place of the peak is taken from the mean of this filter's response
    and that of a `ConstrainedFilter`, which pays no heed to a ground that changes; its height and sharpness
    from this one alone, which wavers less.

    Source: Henriques, Caseiro, Martins and Batista, High-Speed Tracking with Kernelized Correlation Filters,
    TPAMI 2015; Danelljan, Haeger, Khan and Felsberg, Accurate Scale Estimation for Robust Visual Tracking,
    BMVC 2014 (running numerator and denominator).

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.
        settings: how it sees and learns.
    """

    def __init__(
        self, sampler: WindowSampler, window: FloatArray, settings: FilterSettings | None = None
    ) -> None:
        self._settings = settings or FilterSettings()
        side = float(np.sqrt(window[LENGTH] * window[WIDTH]))
        self._scale = 1 + self._settings.padding * side / window[LENGTH : WIDTH + 1]
        self._wanted = _wanted(self._settings.peak_width, float(self._scale[0]), float(self._scale[1]))
        spectrum = self._spectrum(sampler, window[None])[0]
        self._numerator = np.conj(self._wanted)[None] * spectrum
        self._denominator = np.sum(np.abs(spectrum) ** 2, axis=0)
        power = max(float(self._denominator.mean()), 1.0)  # a flat patch has none
        self._floor = self._settings.regularisation * power
        scale = (float(self._scale[0]), float(self._scale[1]))
        self._constrained = ConstrainedFilter(spectrum, self._wanted, scale)

    def respond(self, sampler: WindowSampler, windows: FloatArray, lead: float = 1.0) -> Response:
        """Where the target is, by the window with the highest answer.

        Args:
            sampler: has been shown the frame.
            windows: float64[n, 5] it may have moved from.
            lead: part of the highest answer that is enough for the first window.
        """
        spectra = self._spectrum(sampler, windows)
        transfer = np.conj(self._numerator) / (self._denominator + self._floor)
        plain = _answers(transfer, spectra)
        peaks = plain.max(axis=(1, 2))
        best = int(peaks.argmax())
        best = 0 if peaks[0] >= lead * peaks[best] else best
        constrained = _answers(self._constrained.transfer, spectra[best : best + 1])[0]
        return self._peak(0.5 * (plain[best] + constrained), plain[best], windows[best])

    def learn(self, sampler: WindowSampler, window: FloatArray) -> None:
        """Learns the patch at a window, float64[5]."""
        rate = self._settings.learning_rate
        spectrum = self._spectrum(sampler, window[None])[0]
        self._numerator += rate * (np.conj(self._wanted)[None] * spectrum - self._numerator)
        self._denominator += rate * (np.sum(np.abs(spectrum) ** 2, axis=0) - self._denominator)
        self._constrained.learn(spectrum)

    def _spectrum(self, sampler: WindowSampler, windows: FloatArray) -> ComplexArray:
        """complex64[n, channels, grid, grid // 2 + 1] of the region around each window."""
        wider = windows.copy()
        wider[:, LENGTH : WIDTH + 1] *= self._scale
        factor = shrink_factor(wider[0], (SAMPLES, SAMPLES), sampler.shape)
        patches = sampler.sample(wider, (SAMPLES, SAMPLES), factor)
        channels = gradient_channels(patches.reshape(-1, SAMPLES, SAMPLES))
        return np.asarray(scipy.fft.rfft2(channels, axes=(2, 3)), np.complex64)

    def _peak(self, response: Float32Array, plain: Float32Array, window: FloatArray) -> Response:
        row, column = np.unravel_index(int(np.argmax(response)), response.shape)
        down = _wrap(row + _parabola(response[:, column], int(row)))
        along = _wrap(column + _parabola(response[row], int(column)))
        step = window[LENGTH : WIDTH + 1] * self._scale / GRID
        cosine, sine = np.cos(window[ANGLE]), np.sin(window[ANGLE])
        dx, dy = along * step[0], down * step[1]
        position = (
            float(window[0] + dx * cosine - dy * sine),
            float(window[1] + dx * sine + dy * cosine),
        )
        sides = (float(window[LENGTH]), float(window[WIDTH]))
        row, column = np.unravel_index(int(np.argmax(plain)), plain.shape)
        peak, sharpness = float(plain[row, column]), _sharpness(plain, int(row), int(column))
        return Response(position, sides, float(window[ANGLE]), peak, sharpness)


def _answers(transfer: ComplexArray, spectra: ComplexArray) -> Float32Array:
    """float32[n, grid, grid] of a filter complex64[channels, ...] to n spectra."""
    spectrum = np.asarray((spectra * transfer).sum(axis=1), np.complex64)
    return np.asarray(scipy.fft.irfft2(spectrum, s=(GRID, GRID), axes=(1, 2)), np.float32)


def gradient_channels(patches: Float32Array) -> Float32Array:
    """Grey level and the gradient along eight directions, averaged over cells and free of light.

    Args:
        patches: float32[n, samples, samples].

    Returns:
        float32[n, channels, grid, grid], under a Hann window.

    Source: Dalal and Triggs, Histograms of Oriented Gradients, CVPR 2005 (here with rectified projections
    in place of binned angles, which need no arc tangent).
    """
    count = len(patches)
    # patches under each other are one picture to OpenCV; what their seams mix up, the Hann window hides
    column = patches.reshape(count * SAMPLES, SAMPLES)
    across = np.asarray(cv2.Sobel(column, cv2.CV_32F, 1, 0, ksize=1), np.float32)
    down = np.asarray(cv2.Sobel(column, cv2.CV_32F, 0, 1, ksize=1), np.float32)
    channels = np.empty((CHANNELS, count * GRID, GRID), np.float32)
    means = np.empty((DIRECTIONS // 2, count * GRID, GRID), np.float32)
    _cells(across, means[0])
    _cells(down, means[2])
    np.add(means[0], means[2], out=means[1])
    np.subtract(means[2], means[0], out=means[3])
    for index, along in enumerate((across, across + down, down, down - across)):
        _cells(cv2.threshold(along, 0, 0, cv2.THRESH_TOZERO)[1], channels[index])
    half = channels[: DIRECTIONS // 2]
    # the opposite directions need no pass of their own: a rectified mean is this one less the plain mean
    np.subtract(half, means, out=channels[DIRECTIONS // 2 : DIRECTIONS])
    gradients = channels[:DIRECTIONS]
    gradients[1::2] *= np.float32(np.sqrt(0.5))
    energy = cv2.blur(np.sqrt(np.einsum("cij,cij->ij", gradients, gradients)), (3, 3))
    gradients /= energy + CONTRAST_FLOOR
    _cells(column, channels[DIRECTIONS])
    result = np.ascontiguousarray(channels.reshape(CHANNELS, count, GRID, GRID).transpose(1, 0, 2, 3))
    result -= result.mean(axis=(2, 3), keepdims=True)
    grey = result[:, DIRECTIONS].reshape(count, -1)
    grey *= GREY_SHARE / np.maximum(np.sqrt(np.vecdot(grey, grey) / grey.shape[1]), CONTRAST_FLOOR)[:, None]
    result *= _hann()
    return result


def _cells(picture: cv2.typing.MatLike, out: Float32Array) -> None:
    """Means over cells: float32[n * samples, samples] to float32[n * grid, grid]."""
    cv2.resize(picture, (GRID, picture.shape[0] // CELL), dst=out, interpolation=cv2.INTER_AREA)


def _sharpness(response: Float32Array, row: int, column: int) -> float:
    """Peak to sidelobe ratio of a ring of values; 0 where all are alike.

    Source: Bolme, Beveridge, Draper and Lui, Visual Object Tracking using Adaptive Correlation Filters,
    CVPR 2010.
    """
    around = np.arange(-SIDELOBE, SIDELOBE + 1)
    lobe = response[np.ix_((row + around) % GRID, (column + around) % GRID)]
    number = response.size - lobe.size
    mean = float(response.sum() - lobe.sum()) / number
    power = float(np.vdot(response, response) - np.vdot(lobe, lobe)) / number
    deviation = float(np.sqrt(max(power - mean**2, 0.0)))
    return (float(response[row, column]) - mean) / max(deviation, 1e-6)


@cache
def _hann() -> Float32Array:
    window = np.hanning(GRID + 2)[1:-1].astype(np.float32)
    return np.outer(window, window)


def _wanted(width: float, scale_along: float, scale_across: float) -> ComplexArray:
    """Spectrum complex64[grid, grid // 2 + 1] of a Gaussian at no shift."""
    shifts = scipy.fft.fftfreq(GRID) * GRID
    along = np.exp(-0.5 * (shifts * scale_along / (width * GRID)) ** 2)
    across = np.exp(-0.5 * (shifts * scale_across / (width * GRID)) ** 2)
    return np.asarray(scipy.fft.rfft2(np.outer(across, along)), np.complex64)


def _parabola(values: Float32Array, index: int) -> float:
    """Where between the samples a peak at `index` lies, -0.5 to 0.5, on a ring of values."""
    before, at, after = (float(values[(index + k) % len(values)]) for k in (-1, 0, 1))
    curve = before - 2 * at + after
    return 0.0 if curve >= 0 else min(max(0.5 * (before - after) / curve, -0.5), 0.5)


def _wrap(shift: float) -> float:
    return (shift + GRID / 2) % GRID - GRID / 2
