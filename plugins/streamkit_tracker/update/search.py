"""Searches the frame for targets by their appearance, those that are alike in one batch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from streamkit_tracker.appearance.eigen_template import EigenTemplate
from streamkit_tracker.appearance.feature_template import FeatureTemplate, feature_distances
from streamkit_tracker.appearance.frame_crops import Crops, Float32Array
from streamkit_tracker.appearance.window_sampling import WindowSampler
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import Appearance
from streamkit_tracker.update.detected_box import SearchRows
from streamkit_tracker.update.layered_filter import LayerSettings, Particles, Proposal, layered_step
from streamkit_tracker.update.priors import log_scores
from streamkit_tracker.window_geometry import LENGTH, WIDTH, FloatArray

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
        patches: n of float32[p], grey levels minus 128 of the estimated windows.
    """

    windows: FloatArray
    covariances: FloatArray
    particles: list[Particles]
    similarities: FloatArray
    informative: list[bool]
    patches: list[Float32Array]


def search(
    sampler: WindowSampler,
    appearances: list[Appearance],
    generators: list[np.random.Generator],
    layers: list[LayerSettings],
    searches: SearchRows,
    settings: TrackerSettings,
) -> Found:
    """Searches the sampler's frame for n targets; targets do not influence each other.

    Args:
        sampler: holds the frame.
        appearances: of the targets.
        generators: one for each target, the only source of chance.
        layers: how many particles, for each.
        searches: n rows of `SEARCH`, what is expected of them.
        settings: of the tracker.
    """
    count = len(appearances)
    groups: dict[tuple[object, tuple[int, int], LayerSettings, float, int], list[int]] = {}
    height, width = sampler.shape
    for row, (appearance, window) in enumerate(zip(appearances, searches["window"].tolist(), strict=True)):
        shorter = appearance.context * min(window[LENGTH], window[WIDTH])
        factor = max(1, min(int(shorter // max(appearance.patch)), height, width))
        key = (type(appearance.template), appearance.patch, layers[row], appearance.context, factor)
        groups.setdefault(key, []).append(row)
    whole = Found(np.empty((count, 5)), np.empty((count, 2, 2)), [], np.empty(count), [], [])
    found: dict[int, tuple[Particles, bool, Float32Array]] = {}
    for (_, _, of_group, _, factor), members in groups.items():
        alike = [appearances[row] for row in members]
        chances = [generators[row] for row in members]
        part = _search_group(sampler, alike, chances, of_group, searches[members], factor, settings)
        whole.windows[members], whole.covariances[members] = part.windows, part.covariances
        whole.similarities[members] = part.similarities
        found.update(
            zip(members, zip(part.particles, part.informative, part.patches, strict=True), strict=True)
        )
    for row in range(count):
        particles, informative, patch = found[row]
        whole.particles.append(particles)
        whole.informative.append(informative)
        whole.patches.append(patch)
    return whole


def _search_group(
    sampler: WindowSampler,
    appearances: list[Appearance],
    generators: list[np.random.Generator],
    layers: LayerSettings,
    searches: SearchRows,
    factor: int,
    settings: TrackerSettings,
) -> Found:
    """Searches for targets with the same kind of template, patch, layers and shrink factor in one batch."""
    compare = _Comparison(sampler, appearances, layers.particles, factor)
    variance, (height, width) = settings.sigma**2, sampler.shape

    def score(windows: FloatArray) -> FloatArray:
        scores = np.empty(windows.shape[:2])
        log_scores(compare(windows), variance, windows, searches, height, width, scores)
        return scores

    windows, spreads, deviations = searches["window"], searches["spread"], searches["seed_std"]
    sides = (windows[:, LENGTH] + windows[:, WIDTH]) / 2
    wide = np.maximum(settings.std_position * sides, 1.0) * searches["reach"]
    seeded = np.isfinite(deviations)
    proposal = Proposal(
        windows,
        searches["displacement"],
        np.minimum(np.maximum(spreads, LEAST_SPREAD), wide),
        wide,
        np.where(seeded[:, None], searches["seed"], math.nan),
        np.where(seeded, np.minimum(DETECTION_SHARE * deviations, wide), 0.0),
    )
    particles = [appearance.particles for appearance in appearances]
    estimates = layered_step(particles, generators, proposal, score, layers)
    distances = compare(estimates.windows[:, None])
    contrasts = (estimates.contrasts > LEAST_CONTRAST).tolist()
    return Found(
        estimates.windows,
        estimates.covariances,
        estimates.particles,
        np.exp(-distances[:, 0]),
        [a.template.textured and c for a, c in zip(appearances, contrasts, strict=True)],
        [patch.copy() for patch in compare.first_patches],
    )


class _Comparison:
    """Compares windows of several targets with their templates.

    The parts of the frame are cut out around the first windows, those of the widest layer, with a margin for
    the others.

    Attributes:
        first_patches: float32[t, p], of the first window of each target that was compared last.
    """

    def __init__(
        self, sampler: WindowSampler, appearances: list[Appearance], particles: int, factor: int
    ) -> None:
        self._sampler, self._factor = sampler, factor
        self._patch, self._context = appearances[0].patch, appearances[0].context
        templates = [appearance.template for appearance in appearances]
        self._features = [template for template in templates if isinstance(template, FeatureTemplate)]
        eigen = [template for template in templates if isinstance(template, EigenTemplate)]
        if eigen:
            self._rows = sampler.side_by_side([template.rows for template in eigen])
            self._constants = np.stack([template.constants for template in eigen])
        self.first_patches = np.zeros((0, 0), np.float32)
        self._together = max(1, SAMPLES_AT_ONCE // (particles * self._patch[0] * self._patch[1]))
        self._crops: list[Crops] = []

    def __call__(self, windows: FloatArray) -> FloatArray:
        """Distances float64[t, n] of windows float64[t, n, 5]."""
        wider = windows.copy()
        wider[..., LENGTH : WIDTH + 1] *= self._context
        if self._features:
            return self._feature_distances(wider)
        if not self._crops:
            self._crops = [self._sampler.crop(wider.reshape(-1, 5), self._factor, len(wider), CROP_MARGIN)]
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
            flat = windows[chunk].reshape(-1, 5)
            if index == len(self._crops):
                groups = len(windows[chunk])
                self._crops.append(self._sampler.crop(flat, self._factor, groups, CROP_MARGIN))
            patches = self._sampler.sample(flat, self._patch, crops=self._crops[index])
            patches = patches.reshape(-1, count, pixels)
            result[chunk] = feature_distances(self._features[chunk], patches)
            self.first_patches[chunk] = patches[:, 0]
        return result
