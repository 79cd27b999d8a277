"""Registration of frames to keyframes without a prediction, by features."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import corners, is_plausible, overlap
from streamkit_stitcher.plane.keyframes import ANY_STEP, ANY_TILT, Keyframe, KeyframeMatch, predicted_error
from streamkit_stitcher.registration.descriptors import FrameFeatures, match_features
from streamkit_stitcher.registration.gauss_newton import deviation_at
from streamkit_stitcher.registration.motion_models import MotionFit
from streamkit_stitcher.registration.wide_baseline import fit_wide_baseline

# Features of each keyframe that are compared to find the likeliest, and matches below which none is likely.
_STRONGEST: Final = 600
_MIN_MATCHES: Final = 8
_MIN_INLIERS: Final = 20
_MIN_RATIO: Final = 0.25
# Wide enough for trees and roofs, which are off the plane; px of the image with the features.
_THRESHOLD: Final = 4.0
_MIN_OVERLAP: Final = 0.08
# Photographs from half or twice the height.
_MAX_AREA_SCALE: Final = 5.0
# Features stand for patches of the keyframe, with numbers beyond those of its real ones.
_FIRST_FEATURE: Final = 1 << 16


def likeliest(frame: FrameFeatures, keyframes: Sequence[Keyframe], most: int) -> list[Keyframe]:
    """At most `most` keyframes, by their number of matches among a few hundred features each."""
    part = _strongest(frame)
    counts = [len(match_features(part, _strongest(keyframe.features))[0]) for keyframe in keyframes]
    order = np.argsort(-np.array(counts), kind="stable")[:most]
    return [keyframes[number] for number in order if counts[number] >= _MIN_MATCHES]


def match_by_features(frame: FrameFeatures, keyframe: Keyframe) -> KeyframeMatch | None:
    """Registers a frame of the same size to a keyframe; None where it does not match."""
    known = keyframe.features
    own, other = match_features(frame, known)
    fewest = max(_MIN_INLIERS, _MIN_RATIO * len(own))
    threshold = _THRESHOLD * max(frame.factor, known.factor)
    fit = fit_wide_baseline(frame.points[own], known.points[other], threshold, fewest)
    if fit is None:
        return None
    own, other = own[fit.inliers], other[fit.inliers]
    if not (
        overlap(fit.matrix, keyframe.shape) > _MIN_OVERLAP
        and is_plausible(fit.matrix, keyframe.shape, ANY_STEP, ANY_TILT, _MAX_AREA_SCALE)
    ):
        return None
    deviation = deviation_at(corners(keyframe.shape), fit.matrix, frame.points[own], fit.rmse)
    return KeyframeMatch(
        MotionFit(fit.matrix, fit.model, np.ones(fit.count, dtype=np.bool_), fit.rmse),
        frame.points[own],
        known.points[other],
        other + _FIRST_FEATURE,
        deviation,
        predicted_error(deviation),
    )


def _strongest(description: FrameFeatures) -> FrameFeatures:
    """The features of the highest contrast, which other views show most likely."""
    part = slice(_STRONGEST)
    return replace(description, points=description.points[part], descriptors=description.descriptors[part])
