"""Keyframes, and the matches of frames with them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    centre,
    corner_shift,
    inverse,
    normalised,
    overlap,
    project,
    scale_change,
    tilt,
)
from streamkit_stitcher.plane.frame_registration import OK_STD
from streamkit_stitcher.plane.keyframe_content import KeyframeContent
from streamkit_stitcher.registration.descriptors import FrameFeatures
from streamkit_stitcher.registration.motion_models import MotionFit

_SCALE_RANGE: Final = (0.7, 1.4)
# Distance of the middles of frames of these scales, in diagonals, beyond which they do not overlap.
_FAR: Final = 1.5
# A frame of another scale than its keyframe, or seen much more obliquely, becomes a keyframe.
_KEPT_SCALES: Final = (0.8, 1.25)
_MAX_TILT: Final = 0.5
# A keyframe is replaced where a frame's error exceeds this, px: two in a row add up to less than `OK_STD`.
# After less motion, by the width, it would not help; where fewer patches agree, the new one may show movers.
_OUTWORN_STD: Final = 0.6
_OUTWORN_SHIFT: Final = 0.05
_OUTWORN_SHARE: Final = 0.85
# Smallest deviation at a corner, px: lens, shutter and compression. Rendered flights without these are off by
# 0.12 to 0.13 px (root mean square), of which the fit explains about half.
MIN_CORNER_STD: Final = 0.1
_MIN_SHARE: Final = 0.05
# Errors of neighbouring points are alike: four count as one.
_ALIKE: Final = 4
# Limits of a frame's motion from a keyframe: a camera that looks obliquely and turns halves the scale of one
# side of the frame.
ANY_STEP: Final = 10.0
ANY_TILT: Final = 1.0
# Distance of keyframes of different planes, px: these stay while any two of one plane are nearer.
_ANOTHER_PLANE: Final = 1e12


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A keyframe.

    Attributes:
        index: number of the keyframe, never reused.
        to_reference: full-size pixels to the reference plane.
        shape: of the frame.
        factor: the reduction of `small`.
        content: returns what is kept of its pixels; waits until that is computed.
        corner_std: predicted error when it was added, px; 0 where that is small.
        plane: number of its reference plane.
    """

    index: int
    to_reference: FloatArray
    shape: tuple[int, int]
    factor: int
    content: Callable[[], KeyframeContent]
    corner_std: float = 0.0
    plane: int = 0

    @property
    def small(self) -> GreyArray:
        """uint8[h, w], the frame at working size."""
        return self.content().small

    @property
    def features(self) -> FrameFeatures:
        """The features of the frame."""
        return self.content().features


@dataclass(frozen=True, eq=False)
class KeyframeMatch:
    """A frame registered to a keyframe.

    Attributes:
        fit: the homography from the frame's pixels to the keyframe's, with its inliers.
        frame_points: float64[n, 2], the inliers in the frame, px.
        key_points: float64[n, 2], the same points in the keyframe, px.
        patches: int64[n], numbers of the keyframe's patches.
        deviation: standard deviation of the fit at the worst corner of the frame, px.
        corner_std: predicted error at the worst corner, px, systematic errors included.
        variances: float64[n], of each patch's position, in any unit, infinite off the plane; None if unknown.
        share: patches that agree, as a part of those in view.
    """

    fit: MotionFit
    frame_points: FloatArray
    key_points: FloatArray
    patches: npt.NDArray[np.int64]
    deviation: float
    corner_std: float
    variances: FloatArray | None = None
    share: float = 1.0

    def on_plane(self) -> "KeyframeMatch":
        """The match without the patches off the plane."""
        if self.variances is None:
            return self
        kept = np.isfinite(self.variances)
        return replace(
            self,
            frame_points=self.frame_points[kept],
            key_points=self.key_points[kept],
            patches=self.patches[kept],
            variances=self.variances[kept],
        )


def predicted_error(deviation: float, share: float = 1.0) -> float:
    """Predicted error of a match at the worst corner, px, larger as a smaller share agrees.

    Args:
        deviation: of the fit, for points with independent errors.
        share: of the points in view that agree.
    """
    return math.hypot(MIN_CORNER_STD, math.sqrt(_ALIKE) * deviation / max(_MIN_SHARE, share) ** 2)


def overlap_at_like_scale(keyframe: Keyframe, to_reference: FloatArray, shape: tuple[int, int]) -> float:
    """The part of a frame that a keyframe of its plane shows at a similar scale, 0 to 1."""
    to_key, middle = inverse(keyframe.to_reference) @ to_reference, centre(shape)
    apart = project(to_key, middle[np.newaxis]) - middle
    # Most of a hundred are far away, and an exact overlap takes a tenth of a millisecond.
    is_far = np.hypot(*apart[0]) > _FAR * np.hypot(*shape)
    if is_far or not _SCALE_RANGE[0] < scale_change(to_key, shape) < _SCALE_RANGE[1]:
        return 0.0
    return overlap(to_key, shape)


def most_overlapping(
    keyframes: Sequence[Keyframe], to_reference: FloatArray, shape: tuple[int, int], least: float
) -> list[Keyframe]:
    """The keyframes of a plane that overlap a frame by a part of at least `least`, most first."""
    shares = np.array([overlap_at_like_scale(one, to_reference, shape) for one in keyframes])
    order = np.argsort(-shares, kind="stable")
    return [keyframes[number] for number in order if shares[number] >= max(least, 1e-9)]


def most_redundant(keyframes: Sequence[Keyframe]) -> int:
    """Position of the older of the two nearest keyframes of a plane; the newest and the first always stay."""
    middles = np.array([project(one.to_reference, centre(one.shape)[np.newaxis])[0] for one in keyframes])
    distances = np.hypot(*(middles[:, np.newaxis] - middles[np.newaxis]).transpose(2, 0, 1))
    planes = np.array([one.plane for one in keyframes])
    distances[planes[:, np.newaxis] != planes] = _ANOTHER_PLANE
    distances[np.tril_indices(len(middles))] = np.inf
    distances[0] = np.inf
    return int(np.unravel_index(int(np.argmin(distances)), distances.shape)[0])


def is_leaving(
    keyframe: Keyframe, to_reference: FloatArray, match: KeyframeMatch | None, least: float
) -> bool:
    """Whether a frame leaves its keyframe: overlap, tilt or scale differ too much, or the match is too bad.

    The latter while the frame is still ok: relief moves patches off the plane long before they leave the
    frame, and a later frame would hand on its larger error to all that follow.

    Args:
        keyframe: the keyframe.
        to_reference: float64[3, 3], the frame to the plane.
        match: of the frame with the keyframe; None where there is none.
        least: smallest overlap.
    """
    to_key, shape = normalised(inverse(keyframe.to_reference) @ to_reference), keyframe.shape
    is_scaled = not _KEPT_SCALES[0] < scale_change(to_key, shape) < _KEPT_SCALES[1]
    if is_scaled or tilt(to_key, shape) > _MAX_TILT or overlap(to_key, shape) < least:
        return True
    if match is None or match.share < _OUTWORN_SHARE or not _OUTWORN_STD < match.corner_std <= OK_STD:
        return False
    return corner_shift(match.fit.matrix, shape) > _OUTWORN_SHIFT * shape[1]
