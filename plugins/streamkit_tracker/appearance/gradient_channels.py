"""Oriented gradients and grey level of patches: what correlation filters see."""

from __future__ import annotations

from functools import cache

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.appearance.frame_crops import Float32Array

CELL = 3
GRID = 32
SAMPLES = CELL * GRID
DIRECTIONS = 8
CHANNELS = DIRECTIONS + 1
CONTRAST_FLOOR = 3.0
GREY_SHARE = 0.5
HALF = DIRECTIONS // 2
ACROSS, DOWN, GREY = HALF, HALF + 1, HALF + 2  # sums over a row of cells, beside one for each half direction


def gradient_channels(patches: Float32Array) -> Float32Array:
    """Grey level and the gradient along eight directions, averaged over cells and free of light.

    Args:
        patches: float32[n, samples, samples], contiguous.

    Returns:
        float32[n, channels, grid, grid], under a Hann window.

    Source: Dalal and Triggs, Histograms of Oriented Gradients, CVPR 2005 (here with rectified projections
    in place of binned angles, which need no arc tangent).
    """
    channels = np.empty((len(patches), CHANNELS, GRID, GRID), np.float32)
    _average_cells(patches, channels)
    _normalise_light(channels, _hann())
    return channels


@compiled
def _average_cells(patches: Float32Array, channels: Float32Array) -> None:
    """Means over cells of the rectified gradients and of the grey level."""
    sums, totals = np.empty((GREY + 1, SAMPLES), np.float32), np.empty((GREY + 1, GRID), np.float32)
    across, down = np.zeros(SAMPLES, np.float32), np.empty(SAMPLES, np.float32)
    for index in range(len(patches)):
        for row in range(GRID):
            sums[:] = 0
            for line in range(row * CELL, row * CELL + CELL):
                here = patches[index, line]
                inner = 0 < line < SAMPLES - 1
                above, below = (patches[index, line - 1], patches[index, line + 1]) if inner else (here, here)
                for sample in range(1, SAMPLES - 1):
                    across[sample] = here[sample + 1] - here[sample - 1]
                for sample in range(SAMPLES):
                    down[sample] = below[sample] - above[sample]
                _add(across, sums[ACROSS])
                _add(down, sums[DOWN])
                _add(here, sums[GREY])
                _add_rectified(across, down, np.float32(1), np.float32(0), sums[0])
                _add_rectified(across, down, np.float32(1), np.float32(1), sums[1])
                _add_rectified(across, down, np.float32(0), np.float32(1), sums[2])
                _add_rectified(across, down, np.float32(-1), np.float32(1), sums[3])
            _average_row(sums, totals, channels[index], row)


@compiled
def _add(values: Float32Array, total: Float32Array) -> None:
    for sample in range(len(total)):
        total[sample] += values[sample]


@compiled
def _add_rectified(
    across: Float32Array, down: Float32Array, x: np.float32, y: np.float32, total: Float32Array
) -> None:
    """Adds the part of the gradient that points along x, y."""
    for sample in range(len(total)):
        total[sample] += max(x * across[sample] + y * down[sample], np.float32(0))


@compiled
def _average_row(sums: Float32Array, totals: Float32Array, channels: Float32Array, row: int) -> None:
    """Means over a row of cells, from sums over its lines.

    The opposite directions need no sums of their own: a rectified mean is this one less the plain mean.

    Args:
        sums: float32[7, samples].
        totals: float32[7, grid], is overwritten.
        channels: float32[channels, grid, grid], of which the row is filled.
        row: which one.
    """
    share, diagonal, one = np.float32(1 / CELL**2), np.float32(np.sqrt(0.5)), np.float32(1)
    for kind in range(GREY + 1):
        samples, total = sums[kind], totals[kind]
        for cell in range(GRID):
            total[cell] = (samples[CELL * cell] + samples[CELL * cell + 1] + samples[CELL * cell + 2]) * share
    x, y = totals[ACROSS], totals[DOWN]
    for direction in range(HALF):
        scale = diagonal if direction % 2 else one
        x_part, y_part = np.float32(1 if direction == 0 else 2 - direction), np.float32(min(direction, 1))
        total, along = totals[direction], channels[direction, row]
        opposite = channels[direction + HALF, row]
        for cell in range(GRID):
            along[cell] = scale * total[cell]
        for cell in range(GRID):
            opposite[cell] = scale * (total[cell] - (x_part * x[cell] + y_part * y[cell]))
    channels[DIRECTIONS, row] = totals[GREY]


@compiled
def _normalise_light(channels: Float32Array, hann: Float32Array) -> None:
    """Divides gradients by their strength nearby and grey levels by their deviation.

    Loops over flat arrays, few at a time: only then can the compiler see that these do not overlap.
    """
    cells, one = GRID * GRID, np.float32(1)
    energy, around = np.empty(cells, np.float32), np.empty(cells, np.float32)
    window = hann.reshape(cells)
    for index in range(len(channels)):
        patch = channels[index]
        energy[:] = 0
        for direction in range(DIRECTIONS):
            gradient = patch[direction].reshape(cells)
            for cell in range(cells):
                energy[cell] += gradient[cell] * gradient[cell]
        for cell in range(cells):
            energy[cell] = np.sqrt(energy[cell])
        _blur(energy.reshape(GRID, GRID), around.reshape(GRID, GRID))
        for cell in range(cells):
            around[cell] = one / (around[cell] + np.float32(CONTRAST_FLOOR))
        for direction in range(DIRECTIONS):
            gradient = patch[direction].reshape(cells)
            for cell in range(cells):
                gradient[cell] *= around[cell]
            _centre(gradient, one, window)
        grey = patch[DIRECTIONS].reshape(cells)
        deviation = np.sqrt(max(np.mean(grey * grey) - np.mean(grey) ** 2, 0.0))
        _centre(grey, np.float32(GREY_SHARE / max(deviation, CONTRAST_FLOOR)), window)


@compiled
def _centre(channel: Float32Array, scale: np.float32, window: Float32Array) -> None:
    """Takes the mean off, scales and puts the window over a channel, float32[grid * grid]."""
    sums = np.zeros(GRID, np.float32)
    for start in range(0, len(channel), GRID):
        row = channel[start : start + GRID]
        for column in range(GRID):
            sums[column] += row[column]
    mean = np.float32(sums.sum() / len(channel))
    for cell in range(len(channel)):
        channel[cell] = (channel[cell] - mean) * scale * window[cell]


@compiled
def _blur(image: Float32Array, result: Float32Array) -> None:
    """Means over 3x3 cells, mirrored about the border ones."""
    last, ninth = GRID - 1, np.float32(1 / 9)
    line = np.empty(GRID, np.float32)
    for row in range(GRID):
        above, here = image[row - 1 if row else 1], image[row]
        below = image[row + 1 if row < last else last - 1]
        for column in range(GRID):
            line[column] = above[column] + here[column] + below[column]
        blurred = result[row]
        for column in range(1, last):
            blurred[column] = (line[column - 1] + line[column] + line[column + 1]) * ninth
        blurred[0] = (line[0] + 2 * line[1]) * ninth
        blurred[last] = (line[last] + 2 * line[last - 1]) * ninth


@cache
def _hann() -> Float32Array:
    window = np.hanning(GRID + 2)[1:-1].astype(np.float32)
    return np.outer(window, window)
