"""Coarse-to-fine registration of a frame to a keyframe, patch by patch."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    from_reduced,
    inverse,
    is_plausible,
    overlap,
    project,
    to_reduced,
    translation,
)
from streamkit_stitcher.plane.keyframe_content import at_level
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.gauss_newton import corner_deviation
from streamkit_stitcher.registration.model_selection import ANY_MOTION, MotionRule
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel, fit_homography
from streamkit_stitcher.registration.patch_search import Alignment, align
from streamkit_stitcher.registration.patches import OFF_PLANE, SMALLEST_STD, PatchLevel, prepare

_CACHED: Final = 12
_COARSE_POINTS: Final = 96
_COARSE_INLIERS: Final = 12
_COARSE_THRESHOLD: Final = 1.5
_COARSE_TOLERANCE: Final = 0.2
_FINE_TOLERANCE: Final = 0.1
ANY_STEP: Final = 10.0
# A camera that looks obliquely and turns halves the scale of one side of the frame.
ANY_TILT: Final = 1.0
_WIDE_OVERLAP: Final = 0.8


class KeyframeMatcher:
    """Registers frames to keyframes; caches the prepared patches of the last few keyframes."""

    def __init__(self) -> None:
        self._prepared: dict[tuple[int, int, int], tuple[PatchLevel, npt.NDArray[np.int64]]] = {}

    def match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        frame_to_key: FloatArray,
        limits: FitLimits,
        *,
        top_level: int,
        max_points: int,
        rule: MotionRule = ANY_MOTION,
    ) -> KeyframeMatch | None:
        """Registers a frame to a keyframe with sub-pixel accuracy; None where too few patches agree.

        Args:
            keyframe: the keyframe.
            images: the frame.
            frame_to_key: prediction, right to about 3 * 2**top_level px.
            limits: what the homography must reach; the threshold is in full-size px.
            top_level: coarsest level to start from, 0 for full size only.
            max_points: patches to use, spread evenly over the keyframe.
            rule: motion model.
        """
        top_level = min(top_level, len(images) - 1, len(keyframe.patches) - 1)
        key_to_frame = inverse(frame_to_key)
        if overlap(frame_to_key, keyframe.shape) < _WIDE_OVERLAP:
            # Keeps the number of patches in view; the corners beyond them need them most.
            max_points += max_points // 2
        for level in range(top_level, -1, -1):
            patches, chosen = self._level(keyframe, level, _COARSE_POINTS if level == 1 else max_points)
            expected = to_reduced(key_to_frame, 2**level)
            tolerance = _COARSE_TOLERANCE if level else _FINE_TOLERANCE
            found = align(patches, images[level], expected, tolerance)
            if level == 0:
                return _accepted(found, chosen, keyframe.shape, limits, rule, inverse(key_to_frame))
            start = _shifted(expected, found.key_points, found.frame_points)
            coarse = fit_homography(found.key_points, found.frame_points, _COARSE_THRESHOLD, start=start)
            if (
                coarse is not None
                and coarse.count >= min(limits.min_inliers, _COARSE_INLIERS)
                and coarse.count >= limits.min_inlier_ratio * found.visible_count
                and is_plausible(coarse.matrix, keyframe.shape, ANY_STEP, ANY_TILT)
            ):
                key_to_frame = from_reduced(coarse.matrix, 2**level)
        return None

    def _level(self, keyframe: Keyframe, level: int, most: int) -> tuple[PatchLevel, npt.NDArray[np.int64]]:
        """At most `most` patches of a level, evenly chosen, and their indices."""
        key = (keyframe.index, level, most)
        prepared = self._prepared.pop(key, None)
        if prepared is None:
            count = len(keyframe.points)
            chosen = np.arange(count)
            if count > most:
                chosen = np.linspace(0, count - 1, most).astype(np.int64)
            points = at_level(keyframe.points[chosen], level)
            prepared = prepare(keyframe.patches[level][chosen], points), chosen
        self._prepared[key] = prepared
        if len(self._prepared) > _CACHED:
            del self._prepared[next(iter(self._prepared))]
        return prepared


def _shifted(expected: FloatArray, source: FloatArray, target: FloatArray) -> FloatArray:
    """An expected motion, source to target, shifted by the median residual."""
    if not len(source):
        return expected
    residuals = target - project(expected, source)
    middle = len(residuals) // 2
    return translation(np.partition(residuals, middle, axis=0)[middle]) @ expected


def _accepted(
    found: Alignment,
    chosen: npt.NDArray[np.int64],
    shape: tuple[int, int],
    limits: FitLimits,
    rule: MotionRule,
    start: FloatArray,
) -> KeyframeMatch | None:
    """The match that the patches agree on, or None.

    Inliers are counted relative to the patches in view, not to those that converged: on other ground a sixth
    of the patches converges, and nearly all of these agree with some homography.
    """
    frame_points, key_points = found.frame_points, found.key_points
    weights = 1 / (found.variances + SMALLEST_STD**2)
    fit = fit_homography(frame_points, key_points, limits.ransac_threshold, start=start, weights=weights)
    if fit is None or fit.count < max(limits.min_inliers, limits.min_inlier_ratio * found.visible_count):
        return None
    fit = rule.apply(fit, frame_points, key_points)
    if not is_plausible(fit.matrix, shape, ANY_STEP, ANY_TILT):
        return None
    patches = chosen[found.patches[fit.inliers]]
    inliers = frame_points[fit.inliers]
    freedom = 8 if fit.model is MotionModel.HOMOGRAPHY else 6
    deviation = corner_deviation(fit.matrix, inliers, fit.rmse, shape, freedom)
    residuals = project(fit.matrix, inliers) - key_points[fit.inliers]
    squares = np.einsum("ni,ni->n", residuals, residuals) * weights[fit.inliers]
    off_plane = squares > OFF_PLANE * np.median(squares)
    variances = np.where(off_plane, np.inf, found.variances[fit.inliers])
    share = fit.count / found.visible_count
    return KeyframeMatch(fit, inliers, key_points[fit.inliers], patches, deviation, variances, share=share)
