"""Searches the frame for targets by their appearance, those that are alike in one batch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate, feature_distances
from streamkit_tracker.appearance.frame_crops import Crops, Float32Array
from streamkit_tracker.appearance.window_sampling import WindowSampler, template_distances
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import Appearance, TargetModel
from streamkit_tracker.update.expectations import SearchRows, log_scores
from streamkit_tracker.update.layered_filter import LayerSettings, Particles, layered_step
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, unit_grid

LEAST_CONTRAST = 1e-3
LEAST_SPREAD = 0.5  # px
DETECTION_SHARE = 0.5
CROP_MARGIN = 0.15  # of the diagonal: how far later layers reach beyond the first
SAMPLES_AT_ONCE = 400_000  # keeps maps and patches of a batch inside the cache


@dataclass(frozen=True, eq=False)
class Found:
    """Results of the search for n targets.

    Attributes:
        windows: float64[n, 5], the estimates.
        covariances: float64[n, 2, 2] of x and y, px squared.
        particles: n of them, to keep for the next frame.
        similarities: float64[n], exp(-distance) of the estimated windows, 0 to 1.
        informative: n of them, whether the frame told any position from another.
        patches: float32[n, p], grey levels minus 128 of the estimated windows.
    """

    windows: FloatArray
    covariances: FloatArray
    particles: list[Particles]
    similarities: FloatArray
    informative: list[bool]
    patches: Float32Array


def search(
    sampler: WindowSampler,
    models: list[TargetModel],
    searches: SearchRows,
    layers: LayerSettings,
    factor: int,
    settings: TrackerSettings,
) -> Found:
    """Searches the sampler's frame for n targets; targets do not influence each other.

    Args:
        sampler: holds the frame.
        models: of the targets, with the same kind of template, patch and context.
        searches: n rows of `SEARCH`, whose spreads are limited and filled.
        layers: how many particles.
        factor: by how much the frame is averaged down.
        settings: of the tracker.
    """
    window, std = searches["window"], searches["seed_std"]
    wide = np.maximum(settings.std_position * ((window[:, LENGTH] + window[:, WIDTH]) / 2), 1.0)
    wide *= searches["reach"]
    searches["wide_spread"] = wide
    searches["spread"] = np.minimum(np.maximum(searches["spread"], LEAST_SPREAD), wide)
    searches["seed_spread"] = np.where(np.isfinite(std), np.minimum(DETECTION_SHARE * std, wide), math.nan)
    appearances = [model.appearance for model in models if model.appearance is not None]
    score = _Score(sampler, appearances, searches, layers.particles, factor, settings.sigma**2)
    particles = [appearance.particles for appearance in appearances]
    generators = [model.generator for model in models]
    estimates = layered_step(particles, generators, searches, score, layers)
    distances = score.distances(estimates.windows[:, None])
    contrasts = (estimates.contrasts > LEAST_CONTRAST).tolist()
    return Found(
        estimates.windows,
        estimates.covariances,
        estimates.particles,
        np.exp(-distances[:, 0]),
        [a.template.textured and c for a, c in zip(appearances, contrasts, strict=True)],
        score.first_patches,
    )


class _Score:
    """Log scores of windows of several targets, by their templates and expectations.

    The parts of the frame are cut out around the first windows, those of the widest layer, with a margin for
    the others.

    Attributes:
        first_patches: float32[t, p], of the first window of each target that was compared last.
    """

    def __init__(
        self,
        sampler: WindowSampler,
        appearances: list[Appearance],
        searches: SearchRows,
        particles: int,
        factor: int,
        variance: float,
    ) -> None:
        self._sampler, self._searches, self._variance, self._factor = sampler, searches, variance, factor
        self._patch, self._context = appearances[0].patch, appearances[0].context
        templates = [appearance.template for appearance in appearances]
        self._features = [template for template in templates if isinstance(template, FeatureTemplate)]
        eigen = [template for template in templates if isinstance(template, EigenTemplate)]
        self._together = max(1, SAMPLES_AT_ONCE // (particles * self._patch[0] * self._patch[1]))
        if eigen:
            self._rows = sampler.side_by_side([template.rows for template in eigen])
            self._constants = np.stack([template.constants for template in eigen])
            self._together = len(eigen)
        self.first_patches = np.zeros((0, 0), np.float32)
        self._crops: list[Crops] = []

    def __call__(self, windows: FloatArray) -> FloatArray:
        """Log scores float64[t, n] of windows float64[t, n, 5]."""
        if not self._crops:
            wider = windows.copy()
            wider[..., LENGTH : WIDTH + 1] *= self._context
            for start in range(0, len(wider), self._together):
                part = wider[start : start + self._together]
                crops = self._sampler.crop(part.reshape(-1, 5), self._factor, len(part), CROP_MARGIN)
                self._crops.append(crops)
        distances, scores = self.distances(windows), np.empty(windows.shape[:2])
        height, width = self._sampler.shape
        log_scores(distances, self._variance, windows, self._searches, height, width, scores)
        return scores

    def distances(self, windows: FloatArray) -> FloatArray:
        """Distances float64[t, n] of windows float64[t, n, 5] from the templates."""
        wider = windows.copy()
        wider[..., LENGTH : WIDTH + 1] *= self._context
        if self._features:
            return self._feature_distances(wider)
        crops, grid = self._crops[0], unit_grid(self._patch)
        result = np.empty(windows.shape[:2])
        self.first_patches = np.empty((len(windows), grid.shape[1]), np.float32)
        template_distances(
            crops.quads,
            crops.places,
            crops.factor,
            wider,
            grid,
            self._rows,
            self._constants,
            result,
            self.first_patches,
        )
        return result

    def _feature_distances(self, windows: FloatArray) -> FloatArray:
        """The same in a feature space, for as many targets at once as the cache holds the patches of."""
        targets, count = windows.shape[:2]
        pixels = self._patch[0] * self._patch[1]
        result = np.empty((targets, count))
        self.first_patches = np.empty((targets, pixels), np.float32)
        for crops, start in zip(self._crops, range(0, targets, self._together), strict=True):
            chunk = slice(start, min(start + self._together, targets))
            patches = self._sampler.sample(windows[chunk].reshape(-1, 5), self._patch, crops=crops)
            patches = patches.reshape(-1, count, pixels)
            result[chunk] = feature_distances(self._features[chunk], patches)
            self.first_patches[chunk] = patches[:, 0]
        return result
