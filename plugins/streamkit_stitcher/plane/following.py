"""Following a key picture from frame to frame, near the place where it is expected."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    from_reduced,
    inverse,
    is_plausible,
)
from streamkit_stitcher.plane.key_picture import LEVELS, Beside, at_level
from streamkit_stitcher.plane.keyframes import ANY_STEP, Keyframe, KeyframeMatch
from streamkit_stitcher.registration.joint_alignment import JointAlignment, align_coarsely, align_jointly
from streamkit_stitcher.registration.joint_level import JointLevel, joint_level, spread_order
from streamkit_stitcher.registration.model_selection import ANY_MOTION, MotionRule
from streamkit_stitcher.registration.motion_models import FitLimits, MotionFit, MotionModel
from streamkit_stitcher.registration.patches import in_view, reduced_motion

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
# Out of focus, patches agree on a place some px off: fewer do, and none looks like the key picture's.
_EVENLY: Final = 0.75
_SHARP: Final = 0.9
_SHARE: Final = 0.68
# A camera that looks aslant and turns halves the scale of one side of the picture within a second or two.
_ANY_TILT: Final = 1.0
# A patch is left out when it was off the plane twice in a row, and looked at again after some 20 pictures.
_DOUBTED: Final = 1.5
_TRUST: Final = 0.3
_MOSTLY: Final = 0.93
_MEMORY: Final = 0.98
_MOST_DOUBTED: Final = 0.5
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
        self._prepared: dict[tuple[int, int], Callable[[], JointLevel]] = {}
        self._doubts: dict[int, FloatArray] = {}
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
        """Places a picture on a key picture to sub-pixel accuracy.

        Args:
            keyframe: the key picture.
            images: the picture and its halvings, coarse enough to begin with.
            frame_to_key: float64[3, 3], predicted motion, right to about 3 px of the coarsest.
            limits: what the homography must reach; its threshold counts in full-size px.
            max_points: patches to use, spread evenly over what both pictures share.
            rule: what the motion may be.

        Returns:
            The match, or None unless half of the patches in view agree.
        """
        if not len(keyframe.points):
            return None
        level = following_level(keyframe.shape)
        if len(images) < level + 2:
            return None
        doubts = self._doubts_of(keyframe)
        patches, start = self._level(keyframe, level + 1), reduced_motion(inverse(frame_to_key), level + 1)
        patches = patches.without(doubts[patches.numbers] >= _DOUBTED)
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
        found = align_jointly(patches, image, motion, limits.threshold / 2**level)
        if found is None:
            return None
        match = _accepted(found, level, keyframe.shape, limits, rule)
        if match is None:
            # It may be the ground that was doubted.
            doubts[:] = 0
        elif match.clear:
            _learn(doubts, found)
        return match

    def _chosen(
        self, keyframe: Keyframe, level: int, key_to_frame: FloatArray, shape: tuple[int, ...], most: int
    ) -> JointLevel:
        """At most `most` patches in view that are not doubted."""
        doubts = self._doubts_of(keyframe)
        index, count, chosen = self._latest
        if (index, count) == (keyframe.index, most) and chosen is not None:
            seen = in_view(chosen.patches, key_to_frame, shape) & (doubts[chosen.numbers] < _DOUBTED)
            if np.count_nonzero(seen) > _MOSTLY * len(seen):
                # Copying others costs more than comparing the few that are not seen any more.
                return chosen.without(~seen)
        whole = self._level(keyframe, level)
        seen = in_view(whole.patches, key_to_frame, shape) & (doubts[whole.numbers] < _DOUBTED)
        chosen = whole.part(np.flatnonzero(seen)[:most])
        self._latest = keyframe.index, most, chosen
        return chosen

    def _doubts_of(self, keyframe: Keyframe) -> FloatArray:
        """How often each patch of a key picture was seen off the plane lately, float64[n]."""
        doubts = self._doubts.pop(keyframe.index, None)
        if doubts is None:
            doubts = np.zeros(len(keyframe.points))
        self._doubts[keyframe.index] = doubts
        if len(self._doubts) > _PREPARED:
            del self._doubts[next(iter(self._doubts))]
        return doubts

    def expect(self, keyframe: Keyframe, beside: Beside) -> None:
        """Has what pictures are followed by worked out beside the stream, for a new key picture."""
        level = following_level(keyframe.shape)
        for number in (level + 1, level):
            self._keep((keyframe.index, number), beside.begin(_prepared, keyframe, number))

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
        if len(self._prepared) > _PREPARED:
            del self._prepared[next(iter(self._prepared))]


def _prepared(keyframe: Keyframe, level: int) -> JointLevel:
    numbers = spread_order(len(keyframe.points))
    if level > following_level(keyframe.shape):
        numbers = numbers[:_COARSE_POINTS]
    centres = at_level(keyframe.points[numbers], level)
    return joint_level(keyframe.patches[level][numbers], centres, numbers)


def _learn(doubts: FloatArray, found: JointAlignment) -> None:
    """Notes which patches are off the plane, and forgets a little of what was noted before.

    Roofs are off it in one direction, farther the farther the camera has flown: where the first few pictures
    tell them from the ground, they need not be told from it when they would bend the plane most.
    """
    doubts *= _MEMORY
    doubts[found.on_plane] *= _TRUST
    doubts[found.off_plane] += 1
    if np.count_nonzero(doubts >= _DOUBTED) > _MOST_DOUBTED * len(doubts):
        doubts[:] = 0


def _accepted(
    found: JointAlignment, level: int, shape: tuple[int, int], limits: FitLimits, rule: MotionRule
) -> KeyframeMatch | None:
    agreeing, factor = len(found.numbers), 2**level
    if agreeing < max(limits.min_inliers, _EVIDENT * found.sought):
        return None
    matrix, rmse = from_reduced(inverse(found.key_to_frame), factor), found.rmse * factor
    if not is_plausible(matrix, shape, ANY_STEP, _ANY_TILT):
        return None
    offset = (factor - 1) / 2
    frame_points, key_points = found.frame_points * factor + offset, found.key_points * factor + offset
    model = MotionModel.HOMOGRAPHY
    if rule.model is not model:
        near = np.isfinite(found.variances)
        every = np.ones(int(np.count_nonzero(near)), dtype=np.bool_)
        whole = MotionFit(matrix, model, every, rmse)
        allowed = rule.applied(whole, frame_points[near], key_points[near])
        matrix, model, rmse = allowed.matrix, allowed.model, allowed.rmse
    return KeyframeMatch(
        MotionFit(matrix, model, np.arange(found.compared) < agreeing, rmse),
        frame_points,
        key_points,
        found.numbers + LEVEL_PATCHES * level,
        found.deviation * factor,
        found.variances,
        agreeing > _EVENLY * found.sought or found.likeness > _SHARP,
    )
