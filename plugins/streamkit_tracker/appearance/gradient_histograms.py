"""Histograms of oriented gradients over cells of 4x4 samples."""

from __future__ import annotations

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.appearance.frame_crops import Float32Array

CELL = 4  # samples
HALF = 9  # directions without sign
DIRECTIONS = 2 * HALF
CHANNELS = DIRECTIONS + HALF + 4
CLIP = np.float32(0.2)
TEXTURE_SHARE = np.float32(0.2357)
FLOOR = np.float32(5.0)  # squared sum of gradients over four cells; keeps flat parts from becoming noise


def gradient_channels(patch: Float32Array) -> Float32Array:
    """Oriented gradients of a patch, normalised by the four blocks around each cell.

    Args:
        patch: float32[rows, columns], both multiples of 4.

    Returns:
        float32[31, rows / 4, columns / 4]: 18 directions, 9 without sign, 4 sums over the directions.

    Source: Felzenszwalb, Girshick, McAllester and Ramanan, Object Detection with Discriminatively Trained
    Part-Based Models, TPAMI 2010, section 6.
    """
    rows, columns = patch.shape
    channels = np.empty((CHANNELS, rows // CELL, columns // CELL), np.float32)
    angles = np.arange(HALF) * (np.pi / HALF)
    directions = np.stack([np.cos(angles), np.sin(angles)]).astype(np.float32)
    _normalise(_histograms(patch, directions), channels)
    return channels


@compiled
def _histograms(patch: Float32Array, directions: Float32Array) -> Float32Array:
    """Gradients by direction, float32[18, rows / 4 + 2, columns / 4 + 2] with a border of one cell."""
    rows, columns = patch.shape
    cells = np.zeros((DIRECTIONS, rows // CELL + 2, columns // CELL + 2), np.float32)
    step, half = np.float32(1 / CELL), np.float32(0.5)
    for row in range(rows):
        place = (row + half) * step + half
        top = int(place)
        below = place - top
        upper, lower = max(row - 1, 0), min(row + 1, rows - 1)
        for column in range(columns):
            x = patch[row, min(column + 1, columns - 1)] - patch[row, max(column - 1, 0)]
            y = patch[lower, column] - patch[upper, column]
            best, direction = np.float32(0), 0
            for index in range(HALF):
                along = directions[0, index] * x + directions[1, index] * y
                if abs(along) > best:
                    best, direction = abs(along), index if along > 0 else index + HALF
            strength = np.sqrt(x * x + y * y)
            place = (column + half) * step + half
            left = int(place)
            right = place - left
            upper_part, lower_part = strength * (1 - below), strength * below
            cells[direction, top, left] += upper_part * (1 - right)
            cells[direction, top, left + 1] += upper_part * right
            cells[direction, top + 1, left] += lower_part * (1 - right)
            cells[direction, top + 1, left + 1] += lower_part * right
    return cells


@compiled
def _normalise(cells: Float32Array, channels: Float32Array) -> None:
    """Fills in the channels of the inner cells."""
    rows, columns = cells.shape[1:]
    energy = np.zeros((rows, columns), np.float32)
    for direction in range(HALF):
        both = cells[direction] + cells[direction + HALF]
        energy += both * both
    blocks = energy[:-1, :-1] + energy[:-1, 1:] + energy[1:, :-1] + energy[1:, 1:] + FLOOR
    scales = np.float32(1) / np.sqrt(blocks)
    half = np.float32(0.5)
    for row in range(rows - 2):
        for column in range(columns - 2):
            around = (
                scales[row, column],
                scales[row, column + 1],
                scales[row + 1, column],
                scales[row + 1, column + 1],
            )
            for block in range(4):
                total = np.float32(0)
                for direction in range(DIRECTIONS):
                    total += min(cells[direction, row + 1, column + 1] * around[block], CLIP)
                channels[DIRECTIONS + HALF + block, row, column] = TEXTURE_SHARE * total
            for direction in range(DIRECTIONS + HALF):
                value = cells[direction % DIRECTIONS, row + 1, column + 1]
                if direction >= DIRECTIONS:
                    value += cells[direction - HALF, row + 1, column + 1]
                total = np.float32(0)
                for block in range(4):
                    total += min(value * around[block], CLIP)
                channels[direction, row, column] = half * total
