"""Finds targets in a frame by their appearance, several at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from streamkit_tracker.eigen_template import EigenTemplate
from streamkit_tracker.feature_template import FeatureTemplate, feature_distances
from streamkit_tracker.frame_crops import Crops, Float32Array
from streamkit_tracker.layered_filter import Cloud, LayerSettings, Proposal, layered_step
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray
from streamkit_tracker.window_priors import log_scores
from streamkit_tracker.window_sampling import WindowSampler, shrink_factor

Template = EigenTemplate | FeatureTemplate

LEAST_CONTRAST = 1e-3
LEAST_SPREAD = 0.5  # px
DETECTION_SHARE = 0.5
LATER_LAYERS = 0.15  # of the diagonal: how far smaller layers reach beyond the first
SAMPLES_AT_ONCE = 400_000  # keeps maps and patches of a batch inside the cache


class SearchJob(msgspec.Struct, frozen=True, eq=False):
    """One target to look for.

    Attributes:
        window: float64[5] of the previous frame, in the pixels of this one.
        cloud: its particles, likewise.
        generator: its only source of chance.
        template: its appearance.
        patch: samples of a patch (rows, columns).
        context: side of the sampled window relative to the target's.
        motion: float64[7]: predicted displacement, px; standard deviation of the prediction, px; how much
            wider than usual to look, 1 or more; x, y of where it was detected and their standard deviation,
            px, infinite where it was not.
        prior: float64[8], expectations beside the image, see `prior_rows`.
        layers: how many particles.
        tolerance: factor on the variance of the residual, for targets that change their look.
    """

    window: FloatArray
    cloud: Cloud
    generator: np.random.Generator
    template: Template
    patch: tuple[int, int]
    context: float
    motion: FloatArray
    prior: FloatArray
    layers: LayerSettings
    tolerance: float = 1.0


class Found(msgspec.Struct, frozen=True, eq=False):
    """Result of a search.

    Attributes:
        window: float64[5], the estimate.
        covariance: float64[2, 2] of its x and y, px squared.
        cloud: the target's particles.
        similarity: exp(-distance) of the estimated window, 0 to 1.
        informative: whether the image told any place from another.
        patch: float32[p], grey levels minus 128 of the estimated window.
    """

    window: FloatArray
    covariance: FloatArray
    cloud: Cloud
    similarity: float
    informative: bool
    patch: Float32Array


@dataclass(frozen=True)
class Likelihood:
    """How distances become log scores.

    Attributes:
        sigma: standard deviation of the residual, so that log score = -distance / (2 sigma^2).
        std_position: wide part of the position noise, relative to a window's mean side.
    """

    sigma: float = 0.09
    std_position: float = 0.125


def read_window(
    sampler: WindowSampler, window: FloatArray, patch: tuple[int, int], context: float
) -> Float32Array:
    """Patch float32[p] of one window float64[5] widened by `context`, as a template is started from."""
    wider = _widened(window[None], context)
    factor = shrink_factor(wider[0], patch, sampler.shape)
    return np.array(sampler.sample(wider, patch, factor)[0])


def search(sampler: WindowSampler, jobs: Sequence[SearchJob], likelihood: Likelihood) -> list[Found]:
    """Looks for every job's target in the sampler's frame; targets do not influence each other.

    Args:
        sampler: has been shown the frame.
        jobs: the targets.
        likelihood: how distances become scores.

    Returns:
        One result for each job, in order.
    """
    groups: dict[tuple[type[Template], tuple[int, int], LayerSettings, float, int], list[int]] = {}
    for index, job in enumerate(jobs):
        smaller = job.context * min(job.window.item(LENGTH), job.window.item(WIDTH))
        factor = max(1, min(int(smaller // max(job.patch)), *sampler.shape))
        key = (type(job.template), job.patch, job.layers, job.context, factor)
        groups.setdefault(key, []).append(index)
    found: dict[int, Found] = {}
    for key, members in groups.items():
        results = _search_alike(sampler, [jobs[i] for i in members], likelihood, key[-1])
        found.update(zip(members, results, strict=True))
    return [found[index] for index in range(len(jobs))]


def _search_alike(
    sampler: WindowSampler, jobs: list[SearchJob], likelihood: Likelihood, factor: int
) -> list[Found]:
    """Jobs with the same kind of template, patch, layers and shrinking, in one batch."""
    priors = np.array([job.prior for job in jobs])
    scales = -0.5 / (likelihood.sigma**2 * np.array([job.tolerance for job in jobs]))
    comparison = _Comparison(sampler, jobs, factor)

    def score(windows: FloatArray) -> FloatArray:
        scores = np.empty(windows.shape[:2])
        log_scores(comparison.distances(windows), scales, windows, priors, *sampler.shape, scores)
        return scores

    proposal = _proposal(jobs, likelihood)
    clouds, generators = [job.cloud for job in jobs], [job.generator for job in jobs]
    estimates = layered_step(clouds, generators, proposal, score, jobs[0].layers)
    final = comparison.distances(estimates.windows[:, None])
    patches, similarities = comparison.first_patches, np.exp(-final[:, 0])
    return [
        Found(
            estimates.windows[row],
            estimates.covariances[row],
            estimates.clouds[row],
            float(similarities[row]),
            job.template.textured and float(estimates.contrasts[row]) > LEAST_CONTRAST,
            patches[row].copy(),
        )
        for row, job in enumerate(jobs)
    ]


def _proposal(jobs: list[SearchJob], likelihood: Likelihood) -> Proposal:
    """Where to look."""
    windows, motions = np.array([job.window for job in jobs]), np.array([job.motion for job in jobs])
    spreads, reaches, seeds, deviations = motions[:, 2], motions[:, 3], motions[:, 4:6], motions[:, 6]
    sides = (windows[:, LENGTH] + windows[:, WIDTH]) / 2
    wide = np.maximum(likelihood.std_position * sides, 1.0) * reaches
    seeded = np.isfinite(deviations)
    return Proposal(
        windows,
        motions[:, :2],
        np.minimum(np.maximum(spreads, LEAST_SPREAD), wide),
        wide,
        np.where(seeded[:, None], seeds, math.nan),
        np.where(seeded, np.minimum(DETECTION_SHARE * deviations, wide), 0.0),
    )


class _Comparison:
    """Compares windows of several targets with their templates.

    The parts of the frame are cut out around the first windows, those of the widest layer, with room for the
    others.

    Attributes:
        first_patches: float32[t, p], of the first window of each target that was compared last.
    """

    def __init__(self, sampler: WindowSampler, jobs: list[SearchJob], factor: int) -> None:
        self._sampler, self._patch, self._factor = sampler, jobs[0].patch, factor
        self._context = jobs[0].context
        self._features = [job.template for job in jobs if isinstance(job.template, FeatureTemplate)]
        eigen = [job.template for job in jobs if isinstance(job.template, EigenTemplate)]
        if eigen:
            self._rows = sampler.side_by_side([template.rows for template in eigen])
            self._constants = _side_by_side([template.constants for template in eigen])
        self.first_patches = np.zeros((0, 0), np.float32)
        self._together = max(
            1, SAMPLES_AT_ONCE // (jobs[0].layers.particles * self._patch[0] * self._patch[1])
        )
        self._crops: list[Crops] = []

    def distances(self, windows: FloatArray) -> FloatArray:
        """Distances float64[t, n] of windows float64[t, n, 5]."""
        wider = _widened(windows, self._context)
        if self._features:
            return self._feature_distances(wider)
        if not self._crops:
            self._crops.append(self._crop(wider))
        distances, self.first_patches = self._sampler.distances(
            wider, self._patch, self._crops[0], self._rows, self._constants
        )
        return distances

    def _feature_distances(self, windows: FloatArray) -> FloatArray:
        """The same in a feature space, for as many targets at once as the cache holds the patches of."""
        targets, count = windows.shape[:2]
        pixels = self._patch[0] * self._patch[1]
        result = np.empty((targets, count))
        self.first_patches = np.empty((targets, pixels), np.float32)
        for index, start in enumerate(range(0, targets, self._together)):
            chunk = slice(start, min(start + self._together, targets))
            if index == len(self._crops):
                self._crops.append(self._crop(windows[chunk]))
            flat = windows[chunk].reshape(-1, 5)
            patches = self._sampler.sample(flat, self._patch, crops=self._crops[index])
            patches = patches.reshape(-1, count, pixels)
            result[chunk] = feature_distances(self._features[chunk], patches)
            self.first_patches[chunk] = patches[:, 0]
        return result

    def _crop(self, windows: FloatArray) -> Crops:
        return self._sampler.crop(windows.reshape(-1, 5), self._factor, len(windows), LATER_LAYERS)


def _side_by_side(arrays: list[Float32Array]) -> Float32Array:
    return arrays[0][None] if len(arrays) == 1 else np.stack(arrays)


def _widened(windows: FloatArray, context: float) -> FloatArray:
    if context == 1.0:
        return windows
    wider = windows.copy()
    wider[..., LENGTH : WIDTH + 1] *= context
    return wider
