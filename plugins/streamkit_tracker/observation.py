"""Input of the tracker besides the pixels of a frame."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np

from streamkit.geometry.track import FeatureSpace
from streamkit_tracker.appearance.window_sampling import Chroma
from streamkit_tracker.window_geometry import Float32Array, FloatArray


class FrameContinuity(enum.StrEnum):
    """Relation of a frame to the previous one."""

    KNOWN = "known"
    LOST = "lost"
    NEW = "new"


@dataclass(frozen=True, eq=False)
class Observation:
    """Everything that came with a frame besides its pixels.

    Attributes:
        step_s: time since the previous frame, s, above 0.
        continuity: known; lost (no registration: targets coast); new (a cut: all targets end).
        to_previous: float64[3, 3], this frame's pixels to the previous frame's.
        to_reference: float64[3, 3], this frame's pixels to the reference plane.
        chroma: planes u and v, uint8[h / 2, w / 2], or None for a frame without colour.
        centroids: float64[n, 2], px.
        boxes: float64[n, 4], x0 y0 x1 y1 px.
        scores: float64[n], 0 to 1, or None.
        are_objects: whether each box is one whole object, as a classifier gives them; else they are regions
            of motion, of which the small ones may show a part of a target, or several.
        detector_ran: whether a detector ran on this frame; no target is missed where none did.
        features: float32[n, k], one vector per detection, or None.
        features_version: of the space they are in; vectors of different versions do not compare.
        space: the feature space to compare windows in, or None for the tracker's own templates.
    """

    step_s: float
    continuity: FrameContinuity = FrameContinuity.KNOWN
    to_previous: FloatArray = field(default_factory=lambda: np.eye(3))
    to_reference: FloatArray = field(default_factory=lambda: np.eye(3))
    chroma: Chroma | None = None
    centroids: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    boxes: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    scores: FloatArray | None = None
    are_objects: bool = False
    detector_ran: bool = True
    features: Float32Array | None = None
    features_version: int = 0
    space: FeatureSpace | None = None
