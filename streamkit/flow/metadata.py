"""The vocabulary of metadata: what elements tell each other about a frame.

Pixel coordinates: x right, y down, (0, 0) the centre of the top-left pixel. Angles in radians from +x
towards +y. Times in nanoseconds. Arrays are float64 unless said.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    Float32Array = NDArray[np.float32]


class RegistrationStatus(enum.StrEnum):
    """How far a frame's registration can be trusted."""

    OK = "ok"
    WEAK = "weak"
    LOST = "lost"
    CUT = "cut"
    STILL = "still"


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Where a frame lies on the ground plane that its neighbours share.

    Attributes:
        to_previous: float64[3, 3], maps pixels of this frame to the previous frame.
        to_reference: float64[3, 3], maps pixels of this frame to the reference plane.
        reference: number of the reference plane; another number is another plane.
        reference_change: float64[3, 3] old plane to new, on the frame where the plane changes, else None.
        status: ok, weak, lost, cut or still.
        keyframe: whether this frame became a key frame.
        matches: points matched.
        inliers: points that agree with the homography.
        rmse: root mean square residual of the inliers, px.
    """

    to_previous: FloatArray
    to_reference: FloatArray
    reference: int = 0
    reference_change: FloatArray | None = None
    status: RegistrationStatus = RegistrationStatus.OK
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """Things found in a frame, one row each.

    Attributes:
        centroids: float64[n, 2], x y px.
        boxes: float64[n, 4], x0 y0 x1 y1 px.
        areas: float64[n], px.
        scores: float64[n], 0 to 1.
        labels: n words, or none at all.
    """

    centroids: FloatArray
    boxes: FloatArray
    areas: FloatArray
    scores: FloatArray
    labels: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.centroids)


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Feature vectors: float32[n, k], one row per detection."""

    vectors: Float32Array


@runtime_checkable
class FeatureSpace(Protocol):
    """A space in which target windows are compared; attached under this type with `Frame.attach_as`."""

    @property
    def patch_size(self) -> tuple[int, int]:
        """Height and width of the patches `embed` takes, px."""

    @property
    def version(self) -> int:
        """Goes up whenever vectors of the same patch change."""

    def embed(self, patches: Float32Array) -> Float32Array:
        """float32[n, h, w] grey patches to float32[n, k] vectors."""


class TrackState(enum.StrEnum):
    """Where a track stands in its life."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    LOST = "lost"


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a track's row in a frame comes from.

    Attributes:
        predicted: x and y before the frame was looked at, px; None where nothing was expected.
        detection: row of the frame's `Detections` that was given to the track, or None.
        gate: distance of that detection from the predicted place, standard deviations.
        shared: whether the detection of another track covers this one too.
        similarity: of the window to what the track looks like, 0 to 1; None where that was not asked.
        learnt: whether the track's look was learnt from this frame.
        cause: why the track began, was confirmed or ended in this frame; else empty.
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
        id: number of the target, never reused.
        state: tentative, confirmed, coasting, or lost (its last row).
        x: centre, px of this frame.
        y: centre, px of this frame.
        length: along `angle`, px.
        width: across `angle`, px.
        angle: direction of the length, rad from +x towards +y.
        velocity: px/s on the reference plane.
        covariance: float64[2, 2] of x and y, px squared.
        score: similarity or confidence, 0 to 1.
        age_ns: time since the track began.
        provenance: where the row comes from, if the tracker tells.
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


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """The targets in a frame, in order of their ids."""

    tracks: tuple[Track, ...] = ()


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the camera was and how it looked.

    Attributes:
        latitude: deg, WGS84.
        longitude: deg, WGS84.
        altitude: m above the ellipsoid unless `source` says otherwise.
        heading: platform heading, rad clockwise from north.
        pitch: rad.
        roll: rad.
        sensor_angles: azimuth, elevation, roll of the sensor to the platform, rad.
        field_of_view: horizontal, vertical, rad.
        source: "misb", "dji", "exif", ...
        gap_ns: from the frame to the nearest measurement; negative where that is older.
        is_stale: whether that gap is too long for the pose to be relied on.
    """

    latitude: float
    longitude: float
    altitude: float | None = None
    heading: float | None = None
    pitch: float | None = None
    roll: float | None = None
    sensor_angles: tuple[float, float, float] | None = None
    field_of_view: tuple[float, float] | None = None
    source: str = ""
    gap_ns: int = field(default=0)
    is_stale: bool = False
