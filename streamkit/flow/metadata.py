"""Metadata types that elements attach to frames.

Pixel coordinates: x right, y down, (0, 0) the centre of the top-left pixel. Angles in radians from +x
towards +y. Times in nanoseconds. Arrays are float64 unless said.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from streamkit.geometry.registration_status import RegistrationStatus
from streamkit.geometry.track import Track

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    Float32Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Registration of a frame to its predecessor and to a common ground plane.

    Attributes:
        to_previous: float64[3, 3], maps pixels of this frame to the previous frame.
        to_reference: float64[3, 3], maps pixels of this frame to the reference plane.
        reference: id of the reference plane.
        reference_change: float64[3, 3] old plane to new, on the frame where the plane changes, else None.
        keyframe: whether this frame became a keyframe.
        matches: matched points.
        inliers: points consistent with the homography.
        rmse: root mean square residual of the inliers, px.
        corner_std: predicted error of `to_reference` at the frame's worst corner, px; None if unknown.
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
    corner_std: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class HiddenPixels:
    """Pixels of a frame that do not show the scene, such as those of a HUD, a logo or a time stamp.

    Attributes:
        mask: uint8[h, w] of the frame's size, 255 where hidden, else 0.
    """

    mask: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """Objects detected in a frame, one row each.

    Attributes:
        centroids: float64[n, 2], x y px.
        boxes: float64[n, 4], x0 y0 x1 y1 px.
        areas: float64[n], px.
        scores: float64[n], 0 to 1.
        labels: n class names, "" where unknown; or none at all.
        are_objects: whether each box is one whole object, as a detector of objects gives them; else boxes are
            regions of motion, which may show a part of a target, or several.
    """

    centroids: FloatArray
    boxes: FloatArray
    areas: FloatArray
    scores: FloatArray
    labels: tuple[str, ...] = ()
    are_objects: bool = False

    def __post_init__(self) -> None:
        """Refuses columns that do not fit each other, which elements would drop or fail on much later.

        Raises:
            ValueError: a column has another shape, a box ends before it begins, or an area or score is NaN.
        """
        count = len(self.centroids)
        shapes = {"centroids": (count, 2), "boxes": (count, 4), "areas": (count,), "scores": (count,)}
        for name, shape in shapes.items():
            found = getattr(getattr(self, name), "shape", None)
            if found != shape:
                got = "no array" if found is None else f"shape {found}"
                raise ValueError(f"{name} of {count} detections must be an array of shape {shape}, got {got}")
        if len(self.labels) not in (0, count):
            raise ValueError(f"labels of {count} detections must be {count} or none, got {len(self.labels)}")
        for name in ("areas", "scores"):  # of a target's record, which has no word for NaN
            if not all(map(math.isfinite, getattr(self, name))):
                raise ValueError(f"{name} of detections must be finite, got {getattr(self, name).tolist()}")
        is_reversed = (self.boxes[:, 2:] < self.boxes[:, :2]).any(axis=1)
        if is_reversed.any():
            box = self.boxes[is_reversed.argmax()].tolist()
            raise ValueError(f"a box is x0 y0 x1 y1, not left top width height, got {box}")

    def __len__(self) -> int:
        return len(self.centroids)


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Feature vectors: float32[n, k], one row per detection."""

    vectors: Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """The targets in a frame, in order of their ids."""

    tracks: tuple[Track, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class GroundReference:
    """The positions of a frame's pixels on flat ground.

    Attributes:
        to_local: float64[3, 3], pixels to metres east and north of the origin.
        latitude, longitude: of the origin, deg, WGS84: the middle of the positions that it rests on.
        error_m: standard deviation of a place there.
        spread_m: root mean square distance of those positions from the origin.
    """

    to_local: FloatArray
    latitude: float
    longitude: float
    error_m: float
    spread_m: float

    def error_at(self, places: FloatArray) -> FloatArray:
        """Standard deviations, m, of places float64[n, 2], m from the origin, float64[n].

        Turn and scale are as uncertain as positions are against their spread: positions of satellite
        navigation have errors in common, so that more of them do not help.
        """
        found: FloatArray = self.error_m * (1 + (places**2).sum(axis=1) / self.spread_m**2) ** 0.5
        return found
