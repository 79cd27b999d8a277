"""Which frame each part of the final mosaic shows."""

import cv2
import numpy as np

from streamkit.geometry.homography import translation
from streamkit_stitcher.mosaic.seams import footprint, graph_cut_labels

GRID = (120, 240)


def foliage(random):
    """Leaves as two frames see them: alike in nothing but their mean, uint8[120, 160, 3]."""
    leaves = cv2.GaussianBlur(random.normal(0, 300, (120, 160, 3)), (0, 0), 4)
    return np.clip(120 + leaves, 0, 255).astype(np.uint8)


def test_a_cut_seam_runs_where_frames_look_alike():
    """Among leaves, which lean differently in either frame, it finds where the frames differ least."""
    random = np.random.default_rng(1)
    frames = [foliage(random), foliage(random)]
    prints = [
        footprint(frame, translation(np.array([80.0 * number, 0.0])), GRID, False)
        for number, frame in enumerate(frames)
    ]
    labels = graph_cut_labels(prints, GRID, np.ones((2, 3)))[:, 80:160]
    difference = np.abs(frames[0][:, 80:].astype(float) - frames[1][:, :80]).mean(axis=2)
    own = (labels == 0).astype(np.uint8)
    seam = cv2.morphologyEx(own, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    assert seam.any(axis=1).all()
    assert difference[seam].mean() < 0.6 * difference.mean()
