"""Track: one target in one frame, with its state and provenance; the space in which targets compare."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:  # not every pipeline needs numpy
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    Float32Array = NDArray[np.float32]


class TrackState(enum.StrEnum):
    """Life-cycle state of a track."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    LOST = "lost"


# States of a target that is there, and published for itself.
SHOWN_STATES = (TrackState.CONFIRMED, TrackState.COASTING)


@dataclass(frozen=True, slots=True)
class Provenance:
    """How a track was updated in a frame.

    Attributes:
        predicted: predicted x and y, px; None without a prediction.
        detection: row of the associated detection in the frame's `Detections`, or None.
        gate: distance of that detection from the prediction, standard deviations.
        shared: whether the detection of another track covers this one, too.
        similarity: of the patch to the track's template, 0 to 1; None if not computed.
        learnt: whether the template was updated from this frame.
        cause: why the track was initiated, confirmed or deleted in this frame, or the rule that keeps it
            tentative; else empty.
    """

    predicted: tuple[float, float] | None = None
    detection: int | None = None
    gate: float | None = None
    shared: bool = False
    similarity: float | None = None
    learnt: bool = False
    cause: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One target in one frame.

    Attributes:
        id: never reused.
        state: `lost` marks the last row of a track.
        x, y: centre, px of this frame.
        length: along `angle`, px.
        width: across `angle`, px.
        angle: direction of the length, rad from +x towards +y.
        velocity: px/s on the reference plane.
        covariance: float64[2, 2] of x and y, px squared.
        score: similarity or confidence, 0 to 1.
        age_ns: time since the track began.
        provenance: how the row was computed, if the tracker reports it.
    """

    id: int
    state: TrackState
    x: float
    y: float
    length: float
    width: float
    angle: float
    velocity: tuple[float, float]
    covariance: FloatArray
    score: float
    age_ns: int
    provenance: Provenance | None = None

    @property
    def turned_box(self) -> tuple[float, float, float, float, float]:
        """Its x, y, length, width and angle."""
        return self.x, self.y, self.length, self.width, self.angle


@runtime_checkable
class FeatureSpace(Protocol):
    """Feature space for comparing target patches; attached with `Frame.attach_as` under this type."""

    @property
    def patch_size(self) -> tuple[int, int]:
        """Height and width of patches for `embed`, px."""

    @property
    def version(self) -> int:
        """Increases whenever the vectors of the same patch change."""

    def embed(self, patches: Float32Array) -> Float32Array:
        """Maps grey patches, float32[n, h, w], to vectors, float32[n, k]."""
