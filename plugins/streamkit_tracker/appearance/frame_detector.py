"""Finds a target drawn by hand anywhere in a large part of the frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from streamkit_kernels import product
from streamkit_tracker.appearance.background_classifier import BackgroundClassifier
from streamkit_tracker.appearance.gradient_histograms import CELL
from streamkit_tracker.appearance.region_features import principal_directions, read_channels
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.window_geometry import ANGLE, LENGTH, WIDTH, Float32Array, FloatArray

CELLS_PER_SIDE = 5.0
MAX_REACH = 24.0  # sides: the largest part of a frame that is searched
BORDER = 1  # cells around the target that belong to its appearance
MARGIN = 2  # cells beyond it, that gradients at its rim need
GRADIENTS = 5  # components kept of the gradient channels
COLOUR_WEIGHT = np.float32(6.0)  # colours stay longer than the outline of a target that turns or walks
FIRST_PATCHES, PATCHES = 256, 64
NEAR = 0.3  # sides: the same position, with the cells as they fall
APART = 1.0  # sides from the target: what is there is background


@dataclass(frozen=True, eq=False)
class ScoreMap:
    """A part of a frame, and how like the target each position in it is.

    Attributes:
        side: mean side of the target, px.
        features: float32[channels, rows, columns], of the cells.
        positions: float64[r, c, 2], x y of the middle of the target at all positions it may have, px.
        scores: float32[r, c], at these, see `BackgroundClassifier`; minus infinity beyond the frame.
    """

    side: float
    features: Float32Array
    positions: FloatArray
    scores: Float32Array

    def distances(self, position: FloatArray) -> FloatArray:
        """Distances of all positions from x y, float64[2], in sides of the target: float64[r, c]."""
        apart = self.positions - position
        return np.asarray(np.hypot(apart[..., 0], apart[..., 1]) / self.side)

    def best_scores(self, position: FloatArray) -> tuple[float, float]:
        """The best score at x y, float64[2], px, and the best of what is not the target there."""
        distances = self.distances(position)
        here = self.scores.max(initial=-np.inf, where=distances <= NEAR)
        return float(here), float(self.scores.max(initial=-np.inf, where=distances > APART))

    def best_position(self) -> FloatArray:
        """Centre x y of the best score, float64[2], px."""
        return np.asarray(self.positions.reshape(-1, 2)[self.scores.argmax()])


class FrameDetector:
    """Tells a target from everything else in the frame, by gradients and colours of coarse cells.

    It is not led by where the target was, and its negatives come from all over the frame, so that it finds
    what the filter that follows the target has lost.

    Source: Kalal, Mikolajczyk and Matas, Tracking-Learning-Detection, TPAMI 2012 (a detector beside a
    tracker).

    Args:
        sampler: has been shown the first frame.
        window: float64[5], the first window.
    """

    def __init__(self, sampler: WindowSampler, window: FloatArray) -> None:
        cell = math.sqrt(window[LENGTH] * window[WIDTH]) / CELLS_PER_SIDE
        rows, columns = (max(2, round(float(window[side] / cell))) + 2 * BORDER for side in (WIDTH, LENGTH))
        self._shape = rows, columns
        region, (rows, columns) = self._region(window, sampler.shape)
        gradients = read_channels(sampler, region, (rows, columns), _shrink(region, rows))[0]
        self._components = principal_directions(gradients, GRADIENTS)
        self._classifier: BackgroundClassifier | None = None
        self._learnt = 0
        self.learn(self.score(sampler, window), sampler, window)

    def score(self, sampler: WindowSampler, window: FloatArray) -> ScoreMap:
        """Scores the positions around a window, float64[5], for a target of its size and turn."""
        region, (rows, columns) = self._region(window, sampler.shape)
        features = self._read(sampler, region, (rows, columns))
        cell = float(region[WIDTH]) / rows
        down, across = (cell * (np.arange(count) - (count - 1) / 2) for count in self._counts(rows, columns))
        cosine, sine = math.cos(region[ANGLE]), math.sin(region[ANGLE])
        x = region[0] + across * cosine - down[:, None] * sine
        y = region[1] + across * sine + down[:, None] * cosine
        scores = np.zeros(x.shape, np.float32)
        if self._classifier is not None:
            scores += self._classifier.bias
            weights = self._classifier.weights.reshape(-1, *self._shape)
            for channel, part in zip(features, weights, strict=True):
                products = cv2.filter2D(channel, -1, part, anchor=(0, 0), borderType=cv2.BORDER_CONSTANT)
                scores += products[: len(down), : len(across)]
        height, width = sampler.shape
        scores[(x < 0) | (y < 0) | (x > width - 1) | (y > height - 1)] = -np.inf
        return ScoreMap(cell * CELLS_PER_SIDE, features, np.stack([x, y], axis=-1), scores)

    def learn(self, score_map: ScoreMap, sampler: WindowSampler, window: FloatArray) -> None:
        """Learns the target at a window, float64[5], and the background, by the scores of the frame."""
        rows, columns = (cells + 2 * MARGIN for cells in self._shape)
        region, cell = window.copy(), score_map.side / CELLS_PER_SIDE
        region[LENGTH], region[WIDTH] = columns * cell, rows * cell
        appearance = self._read(sampler, region, (rows, columns))[:, MARGIN:-MARGIN, MARGIN:-MARGIN].ravel()
        background = self._background(score_map, window[:2])
        if not len(background):  # the target fills the frame
            return
        if self._classifier is None:
            self._classifier = BackgroundClassifier(appearance, background)
        else:
            self._classifier.learn(appearance, background)
        self._learnt += 1

    def _background(self, score_map: ScoreMap, position: FloatArray) -> Float32Array:
        """Patches float32[n, k] beside a target at x y, float64[2], evenly spread."""
        free = np.flatnonzero((score_map.distances(position) > APART) & np.isfinite(score_map.scores))
        count = PATCHES if self._learnt else FIRST_PATCHES
        stride = max(len(free) // count, 1)
        windows = np.lib.stride_tricks.sliding_window_view(score_map.features, self._shape, axis=(1, 2))
        rows, columns = np.divmod(free[self._learnt % stride :: stride][:count], score_map.scores.shape[1])
        size = len(score_map.features) * math.prod(self._shape)
        return windows[:, rows, columns].swapaxes(0, 1).reshape(len(rows), size)

    def _read(self, sampler: WindowSampler, region: FloatArray, cells: tuple[int, int]) -> Float32Array:
        """float32[channels, rows, columns] of a region, float64[5]."""
        gradients, colours, _ = read_channels(sampler, region, cells, _shrink(region, cells[0]))
        both = np.concatenate([product(self._components, gradients), COLOUR_WEIGHT * colours])
        return both.reshape(-1, *cells)

    def _region(self, window: FloatArray, image_shape: tuple[int, int]) -> tuple[FloatArray, tuple[int, int]]:
        """The part of the frame around a window, float64[5], as a window of whole cells, and their number."""
        side = math.sqrt(window[LENGTH] * window[WIDTH])
        cell, region = side / CELLS_PER_SIDE, window.copy()
        cells = [
            max(round(min(size / cell, MAX_REACH * CELLS_PER_SIDE)), least + 2)
            for size, least in zip(image_shape, self._shape, strict=True)
        ]
        region[LENGTH], region[WIDTH] = cells[1] * cell, cells[0] * cell
        for axis, size in enumerate((image_shape[1], image_shape[0])):
            half = min(float(region[LENGTH + axis]), size) / 2
            region[axis] = min(max(float(window[axis]), half - 0.5), size - half - 0.5)
        return region, (cells[0], cells[1])

    def _counts(self, rows: int, columns: int) -> tuple[int, int]:
        """How many positions the target may have in so many cells."""
        return rows - self._shape[0] + 1, columns - self._shape[1] + 1


def _shrink(region: FloatArray, rows: int) -> int:
    """By how much the frame is averaged down for a region of so many rows of cells."""
    return max(1, int(region[WIDTH] / (rows * CELL)))
