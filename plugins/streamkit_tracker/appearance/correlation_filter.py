"""Correlation filter over oriented gradients: discriminates a target from the background around it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.appearance.constrained_filter import ConstrainedFilter
from streamkit_tracker.appearance.frame_crops import Float32Array
from streamkit_tracker.appearance.gradient_channels import GRID, SAMPLES, gradient_channels
from streamkit_tracker.appearance.grid_spectra import ComplexArray, images_of, spectra_of
from streamkit_tracker.appearance.level_histogram import LEARNING_RATE as LEVEL_RATE
from streamkit_tracker.appearance.level_histogram import LevelHistogram, LevelMap
from streamkit_tracker.appearance.window_sampling import WindowSampler, shrink_factor
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, FloatArray

LEVEL_SHARE = 0.3  # of the place, that grey levels decide
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
        peak: its height; about 1 for what was learnt, less where the grey levels are not the target's.
        sharpness: peak to sidelobe ratio.
        heights: of the responses at all the windows that were asked at.
    """

    position: tuple[float, float]
    sides: tuple[float, float]
    angle: float
    peak: float
    sharpness: float
    heights: tuple[float, ...] = ()


class CorrelationFilter:
    """A linear filter over gradient channels, trained against every shifted patch around the target.

    A template that only knows the target cannot say which of two likely positions is the better one; this
    filter also learns the background. The patch is taken in the window's own turn and size,
    so that the filter needs neither. The place of the peak is taken from the mean of this filter's response
    and that of a `ConstrainedFilter`, which ignores a background that changes, and that of a
    `LevelHistogram`, which ignores a target that bends; its height and sharpness from this one alone,
    which varies less.

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
        patches, spectra = self._read(sampler, window[None])
        spectrum = spectra[0]
        self._numerator = np.zeros_like(spectrum)
        self._denominator = np.zeros(spectrum.shape[1:], np.float32)
        _follow(self._numerator, self._denominator, self._wanted, spectrum, 1.0)
        power = max(float(self._denominator.mean()), 1.0)  # a flat patch has none
        self._floor = self._settings.regularisation * power
        scale = (float(self._scale[0]), float(self._scale[1]))
        self._constrained = ConstrainedFilter(spectrum, self._wanted, scale)
        self._levels = LevelHistogram(patches[0], scale)

    def respond(
        self, sampler: WindowSampler, windows: FloatArray, lead: float = 1.0, *, apart: bool = False
    ) -> Response:
        """Position of the target, by the window with the highest response.

        Args:
            sampler: has been shown the frame.
            windows: float64[n, 5] it may have moved from.
            lead: part of the highest response that is enough for the first window.
            apart: whether the windows are different places; then grey levels help to choose among them, which
                would favour the smaller of two sizes.
        """
        patches, spectra = self._read(sampler, windows)
        responses = np.empty((len(windows), *spectra.shape[2:]), np.complex64)
        _respond(self._numerator, self._denominator, self._floor, spectra, responses)
        plain = images_of(responses)
        if apart:
            pairs = zip(plain, patches, strict=True)
            peaks = np.array([_mixed(each, self._levels.respond(patch)).max() for each, patch in pairs])
        else:
            peaks = plain.max(axis=(1, 2))
        best = int(peaks.argmax())
        best = 0 if peaks[0] >= lead * peaks[best] else best
        constrained = images_of(self._constrained.respond(spectra[best]))
        both = np.float32(0.5) * (plain[best] + constrained)
        found = self._peak(both, plain[best], self._levels.respond(patches[best]), windows[best])
        return replace(found, heights=tuple(peaks.tolist()))

    def learn(self, sampler: WindowSampler, window: FloatArray, share: float = 1.0) -> None:
        """Learns the patch at a window, float64[5]; `share`, above 0 to 1, is how far it is believed."""
        patches, spectra = self._read(sampler, window[None])
        self._levels.learn(patches[0], share * LEVEL_RATE)
        rate = share * self._settings.learning_rate
        _follow(self._numerator, self._denominator, self._wanted, spectra[0], rate)
        self._constrained.learn(spectra[0], share)

    def _read(self, sampler: WindowSampler, windows: FloatArray) -> tuple[Float32Array, ComplexArray]:
        """The regions around windows: their samples, which the next call overwrites, and their spectra.

        Returns:
            float32[n, samples * samples] and complex64[n, channels, grid, grid // 2 + 1].
        """
        wider = windows.copy()
        wider[:, LENGTH : WIDTH + 1] *= self._scale
        factor = shrink_factor(wider[0], (SAMPLES, SAMPLES), sampler.shape)
        patches = sampler.sample(wider, (SAMPLES, SAMPLES), factor)
        return patches, spectra_of(gradient_channels(patches.reshape(-1, SAMPLES, SAMPLES)))

    def _peak(
        self, response: Float32Array, plain: Float32Array, levels: LevelMap, window: FloatArray
    ) -> Response:
        row, column, down, along = _highest(_mixed(response, levels))
        relative_share = levels.relative_share(row, column)
        step = window[LENGTH : WIDTH + 1] * self._scale / GRID
        cosine, sine = np.cos(window[ANGLE]), np.sin(window[ANGLE])
        dx, dy = along * step[0], down * step[1]
        position = (
            float(window[0] + dx * cosine - dy * sine),
            float(window[1] + dx * sine + dy * cosine),
        )
        sides = (float(window[LENGTH]), float(window[WIDTH]))
        row, column, _, _ = _highest(plain)
        sharpness = _sharpness(plain, row, column)
        return Response(
            position, sides, float(window[ANGLE]), relative_share * float(plain[row, column]), sharpness
        )


def _mixed(response: Float32Array, levels: LevelMap) -> Float32Array:
    """A response with what the grey levels say, as far as these are trusted."""
    share = np.float32(LEVEL_SHARE * levels.trust)
    return (np.float32(1) - share) * response + share * levels.shares


def _wanted(width: float, scale_along: float, scale_across: float) -> ComplexArray:
    """Spectrum complex64[grid, grid // 2 + 1] of a Gaussian at no shift."""
    shifts = np.roll(np.arange(GRID) - GRID // 2, GRID // 2)
    along = np.exp(-0.5 * (shifts * scale_along / (width * GRID)) ** 2)
    across = np.exp(-0.5 * (shifts * scale_across / (width * GRID)) ** 2)
    return spectra_of(np.outer(across, along).astype(np.float32))


@compiled
def _follow(
    numerator: ComplexArray,
    denominator: Float32Array,
    wanted: ComplexArray,
    spectrum: ComplexArray,
    rate: float,
) -> None:
    """Moves numerator and denominator towards those of a patch, a part of the way."""
    part, kept = np.float32(rate), np.float32(1 - rate)
    for row in range(wanted.shape[0]):
        for column in range(wanted.shape[1]):
            denominator[row, column] *= kept
    for channel in range(len(spectrum)):
        for row in range(wanted.shape[0]):
            for column in range(wanted.shape[1]):
                value = spectrum[channel, row, column]
                old = numerator[channel, row, column]
                numerator[channel, row, column] = kept * old + part * (
                    wanted[row, column].conjugate() * value
                )
                denominator[row, column] += part * (value.real * value.real + value.imag * value.imag)


@compiled
def _respond(
    numerator: ComplexArray,
    denominator: Float32Array,
    floor: float,
    spectra: ComplexArray,
    responses: ComplexArray,
) -> None:
    """Spectra complex64[n, grid, grid // 2 + 1] of the responses to n patches."""
    responses[:] = 0
    for patch in range(len(spectra)):
        for channel in range(len(numerator)):
            for row in range(numerator.shape[1]):
                for column in range(numerator.shape[2]):
                    weight = numerator[channel, row, column].conjugate()
                    responses[patch, row, column] += weight * spectra[patch, channel, row, column]
        for row in range(numerator.shape[1]):
            for column in range(numerator.shape[2]):
                responses[patch, row, column] *= np.float32(1) / (
                    denominator[row, column] + np.float32(floor)
                )


@compiled
def _highest(response: Float32Array) -> tuple[int, int, float, float]:
    """Row and column of the peak on a ring of values, and its place, to parts of a cell from the middle."""
    row, column = divmod(int(np.argmax(response)), GRID)
    at, below, right = response[row, column], (row + 1) % GRID, (column + 1) % GRID
    down = row + _parabola(response[row - 1, column], at, response[below, column])
    along = column + _parabola(response[row, column - 1], at, response[row, right])
    half = GRID / 2
    return row, column, (down + half) % GRID - half, (along + half) % GRID - half


@compiled
def _parabola(before: float, at: float, after: float) -> float:
    """Where between the samples a peak lies, -0.5 to 0.5."""
    curve = before - 2 * at + after
    return 0.0 if curve >= 0 else min(max(0.5 * (before - after) / curve, -0.5), 0.5)


@compiled
def _sharpness(response: Float32Array, row: int, column: int) -> float:
    """Peak to sidelobe ratio of a ring of values; 0 where all are alike.

    Source: Bolme, Beveridge, Draper and Lui, Visual Object Tracking using Adaptive Correlation Filters,
    CVPR 2010.
    """
    total, power = 0.0, 0.0
    for value in response.ravel():
        total += float(value)
        power += float(value) ** 2
    for down in range(row - SIDELOBE, row + SIDELOBE + 1):
        for along in range(column - SIDELOBE, column + SIDELOBE + 1):
            value = response[down % GRID, along % GRID]
            total -= float(value)
            power -= float(value) ** 2
    number = response.size - (2 * SIDELOBE + 1) ** 2
    mean = total / number
    deviation = np.sqrt(max(power / number - mean * mean, 0.0))
    return float((response[row, column] - mean) / max(deviation, 1e-6))
