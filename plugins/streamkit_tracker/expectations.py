"""What targets are expected to do in a frame, before it is looked at, all at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from streamkit_tracker.appearance_search import SearchJob
from streamkit_tracker.detected_shape import Motion, turned_boxes
from streamkit_tracker.observation import Sighting
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.target import Target
from streamkit_tracker.window_geometry import FloatArray
from streamkit_tracker.window_priors import prior_rows

SIDES_STD = 0.12
NO_SEED = (0.0, 0.0, math.inf)


def search_jobs(
    targets: Sequence[Target],
    sightings: Mapping[int, Sighting],
    settings: TrackerSettings,
    step_s: float,
    share: float,
) -> list[SearchJob]:
    """What to look for in this frame.

    Args:
        targets: with an appearance, `mean` and `covariance` predicted for this frame.
        sightings: by target id.
        settings: of the tracker.
        step_s: time since the frame before, s.
        share: part of the usual particles.
    """
    if not targets:
        return []
    motion = Motion(np.array([t.mean for t in targets]), np.array([t.covariance for t in targets]))
    seen = [sightings.get(target.id) for target in targets]
    seeds = np.array([NO_SEED if s is None else (*s.centroid, s.std) for s in seen])
    priors = _priors(targets, motion, seeds)
    for row, target in enumerate(targets):
        if target.manual:
            prior = target.prior(seen[row])
            seeds[row] = *prior.centroid, prior.centroid_std
            priors[row] = prior_rows([prior])[0]
    motions = np.empty((len(targets), 7))
    motions[:, :2] = motion.means[:, 2:] * step_s
    motions[:, 2] = np.sqrt((motion.covariances[:, 0, 0] + motion.covariances[:, 1, 1]) / 2)
    motions[:, 3] = [target.reach for target in targets]
    motions[:, 4:] = seeds
    layers = {detected: settings.layers_for(detected, len(targets), share) for detected in (False, True)}
    return [
        target.job(row, prior, layers[sighting is not None])
        for target, row, prior, sighting in zip(targets, motions, priors, seen, strict=True)
    ]


def _priors(targets: Sequence[Target], motion: Motion, seeds: FloatArray) -> FloatArray:
    """Rows float64[n, 8], see `prior_rows`, of targets that detections lead."""
    headings, deviations = motion.headings(np.array([target.window for target in targets]))
    priors = np.empty((len(targets), 8))
    priors[:, :2] = seeds[:, :2]
    priors[:, 2:5] = turned_boxes([target.shape for target in targets], headings)
    priors[:, 5] = seeds[:, 2] ** -2
    priors[:, 6] = SIDES_STD**-2
    priors[:, 7] = deviations**-2
    return priors
