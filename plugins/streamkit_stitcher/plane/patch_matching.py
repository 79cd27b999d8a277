"""Registration of a frame to a keyframe by its patches, near a predicted homography."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    inverse,
    is_plausible,
    resized,
)
from streamkit_stitcher.plane.keyframe_content import KeyframeContent
from streamkit_stitcher.plane.keyframes import ANY_STEP, ANY_TILT, Keyframe, KeyframeMatch, predicted_error
from streamkit_stitcher.registration.joint_alignment import JointAlignment, align_coarsely, align_jointly
from streamkit_stitcher.registration.model_selection import ANY_MOTION, MotionRule
from streamkit_stitcher.registration.motion_models import FitLimits, MotionFit, MotionModel
from streamkit_stitcher.registration.patches import PatchLevel, in_view, prepare

_CACHED: Final = 10
# Patches, iterations, and displacement in px of the last iteration, at the coarse level and at the fine one.
_COARSE: Final = (40, 4, 1.0)
_MIDDLE: Final = (56, 3, 0.7)
_MIN_AGREEING: Final = 0.5
_SHARE: Final = 0.68
# A patch is left out after two frames in a row off the plane, and used again after some 20 frames.
_SUSPECT: Final = 1.5
_TRUST: Final = 0.3
_MEMORY: Final = 0.98
_MAX_SUSPECT: Final = 0.5


@dataclass(frozen=True, eq=False)
class _Prepared:
    """The patches of a keyframe, their level, and how often each was off the plane lately, float64[n]."""

    level: int
    coarse: PatchLevel
    fine: PatchLevel
    scores: FloatArray

    def in_view(
        self, patches: PatchLevel, key_to_frame: FloatArray, image: GreyArray, most: int
    ) -> PatchLevel:
        """At most `most` of some patches, of those in view and not lately off the plane."""
        (height, width), centres, usable = image.shape, patches.centres, patches.usable
        seen = in_view(centres, usable, self.scores, _SUSPECT, key_to_frame, height, width, most)
        return PatchLevel(
            centres[seen], patches.probes, patches.inverse_hessian[seen], usable[seen], patches.numbers[seen]
        )


class PatchMatcher:
    """Registers frames to keyframes by their patches; keeps the prepared patches of the last few."""

    def __init__(self) -> None:
        self._prepared = lru_cache(maxsize=_CACHED)(_prepared)

    def match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        frame_to_key: FloatArray,
        limits: FitLimits,
        max_points: int,
        rule: MotionRule = ANY_MOTION,
    ) -> KeyframeMatch | None:
        """Registers a frame to a keyframe with sub-pixel accuracy; None unless half of the patches agree.

        Args:
            keyframe: the keyframe.
            images: the frame and its halvings.
            frame_to_key: prediction, right to about 3 px of the coarse level.
            limits: what the homography must reach; the threshold is in full-size px.
            max_points: patches to use, spread evenly over the overlap.
            rule: motion model.
        """
        known = self._prepared(keyframe.content())
        level = known.level
        if not len(known.scores) or len(images) < level + 2:
            return None
        start, image = resized(inverse(frame_to_key), 1 / 2 ** (level + 1)), images[level + 1]
        patches = known.in_view(known.coarse, start, image, _COARSE[0])
        motion = align_coarsely(patches, image, start, *_COARSE)
        if motion is None:
            return None
        start, image = resized(motion, 2), images[level]
        patches = known.in_view(known.fine, start, image, round(_SHARE * max_points))
        motion = align_coarsely(patches, image, start, *_MIDDLE)
        if motion is None:
            return None
        found = align_jointly(patches, image, motion, limits.ransac_threshold / 2**level)
        if found is None:
            return None
        match = _accepted(found, level, keyframe.shape, limits, rule)
        if match is None:
            # The ground itself may have been suspect.
            known.scores[:] = 0
        else:
            _update_scores(known.scores, found)
        return match


def _prepared(content: KeyframeContent) -> _Prepared:
    coarse = prepare(content.coarse, content.coarse_centres)
    fine = prepare(content.fine, content.fine_centres)
    return _Prepared(content.level, coarse, fine, np.zeros(len(fine.numbers)))


def _update_scores(scores: FloatArray, found: JointAlignment) -> None:
    """Raises the scores of patches off the plane; all others decay.

    Parallax of roofs grows with the distance flown: patches that the first few frames tell from the ground
    are left out when they would bend the plane most.
    """
    scores *= _MEMORY
    scores[found.on_plane] *= _TRUST
    scores[found.off_plane] += 1
    if np.count_nonzero(scores >= _SUSPECT) > _MAX_SUSPECT * len(scores):
        scores[:] = 0


def _accepted(
    found: JointAlignment, level: int, shape: tuple[int, int], limits: FitLimits, rule: MotionRule
) -> KeyframeMatch | None:
    agreeing, factor = len(found.numbers), 2**level
    if agreeing < max(limits.min_inliers, _MIN_AGREEING * found.visible_count):
        return None
    matrix, rmse = resized(inverse(found.key_to_frame), factor), found.rmse * factor
    if not is_plausible(matrix, shape, ANY_STEP, ANY_TILT):
        return None
    offset, near = (factor - 1) / 2, np.isfinite(found.variances)
    frame_points, key_points = found.frame_points * factor + offset, found.key_points * factor + offset
    every = np.ones(np.count_nonzero(near), dtype=np.bool_)
    fit = rule.apply(
        MotionFit(matrix, MotionModel.HOMOGRAPHY, every, rmse), frame_points[near], key_points[near]
    )
    share = agreeing / found.visible_count
    return KeyframeMatch(
        MotionFit(fit.matrix, fit.model, np.arange(found.compared) < agreeing, fit.rmse),
        frame_points,
        key_points,
        found.numbers,
        found.deviation * factor,
        predicted_error(found.deviation * factor, share),
        found.variances,
        share,
    )
