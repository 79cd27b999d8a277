"""Searches the frame for targets by their appearance, those of a group in one batch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from streamkit_kernels import compiled
from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate
from streamkit_tracker.appearance.template_comparison import template_distances
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.targets import TargetModel
from streamkit_tracker.update.layered_filter import Estimates, LayerSettings, SearchRows, layered_step
from streamkit_tracker.window_geometry import (
    ANGLE,
    LENGTH,
    WIDTH,
    Float32Array,
    FloatArray,
    half_turn,
    unit_grid,
    visible_fraction,
)

CROP_MARGIN = 0.15  # of the diagonal: how far later layers reach beyond the first
VISIBLE_ENOUGH = 0.5
HIDDEN_PENALTY = 20.0


class SearchGroup(NamedTuple):
    """What the targets that are searched together have in common.

    Attributes:
        template: class of their templates.
        patch: samples of a patch (rows, columns).
        layers: how many particles.
        factor: by how much the frame is averaged down.
    """

    template: type[EigenTemplate | FeatureTemplate]
    patch: tuple[int, int]
    layers: LayerSettings
    factor: int


def search(
    sampler: WindowSampler,
    models: list[TargetModel],
    searches: SearchRows,
    group: SearchGroup,
    variance: float,
) -> tuple[Estimates, FloatArray, Float32Array]:
    """Searches the sampler's frame for n targets of a group, which do not influence each other.

    Args:
        sampler: holds the frame.
        models: of the targets.
        searches: n rows of `SEARCH`.
        group: of all of them.
        variance: of the residual of a rigid target.

    Returns:
        The estimates; of the estimated windows the distances from the templates, float64[n], and the patches,
        float32[n, p], grey levels minus 128.
    """
    patch, crops = group.patch, None
    eigen = [model.template for model in models if isinstance(model.template, EigenTemplate)]
    features = [model.template for model in models if isinstance(model.template, FeatureTemplate)]
    rows, constants = np.array([each.rows for each in eigen]), np.array([each.constants for each in eigen])

    def compare(windows: FloatArray) -> tuple[FloatArray, Float32Array]:
        """Distances float64[n, k] of windows float64[n, k, 5], and the first patch of each target."""
        nonlocal crops
        flat = windows.reshape(-1, 5)
        # cut out around the first windows, those of the widest layer, with a margin for the others
        crops = crops or sampler.crop(flat, group.factor, len(windows), CROP_MARGIN)
        if features:
            patches = sampler.sample(flat, patch, crops=crops).reshape(*windows.shape[:2], -1)
            return np.asarray(FeatureTemplate.distances(features, patches), np.float64), patches[:, 0]
        distances = np.empty(windows.shape[:2])
        first = np.empty((len(windows), patch[0] * patch[1]), np.float32)
        template_distances(
            crops.quads,
            crops.parts,
            group.factor,
            windows,
            unit_grid(patch),
            rows,
            constants,
            distances,
            first,
        )
        return distances, first

    particles, generators = zip(*((model.particles, model.generator) for model in models), strict=True)
    estimates = layered_step(
        particles,
        generators,
        searches,
        lambda windows: log_scores(compare(windows)[0], variance, windows, searches, sampler.shape),
        group.layers,
    )
    distances, patches = compare(estimates.windows[:, None])
    return estimates, distances[:, 0], patches


@compiled
def log_scores(
    distances: FloatArray,
    variance: float,
    windows: FloatArray,
    searches: SearchRows,
    image_shape: tuple[int, int],
) -> FloatArray:
    """Log scores up to a constant, float64[t, n]; less for windows of which the frame shows less than half.

    Args:
        distances: float64[t, n].
        variance: of the residual of a rigid target.
        windows: float64[t, n, 5].
        searches: t rows of `SEARCH`.
        image_shape: height and width of the frame, px.
    """
    scores = np.empty(distances.shape)
    for target in range(len(windows)):
        search, fractions = searches[target], visible_fraction(windows[target], image_shape)
        position, sides = search["seed_std"] ** -2.0, search["sides_precision"]
        scale = -0.5 / (variance * search["tolerance"])
        for index in range(windows.shape[1]):
            window = windows[target, index]
            right, down = window[0] - search["seed"][0], window[1] - search["seed"][1]
            longer = np.log(window[LENGTH] / search["sides"][0])
            wider = np.log(window[WIDTH] / search["sides"][1])
            turned = half_turn(window[ANGLE] - search["heading"])
            surprise = position * (right**2 + down**2) + sides * (longer**2 + wider**2)
            surprise += search["heading_precision"] * turned**2
            hidden = max(VISIBLE_ENOUGH - fractions[index], 0.0)
            likelihood = scale * distances[target, index]
            scores[target, index] = likelihood - 0.5 * surprise - HIDDEN_PENALTY * hidden
    return scores
