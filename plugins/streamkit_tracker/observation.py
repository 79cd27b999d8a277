"""What the tracker is told about one frame, and what it tells about one target."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import msgspec
import numpy as np

from streamkit_tracker.feature_template import Space
from streamkit_tracker.frame_crops import Float32Array
from streamkit_tracker.provenance import TargetProvenance
from streamkit_tracker.window_geometry import FloatArray

NOTHING: FloatArray = np.zeros((2, 2))
NOTHING.setflags(write=False)


class Placement(enum.StrEnum):
    """How the frame lies to the one before it."""

    KNOWN = "known"
    LOST = "lost"
    NEW = "new"


class TargetState(enum.StrEnum):
    """Where a target stands in its life."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    LOST = "lost"


@dataclass(frozen=True, eq=False)
class Observation:
    """Everything that came with a frame besides its pixels.

    Attributes:
        step_s: time since the previous frame, s, above 0.
        placement: known; lost (no registration: targets coast); new (a cut: all targets end).
        to_previous: float64[3, 3], this frame's pixels to the previous frame's.
        to_reference: float64[3, 3], this frame's pixels to the reference plane.
        centroids: float64[n, 2], px.
        boxes: float64[n, 4], x0 y0 x1 y1 px.
        features: float32[n, k], one vector per detection, or None.
        features_version: of the space they are in; vectors of different versions do not compare.
        space: the feature space to compare windows in, or None for the tracker's own templates.
    """

    step_s: float
    placement: Placement = Placement.KNOWN
    to_previous: FloatArray = field(default_factory=lambda: np.eye(3))
    to_reference: FloatArray = field(default_factory=lambda: np.eye(3))
    centroids: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    boxes: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    features: Float32Array | None = None
    features_version: int = 0
    space: Space | None = None


class TargetReport(msgspec.Struct, frozen=True, eq=False):
    """One target in one frame.

    Attributes:
        id: number, never reused.
        state: tentative, confirmed, coasting or lost.
        window: float64[5], x y length width angle in the frame's pixels.
        velocity: float64[2], px/s on the reference plane.
        covariance: float64[2, 2] of x and y, px squared.
        score: similarity of the window to the target's template, or share of frames detected, 0 to 1.
        age_s: time since the target began, s.
        provenance: where all this comes from.
    """

    id: int
    state: TargetState
    window: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    score: float
    age_s: float
    provenance: TargetProvenance = msgspec.field(default_factory=TargetProvenance)


class Sighting(msgspec.Struct, frozen=True, eq=False):
    """A detection given to a target.

    Attributes:
        centroid: x and y, px.
        box: width and height, px.
        middle: x and y of the box's centre, px.
        std: standard deviation of the centroid, px.
        crowded: whether its box holds other targets as well.
        feature: float32[k] or None.
        feature_version: of the space it is in.
        row: of the detection in its frame.
    """

    centroid: tuple[float, float]
    box: tuple[float, float]
    middle: tuple[float, float]
    std: float
    crowded: bool = False
    feature: Float32Array | None = None
    feature_version: int = 0
    row: int | None = None

    @property
    def measurement(self) -> Measurement:
        """Its centroid as a measurement."""
        return Measurement(self.centroid, self.std**2)


class Measurement(msgspec.Struct, frozen=True, eq=False):
    """A measured position.

    Attributes:
        position: x and y, px.
        variance: of either coordinate, px squared.
        covariance: float64[2, 2], px squared, what comes to that.
    """

    position: tuple[float, float]
    variance: float
    covariance: FloatArray = NOTHING
