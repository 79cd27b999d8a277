"""Finds targets in a frame by their appearance, several at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from streamkit_tracker.eigen_template import EigenTemplate, eigen_distances
from streamkit_tracker.feature_template import FeatureTemplate, feature_distances
from streamkit_tracker.layered_filter import Cloud, LayerSettings, Proposal, layered_step
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    WIDTH,
    FloatArray,
    half_turn,
    visible_fraction,
)
from streamkit_tracker.window_sampling import Float32Array, WindowSampler, shrink_factor

Template = EigenTemplate | FeatureTemplate

LEAST_CONTRAST = 1e-3
VISIBLE_ENOUGH = 0.5
HIDDEN_PENALTY = 20.0
DETECTION_SHARE = 0.5
SAMPLES_AT_ONCE = 400_000  # keeps maps and patches of a batch inside the cache


@dataclass(frozen=True)
class Prior:
    """What is expected of the window before the image is looked at; an infinite deviation is no opinion.

    Attributes:
        centroid: centre of the detection, px.
        centroid_std: its standard deviation, px.
        sides: length and width, px.
        sides_std: relative standard deviation of both.
        heading: direction of motion, rad.
        heading_std: its standard deviation, rad.
    """

    centroid: tuple[float, float] = (0.0, 0.0)
    centroid_std: float = math.inf
    sides: tuple[float, float] = (1.0, 1.0)
    sides_std: float = math.inf
    heading: float = 0.0
    heading_std: float = math.inf


@dataclass(frozen=True, eq=False)
class SearchJob:
    """One target to look for.

    Attributes:
        window: float64[5] of the previous frame, in the pixels of this one.
        cloud: its particles, likewise.
        generator: its only source of chance.
        template: its appearance.
        patch: samples of a patch (rows, columns).
        context: side of the sampled window relative to the target's.
        displacement: predicted motion, px.
        spread: standard deviation of the prediction, px.
        reach: how much wider than usual to look, 1 or more, for a target not seen lately.
        prior: expectations beside the image.
        layers: how many particles.
        tolerance: factor on the variance of the residual, for targets that change their look.
    """

    window: FloatArray
    cloud: Cloud
    generator: np.random.Generator
    template: Template
    patch: tuple[int, int]
    context: float
    displacement: tuple[float, float]
    spread: float
    reach: float
    prior: Prior
    layers: LayerSettings
    tolerance: float = 1.0


@dataclass(frozen=True, eq=False)
class Found:
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
        wider = _widened(job.window[None], job.context)[0]
        factor = shrink_factor(wider, job.patch, sampler.shape)
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
    expected = log_prior([job.prior for job in jobs])
    scale = -0.5 / (likelihood.sigma**2 * np.array([job.tolerance for job in jobs])[:, None])

    def distances(windows: FloatArray) -> FloatArray:
        return _distances(sampler, jobs, windows, factor)[0]

    def score(windows: FloatArray) -> FloatArray:
        visible = visible_fraction(windows.reshape(-1, 5), sampler.shape).reshape(windows.shape[:2])
        hidden = np.maximum(VISIBLE_ENOUGH - visible, 0.0)
        return scale * distances(windows) - HIDDEN_PENALTY * hidden + expected(windows)

    proposal = _proposal(jobs, likelihood)
    clouds, generators = [job.cloud for job in jobs], [job.generator for job in jobs]
    estimates = layered_step(clouds, generators, proposal, score, jobs[0].layers)
    final, patches = _distances(sampler, jobs, estimates.windows[:, None], factor)
    similarities = np.exp(-final[:, 0])
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
    windows = np.stack([job.window for job in jobs])
    sides = windows[:, LENGTH : WIDTH + 1].mean(axis=1)
    wide = np.maximum(likelihood.std_position * sides, 1.0) * np.array([job.reach for job in jobs])
    spread = np.clip(np.array([job.spread for job in jobs]), 0.5, wide)
    seed_std = np.array([job.prior.centroid_std for job in jobs])
    seed = np.array([job.prior.centroid for job in jobs])
    seed[~np.isfinite(seed_std)] = np.nan
    seed_spread = DETECTION_SHARE * np.where(np.isfinite(seed_std), seed_std, 0.0)
    return Proposal(
        windows,
        np.array([job.displacement for job in jobs]),
        spread,
        wide,
        seed,
        np.minimum(seed_spread, wide),
    )


def _distances(
    sampler: WindowSampler, jobs: list[SearchJob], windows: FloatArray, factor: int
) -> tuple[FloatArray, Float32Array]:
    """Distances float64[t, n] of windows float64[t, n, 5], and the first patch of each target."""
    patch, context = jobs[0].patch, jobs[0].context
    targets, count = windows.shape[:2]
    pixels = patch[0] * patch[1]
    together = max(1, SAMPLES_AT_ONCE // (count * pixels))
    result, firsts = np.empty((targets, count)), np.empty((targets, pixels), np.float32)
    for start in range(0, targets, together):
        chunk = slice(start, min(start + together, targets))
        flat = _widened(windows[chunk].reshape(-1, 5), context)
        patches = sampler.sample(flat, patch, factor).reshape(-1, count, pixels)
        result[chunk] = _compare([job.template for job in jobs[chunk]], patches)
        firsts[chunk] = patches[:, 0]
    return result, firsts


def _compare(templates: Sequence[Template], patches: Float32Array) -> Float32Array:
    eigen = [template for template in templates if isinstance(template, EigenTemplate)]
    if len(eigen) == len(templates):
        return eigen_distances(eigen, patches)
    return feature_distances([t for t in templates if isinstance(t, FeatureTemplate)], patches)


def _widened(windows: FloatArray, context: float) -> FloatArray:
    wider = windows.copy()
    wider[:, LENGTH : WIDTH + 1] *= context
    return wider


def log_prior(priors: Sequence[Prior]) -> Callable[[FloatArray], FloatArray]:
    """Log of the priors up to a constant: a function of windows float64[t, n, 5] that gives float64[t, n]."""
    centroids = np.array([prior.centroid for prior in priors])[:, None]
    centroid_precisions = np.array([prior.centroid_std**-2 for prior in priors])[:, None]
    sides = np.array([prior.sides for prior in priors])[:, None]
    side_precisions = np.array([prior.sides_std**-2 for prior in priors])[:, None]
    headings = np.array([prior.heading for prior in priors])[:, None]
    heading_precisions = np.array([prior.heading_std**-2 for prior in priors])[:, None]

    def log(windows: FloatArray) -> FloatArray:
        offsets = np.sum((windows[:, :, :2] - centroids) ** 2, axis=2)
        ratios = np.sum(np.log(windows[:, :, LENGTH : WIDTH + 1] / sides) ** 2, axis=2)
        turns = half_turn(windows[:, :, ANGLE] - headings) ** 2
        weighted = centroid_precisions * offsets + side_precisions * ratios + heading_precisions * turns
        return np.asarray(-0.5 * weighted)

    return log
