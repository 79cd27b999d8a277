"""What is said about one picture's place."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, corners


class Status(StrEnum):
    """How far a placement can be trusted.

    `ok` and `still` were measured against a key picture, `weak` is only carried on by the motion since the
    picture before or was told by a part of the picture, `lost` is a guess, and `cut` opens another plane.
    """

    OK = "ok"
    WEAK = "weak"
    LOST = "lost"
    CUT = "cut"
    STILL = "still"


@dataclass(frozen=True, eq=False)
class Anchored:
    """A picture's place after comparison with key pictures.

    Attributes:
        to_reference: float64[3, 3], the picture's pixels to the reference plane.
        measured: whether a key picture was found in it; otherwise the place is the one carried forward.
        change: float64[3, 3], how the plane moved under the picture, old to new, because another key picture
            took over or places were adjusted; None where it did not.
        keyframe: whether the picture became a key picture.
        matches: patches compared.
        inliers: patches that agree with the place.
        rmse: root mean square distance of the inliers, px.
        sure: whether what was measured tells where the whole picture lies, not only a part of it.
    """

    to_reference: FloatArray
    measured: bool
    change: FloatArray | None = None
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0
    sure: bool = True


@dataclass(frozen=True, eq=False)
class Placement:
    """Where one picture lies.

    Attributes:
        to_previous: float64[3, 3], its pixels to those of the picture before it in the stream.
        to_reference: float64[3, 3], its pixels to the reference plane.
        reference: number of the reference plane; it goes up at each restart and each change of the plane.
        status: how far the matrices can be trusted.
        change: float64[3, 3], old plane to new where the plane moved under this picture, else None.
        keyframe: whether the picture became a key picture.
        matches: points compared.
        inliers: matches that agree with the motion.
        rmse: root mean square distance of the inliers, px.
        anchored: whether `to_reference` was measured against a key picture and not only carried forward.
        key_index: the key picture it was measured against, or that it became.
        to_key: float64[3, 3], its pixels to those of that key picture.
        exchange: float64[3, 3], the part of `change` by which all of the plane went, and not only what lies
            about this picture: another key picture's plane became the reference; None where none did.
        opens: whether the plane that this picture opens cannot be drawn on with the one before, though
            `change` relates them.
    """

    to_previous: FloatArray
    to_reference: FloatArray
    reference: int
    status: Status
    change: FloatArray | None = None
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0
    anchored: bool = False
    key_index: int = 0
    to_key: FloatArray = field(default_factory=lambda: IDENTITY)
    exchange: FloatArray | None = None
    opens: bool = False


def drawn_out(to_plane: FloatArray, shape: tuple[int, int]) -> float:
    """How much farther away the far side of a picture is than its near side, on a plane.

    Args:
        to_plane: float64[3, 3], the picture's pixels to the plane.
        shape: (height, width) of the picture, px.

    Returns:
        1 for a camera that looks straight down on the plane; infinite where the horizon is in view. The
        picture is drawn out by the square of it.
    """
    depths = to_plane[2, :2] @ corners(shape).T + to_plane[2, 2]
    near, far = float(np.min(depths)), float(np.max(depths))
    return far / near if near > 0 else float("inf")
