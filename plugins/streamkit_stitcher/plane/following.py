"""Fast registration of a frame to the current keyframe, near its predicted homography."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    from_reduced,
    inverse,
    is_plausible,
    to_reduced,
)
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.plane.keyframe_content import LEVELS, at_level, deferred
from streamkit_stitcher.plane.keyframe_matcher import ANY_STEP, ANY_TILT
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.joint_alignment import (
    JointAlignment,
    JointLevel,
    align_coarsely,
    align_jointly,
    joint_level,
    spread_order,
)
from streamkit_stitcher.registration.model_selection import ANY_MOTION, MotionRule
from streamkit_stitcher.registration.motion_models import FitLimits, MotionFit, MotionModel
from streamkit_stitcher.registration.patches import in_view

_CACHED: Final = 10
# A patch of a halved frame is more precise than one of full size: noise is averaged out, slopes remain.
_SMALL: Final = 480
_WIDTH: Final = 960
_COARSE_POINTS: Final = 40
_COARSE_PASSES: Final = 4
_COARSE_SETTLED: Final = 1.0
_MIDDLE_POINTS: Final = 56
_MIDDLE_PASSES: Final = 3
_MIDDLE_SETTLED: Final = 0.7
_MIN_AGREEING: Final = 0.5
_SHARE: Final = 0.68
# A patch is left out after two frames in a row off the plane, and used again after some 20 frames.
_SUSPECT: Final = 1.5
_TRUST: Final = 0.3
_MOSTLY: Final = 0.93
_MEMORY: Final = 0.98
_MAX_SUSPECT: Final = 0.5
# Patches of other levels lie up to a pixel from those of full size and are not the same points.
LEVEL_PATCHES: Final = 1 << 17


def following_level(shape: tuple[int, int]) -> int:
    """How often a frame of (height, width) is halved for the fine alignment; one more for the coarse."""
    level = 0 if shape[1] < _SMALL else 1
    while shape[1] >> level > _WIDTH and level < LEVELS - 2:
        level += 1
    return level


class KeyframeFollower:
    """Registers frames to a keyframe that most of its patches are visible in.

    Takes half the time of `KeyframeMatcher`, which finds more; doubtful cases are left to that. Caches the
    prepared patches of the last few keyframes.
    """

    def __init__(self) -> None:
        self._prepared: dict[tuple[int, int], Callable[[], JointLevel]] = {}
        self._off_plane: dict[int, FloatArray] = {}
        self._latest: tuple[int, int, JointLevel | None] = (-1, 0, None)

    def follow(
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
            images: the frame, down to the coarse level.
            frame_to_key: prediction, right to about 3 px of the coarsest level.
            limits: what the homography must reach; the threshold is in full-size px.
            max_points: patches to use, spread evenly over the overlap.
            rule: motion model.
        """
        if not len(keyframe.points):
            return None
        level = following_level(keyframe.shape)
        if len(images) < level + 2:
            return None
        scores = self._scores_of(keyframe)
        patches, start = self._level(keyframe, level + 1), to_reduced(inverse(frame_to_key), 2 ** (level + 1))
        patches = patches.without(scores[patches.numbers] >= _SUSPECT)
        motion = align_coarsely(
            patches, images[level + 1], start, _COARSE_POINTS, _COARSE_PASSES, _COARSE_SETTLED
        )
        if motion is None:
            return None
        start, image = from_reduced(motion, 2), images[level]
        patches = self._chosen(keyframe, level, start, image.shape, round(_SHARE * max_points))
        motion = align_coarsely(patches, image, start, _MIDDLE_POINTS, _MIDDLE_PASSES, _MIDDLE_SETTLED)
        if motion is None:
            return None
        found = align_jointly(patches, image, motion, limits.ransac_threshold / 2**level)
        if found is None:
            return None
        match = _accepted(found, level, keyframe.shape, limits, rule)
        if match is None:
            # The ground itself may have been suspect.
            scores[:] = 0
        else:
            _update_scores(scores, found)
        return match

    def prepare(self, keyframe: Keyframe, executor: BackgroundExecutor) -> None:
        """Prepares the patches of a new keyframe in the background."""
        level = following_level(keyframe.shape)
        for number in (level + 1, level):
            self._keep((keyframe.index, number), deferred(executor, _prepared, keyframe, number))

    def _chosen(
        self, keyframe: Keyframe, level: int, key_to_frame: FloatArray, shape: tuple[int, ...], most: int
    ) -> JointLevel:
        """At most `most` patches in view that are not suspect."""
        scores = self._scores_of(keyframe)
        index, count, chosen = self._latest
        if (index, count) == (keyframe.index, most) and chosen is not None:
            seen = in_view(chosen.patches, key_to_frame, shape) & (scores[chosen.numbers] < _SUSPECT)
            if np.count_nonzero(seen) > _MOSTLY * len(seen):
                # Copying others costs more than comparing the few that are out of view.
                return chosen.without(~seen)
        whole = self._level(keyframe, level)
        seen = in_view(whole.patches, key_to_frame, shape) & (scores[whole.numbers] < _SUSPECT)
        chosen = whole.part(np.flatnonzero(seen)[:most])
        self._latest = keyframe.index, most, chosen
        return chosen

    def _scores_of(self, keyframe: Keyframe) -> FloatArray:
        """How often each patch of a keyframe was off the plane lately, float64[n]."""
        scores = self._off_plane.pop(keyframe.index, None)
        if scores is None:
            scores = np.zeros(len(keyframe.points))
        self._off_plane[keyframe.index] = scores
        if len(self._off_plane) > _CACHED:
            del self._off_plane[next(iter(self._off_plane))]
        return scores

    def _level(self, keyframe: Keyframe, level: int) -> JointLevel:
        """The patches of a level; only the first at the coarsest."""
        key = (keyframe.index, level)
        prepared = self._prepared.pop(key, None)
        if prepared is None:
            ready = _prepared(keyframe, level)
            self._keep(key, lambda: ready)
            return ready
        self._keep(key, prepared)
        return prepared()

    def _keep(self, key: tuple[int, int], prepared: Callable[[], JointLevel]) -> None:
        self._prepared[key] = prepared
        if len(self._prepared) > _CACHED:
            del self._prepared[next(iter(self._prepared))]


def _prepared(keyframe: Keyframe, level: int) -> JointLevel:
    numbers = spread_order(len(keyframe.points))
    if level > following_level(keyframe.shape):
        numbers = numbers[:_COARSE_POINTS]
    centres = at_level(keyframe.points[numbers], level)
    return joint_level(keyframe.patches[level][numbers], centres, numbers)


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
    matrix, rmse = from_reduced(inverse(found.key_to_frame), factor), found.rmse * factor
    if not is_plausible(matrix, shape, ANY_STEP, ANY_TILT):
        return None
    offset = (factor - 1) / 2
    frame_points, key_points = found.frame_points * factor + offset, found.key_points * factor + offset
    model = MotionModel.HOMOGRAPHY
    if rule.model is not model:
        near = np.isfinite(found.variances)
        every = np.ones(int(np.count_nonzero(near)), dtype=np.bool_)
        allowed = rule.apply(MotionFit(matrix, model, every, rmse), frame_points[near], key_points[near])
        matrix, model, rmse = allowed.matrix, allowed.model, allowed.rmse
    return KeyframeMatch(
        MotionFit(matrix, model, np.arange(found.compared) < agreeing, rmse),
        frame_points,
        key_points,
        found.numbers + LEVEL_PATCHES * level,
        found.deviation * factor,
        found.variances,
        share=agreeing / found.visible_count,
    )
