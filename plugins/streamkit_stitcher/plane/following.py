"""Following a key picture from frame to frame, near the place where it is expected."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from streamkit_stitcher.homographies import (
    FloatArray,
    GreyArray,
    from_reduced,
    inverse,
    is_plausible,
    overlap,
)
from streamkit_stitcher.plane.keyframes import ANY_STEP, LEVELS, Keyframe, KeyframeMatch, at_level
from streamkit_stitcher.registration.joint_alignment import (
    JointAlignment,
    JointLevel,
    align_coarsely,
    align_jointly,
    joint_level,
    spread_order,
)
from streamkit_stitcher.registration.motion_models import FitLimits, MotionFit, MotionModel, restricted
from streamkit_stitcher.registration.patches import reduced_motion

_PREPARED: Final = 10
# Of a halved picture a patch tells more than of the whole one: noise is averaged out, and slopes are left.
_SMALL: Final = 480
_WIDTH: Final = 960
_COARSE_POINTS: Final = 40
_COARSE_PASSES: Final = 4
_COARSE_SETTLED: Final = 1.0
_MIDDLE_POINTS: Final = 56
_MIDDLE_PASSES: Final = 3
_MIDDLE_SETTLED: Final = 0.7
_EVIDENT: Final = 0.5
_WIDE_OVERLAP: Final = 0.8
_SHARE: Final = 0.75
# Patches of other levels lie up to a pixel from those of full size and are not the same points.
LEVEL_PATCHES: Final = 1 << 17


def following_level(shape: tuple[int, int]) -> int:
    """How often a picture of (height, width) is halved to be followed; once more to begin with."""
    level = 0 if shape[1] < _SMALL else 1
    while shape[1] >> level > _WIDTH and level < LEVELS - 2:
        level += 1
    return level


class KeyframeFollower:
    """Places pictures on key pictures that most of their patches show; keeps what it worked out of the last.

    It takes half the time of `KeyframeMatcher`, which finds more: what is doubtful is left to that.
    """

    def __init__(self) -> None:
        self._prepared: dict[tuple[int, int], JointLevel] = {}

    def follow(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        frame_to_key: FloatArray,
        limits: FitLimits,
        max_points: int,
        model: MotionModel = MotionModel.HOMOGRAPHY,
    ) -> KeyframeMatch | None:
        """Places a picture on a key picture to sub-pixel accuracy.

        Args:
            keyframe: the key picture.
            images: the picture and its halvings, coarse enough to begin with.
            frame_to_key: float64[3, 3], predicted motion, right to about 3 px of the coarsest.
            limits: what the homography must reach; its threshold counts in full-size px.
            max_points: patches to use, spread evenly over what both pictures share.
            model: what the motion may be.

        Returns:
            The match, or None unless half of the patches in view agree.
        """
        if not len(keyframe.points):
            return None
        level = following_level(keyframe.shape)
        if len(images) < level + 2:
            return None
        motion = align_coarsely(
            self._level(keyframe, level + 1),
            images[level + 1],
            reduced_motion(inverse(frame_to_key), level + 1),
            _COARSE_POINTS,
            _COARSE_PASSES,
            _COARSE_SETTLED,
        )
        if motion is None:
            return None
        patches, image, motion = self._level(keyframe, level), images[level], from_reduced(motion, 2)
        motion = align_coarsely(patches, image, motion, _MIDDLE_POINTS, _MIDDLE_PASSES, _MIDDLE_SETTLED)
        if motion is None:
            return None
        count = round(_SHARE * max_points)
        if overlap(inverse(motion), (image.shape[0], image.shape[1])) < _WIDE_OVERLAP:
            # About as many are in view as otherwise; the corners beyond them need them most.
            count = max_points
        found = align_jointly(patches, image, motion, count, limits.threshold / 2**level)
        return None if found is None else _accepted(found, level, keyframe.shape, limits, model)

    def _level(self, keyframe: Keyframe, level: int) -> JointLevel:
        """The patches of a level; only the first at the coarsest."""
        key = (keyframe.index, level)
        prepared = self._prepared.pop(key, None)
        if prepared is None:
            numbers = spread_order(len(keyframe.points))
            if level > following_level(keyframe.shape):
                numbers = numbers[:_COARSE_POINTS]
            centres = at_level(keyframe.points[numbers], level)
            prepared = joint_level(keyframe.patches[level][numbers], centres, numbers)
        self._prepared[key] = prepared
        if len(self._prepared) > _PREPARED:
            del self._prepared[next(iter(self._prepared))]
        return prepared


def _accepted(
    found: JointAlignment, level: int, shape: tuple[int, int], limits: FitLimits, model: MotionModel
) -> KeyframeMatch | None:
    agreeing, factor = len(found.numbers), 2**level
    if agreeing < max(limits.min_inliers, _EVIDENT * found.sought):
        return None
    matrix, rmse = from_reduced(inverse(found.key_to_frame), factor), found.rmse * factor
    if not is_plausible(matrix, shape, ANY_STEP):
        return None
    offset = (factor - 1) / 2
    frame_points, key_points = found.frame_points * factor + offset, found.key_points * factor + offset
    if model is not MotionModel.HOMOGRAPHY:
        every = np.ones(agreeing, dtype=np.bool_)
        whole = MotionFit(matrix, MotionModel.HOMOGRAPHY, every, rmse)
        simple = restricted(whole, model, frame_points, key_points)
        matrix, model, rmse = simple.matrix, simple.model, simple.rmse
    return KeyframeMatch(
        MotionFit(matrix, model, np.arange(found.compared) < agreeing, rmse),
        frame_points,
        key_points,
        found.numbers + LEVEL_PATCHES * level,
        found.deviation * factor,
        found.variances,
    )
