"""Histograms of oriented gradients over cells of 4x4 samples."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.window_geometry import Float32Array

CELL = 4  # samples
HALF = 9  # directions without sign
DIRECTIONS = 2 * HALF
CHANNELS = DIRECTIONS + HALF + 4
CLIP = np.float32(0.2)
TEXTURE_SHARE = np.float32(0.2357)
FLOOR = np.float32(5.0)  # squared sum of gradients over four cells; keeps flat parts from becoming noise


def gradient_channels(patches: Float32Array) -> Float32Array:
    """Oriented gradients of patches, normalised by the four blocks around each cell.

    Args:
        patches: float32[n, rows, columns], rows and columns multiples of 4.

    Returns:
        float32[n, 31, rows / 4, columns / 4]: 18 directions, 9 without sign, 4 sums over the directions.

    Source: Felzenszwalb, Girshick, McAllester and Ramanan, Object Detection with Discriminatively Trained
    Part-Based Models, TPAMI 2010, section 6.
    """
    count, rows, columns = patches.shape
    channels = np.empty((count, CHANNELS, rows // CELL, columns // CELL), np.float32)
    angles = np.arange(HALF) * (np.pi / HALF)
    _fill(patches, np.stack([np.cos(angles), np.sin(angles)]).astype(np.float32), channels)
    return channels


@compiled
def _fill(patches: Float32Array, directions: Float32Array, channels: Float32Array) -> None:
    """Fills in the channels of every patch; `directions` float32[2, 9] are unit vectors."""
    rows, columns = channels.shape[2:]
    cells = np.empty((DIRECTIONS, rows + 2, columns + 2), np.float32)
    for index in range(len(patches)):
        cells[:] = 0
        _histograms(patches[index], directions, cells)
        _normalise(cells, channels[index])


@compiled
def _histograms(patch: Float32Array, directions: Float32Array, cells: Float32Array) -> None:
    """Adds gradients by direction to float32[18, rows / 4 + 2, columns / 4 + 2], with a border of one cell.

    Each step is a loop of its own over a row, so that the processor takes several samples at once.
    """
    rows, columns = patch.shape
    step, half = np.float32(1 / CELL), np.float32(0.5)
    across, down, strength = np.empty((3, columns), np.float32)
    nearest = np.empty(columns, np.int32)
    for row in range(rows):
        upper, line, lower = patch[max(row - 1, 0)], patch[row], patch[min(row + 1, rows - 1)]
        across[0], across[-1] = line[1] - line[0], line[-1] - line[-2]
        for column in range(1, columns - 1):
            across[column] = line[column + 1] - line[column - 1]
        for column in range(columns):
            down[column] = lower[column] - upper[column]
            strength[column], nearest[column] = np.float32(0), np.int32(0)
        for index in range(HALF):
            cosine, sine = directions[0, index], directions[1, index]
            forward, backward = np.int32(index), np.int32(index + HALF)
            for column in range(columns):
                along = cosine * across[column] + sine * down[column]
                # read before the choice: a read in one of two branches keeps the loop scalar
                most, held = strength[column], nearest[column]
                direction = forward if along > 0 else backward
                nearest[column] = direction if abs(along) > most else held
                strength[column] = max(abs(along), most)
        for column in range(columns):
            strength[column] = np.sqrt(across[column] * across[column] + down[column] * down[column])
        position = (row + half) * step + half
        top = int(position)
        below = position - top
        for column in range(columns):
            position = (column + half) * step + half
            left = int(position)
            right = position - left
            direction = nearest[column]
            upper_part, lower_part = strength[column] * (1 - below), strength[column] * below
            cells[direction, top, left] += upper_part * (1 - right)
            cells[direction, top, left + 1] += upper_part * right
            cells[direction, top + 1, left] += lower_part * (1 - right)
            cells[direction, top + 1, left + 1] += lower_part * right


@compiled
def _block_scales(cells: Float32Array) -> Float32Array:
    """One over the norm of the gradients, without sign, of each four cells that meet."""
    rows, columns = cells.shape[1:]
    energy = np.zeros((rows, columns), np.float32)
    for direction in range(HALF):
        for row in range(rows):
            for column in range(columns):
                both = cells[direction, row, column] + cells[direction + HALF, row, column]
                energy[row, column] += both * both
    scales = np.empty((rows - 1, columns - 1), np.float32)
    for row in range(rows - 1):
        for column in range(columns - 1):
            block = energy[row, column] + energy[row, column + 1]
            block = block + energy[row + 1, column] + energy[row + 1, column + 1] + FLOOR
            scales[row, column] = np.float32(1) / np.sqrt(block)
    return scales


@compiled
def _normalise(cells: Float32Array, channels: Float32Array) -> None:
    """Fills in the channels of the inner cells."""
    rows, columns = cells.shape[1:]
    scales, half = _block_scales(cells), np.float32(0.5)
    textures = channels[DIRECTIONS + HALF :]
    textures[:] = 0
    for row in range(rows - 2):
        upper, lower = scales[row], scales[row + 1]
        for direction in range(DIRECTIONS + HALF):
            for column in range(columns - 2):
                value = cells[direction % DIRECTIONS, row + 1, column + 1]
                if direction >= DIRECTIONS:
                    value += cells[direction - HALF, row + 1, column + 1]
                first, second = min(value * upper[column], CLIP), min(value * upper[column + 1], CLIP)
                third, fourth = min(value * lower[column], CLIP), min(value * lower[column + 1], CLIP)
                channels[direction, row, column] = half * (first + second + third + fourth)
                if direction < DIRECTIONS:
                    textures[0, row, column] += first
                    textures[1, row, column] += second
                    textures[2, row, column] += third
                    textures[3, row, column] += fourth
    for texture in range(4):
        for row in range(rows - 2):
            for column in range(columns - 2):
                textures[texture, row, column] *= TEXTURE_SHARE
