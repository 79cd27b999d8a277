"""Searches the frame for targets by their appearance, those that are alike in one batch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate, feature_distances
from streamkit_tracker.appearance.frame_crops import Crops, Float32Array
from streamkit_tracker.appearance.template_comparison import template_distances
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import Appearance, TargetModel
from streamkit_tracker.update.expectations import SearchRows, log_scores
from streamkit_tracker.update.layered_filter import LayerSettings, Particles, layered_step
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray, unit_grid

LEAST_CONTRAST = 1e-3
LEAST_SPREAD = 0.5  # px
DETECTION_SHARE = 0.5
CROP_MARGIN = 0.15  # of the diagonal: how far later layers reach beyond the first


@dataclass(frozen=True, eq=False)
class Found:
    """Results of the search for n targets.

    Attributes:
        windows: float64[n, 5], the estimates.
        covariances: float64[n, 2, 2] of x and y, px squared.
        particles: n of them, to keep for the next frame.
        similarities: float64[n], exp(-distance) of the estimated windows, 0 to 1.
        informative: n of them, whether the frame distinguishes positions.
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
    searches["wide_spread"] = wide
    searches["spread"] = np.minimum(np.maximum(searches["spread"], LEAST_SPREAD), wide)
    searches["seed_spread"] = np.where(np.isfinite(std), np.minimum(DETECTION_SHARE * std, wide), math.nan)
    appearances = [model.appearance for model in models if model.appearance is not None]
    templates = [appearance.template for appearance in appearances]
    eigen = [template for template in templates if isinstance(template, EigenTemplate)]
    stacked = (
        (np.stack([each.rows for each in eigen]), np.stack([each.constants for each in eigen]))
        if eigen
        else ()
    )
    score = _Score(sampler, templates, appearances[0], searches, factor, settings.sigma**2, stacked)
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
        [template.textured and contrast for template, contrast in zip(templates, contrasts, strict=True)],
        score.first_patches,
    )


@dataclass(eq=False)
class _Score:
    """Log scores of windows of several targets, by their templates and expectations.

    The parts of the frame are cut out around the first windows, those of the widest layer, with a margin for
    the others.

    Attributes:
        stacked: rows and constants of the eigen templates, see `EigenTemplate`; empty for feature templates.
        crops: around the first windows of each target.
        first_patches: float32[t, p], of the first window of each target that was compared last.
    """

    sampler: WindowSampler
    templates: Sequence[EigenTemplate | FeatureTemplate]
    like: Appearance
    searches: SearchRows
    factor: int
    variance: float
    stacked: tuple[Float32Array, Float32Array] | tuple[()]
    crops: Crops | None = None
    first_patches: Float32Array = field(init=False)

    def __call__(self, windows: FloatArray) -> FloatArray:
        """Log scores float64[t, n] of windows float64[t, n, 5]."""
        if self.crops is None:
            wider = windows.reshape(-1, 5).copy()
            wider[:, LENGTH : WIDTH + 1] *= self.like.context
            self.crops = self.sampler.crop(wider, self.factor, len(windows), CROP_MARGIN)
        return log_scores(self.distances(windows), self.variance, windows, self.searches, self.sampler.shape)

    def distances(self, windows: FloatArray) -> FloatArray:
        """Distances float64[t, n] of windows float64[t, n, 5] from the templates."""
        wider = windows.copy()
        wider[..., LENGTH : WIDTH + 1] *= self.like.context
        assert self.crops is not None
        if not self.stacked:
            return self._feature_distances(wider)
        crops, grid = self.crops, unit_grid(self.like.patch)
        result = np.empty(windows.shape[:2])
        self.first_patches = np.empty((len(windows), grid.shape[1]), np.float32)
        template_distances(
            crops.quads,
            crops.places,
            crops.factor,
            wider,
            grid,
            *self.stacked,
            result,
            self.first_patches,
        )
        return result

    def _feature_distances(self, windows: FloatArray) -> FloatArray:
        """The same in a feature space."""
        targets, count = windows.shape[:2]
        templates = [template for template in self.templates if isinstance(template, FeatureTemplate)]
        patches = self.sampler.sample(windows.reshape(-1, 5), self.like.patch, crops=self.crops)
        patches = patches.reshape(targets, count, -1)
        self.first_patches = patches[:, 0].copy()
        return np.asarray(feature_distances(templates, patches), np.float64)
