"""Runs every compiled loop once, before the first frame."""

from __future__ import annotations

from functools import cache

import numpy as np

from streamkit_kernels import prepare
from streamkit_tracker.appearance.eigen_template import EigenSettings
from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.tracker import MultiTargetTracker

SIDE = 64  # px, of the image
STEPS = 4
SETTINGS = TrackerSettings(eigen=EigenSettings(batch=2), birth_hits=1, min_travel=0.0)


@cache
def warm_up() -> None:
    """Follows a drawn and a detected target over a few small frames, once in a process.

    Else frames of a live feed would wait where their loops are loaded first, and SciPy with them.
    """
    prepare("streamkit_tracker")
    image = np.random.default_rng(0).integers(0, 255, (SIDE, SIDE)).astype(np.uint8)
    tracker = MultiTargetTracker(SETTINGS)
    tracker.start_target(image, np.array([20.0, 20.0, 16.0, 12.0, 0.0]), Observation(0.04))
    for step in range(STEPS):
        box = np.array([[40.0 + 2 * step, 40.0, 50.0 + 2 * step, 48.0]])
        centroids = (box[:, :2] + box[:, 2:]) / 2
        tracker.step(image, Observation(0.04, centroids=centroids, boxes=box))
