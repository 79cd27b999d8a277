"""Matches frames with keyframes: by patches, followed or searched for, or by all of the area."""

from collections.abc import Sequence
from typing import Final

from streamkit.geometry.homography import FloatArray, GreyArray, inverse, normalised
from streamkit_stitcher.plane.dense_matching import DenseMatcher
from streamkit_stitcher.plane.following import KeyframeFollower, following_level
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframe_matcher import KeyframeMatcher
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel
from streamkit_stitcher.registration.patches import pyramid

# Patches that agree, as a part of those in view, which no mover can outvote.
_DOMINANT: Final = 0.75
_NEAR_LEVEL: Final = 1


class KeyframeMatching:
    """The ways of matching, with the limits and the motion model of a plane.

    All homographies given are to the plane.

    Args:
        keyframes: of the plane.
        limits: of a fit, at working size.
        max_points: most patches of a keyframe.
    """

    def __init__(self, keyframes: KeyframeMap, limits: FitLimits, max_points: int) -> None:
        self._keyframes = keyframes
        self._limits = limits
        self._max_points = max_points
        self._follower = KeyframeFollower()
        self._matcher = KeyframeMatcher()
        self._dense = DenseMatcher()

    def prepare(self, keyframe: Keyframe) -> None:
        """Prepares to follow the patches of a new keyframe."""
        self._follower.prepare(keyframe, self._keyframes.executor)

    def if_whole_frame(self, match: KeyframeMatch | None) -> KeyframeMatch | None:
        """The match where it fixes the whole frame, not only the part with the patches; else None."""
        return match if match is not None and match.deviation <= self._limits.ransac_threshold else None

    def follow(
        self, keyframe: Keyframe, images: Sequence[GreyArray], to_reference: FloatArray, most: int = 0
    ) -> KeyframeMatch | None:
        """Follows at most `most` patches (0: all) from where a homography to the plane expects them."""
        return self._follower.follow(
            keyframe,
            pyramid(images, following_level(keyframe.shape) + 2),
            normalised(inverse(keyframe.to_reference) @ to_reference),
            self._limits,
            most or self._max_points,
            self._keyframes.rule,
        )

    def search(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        top_level: int,
        most: int = 0,
    ) -> KeyframeMatch | None:
        """Searches for patches from coarse to fine, around where a homography to the plane expects them.

        Args:
            keyframe: to match with.
            images: the frame.
            to_reference: float64[3, 3], its expected homography to the plane.
            top_level: how often the frame is halved for the first search.
            most: patches at full size; 0 is all.
        """
        return self._matcher.match(
            keyframe,
            pyramid(images, top_level + 1),
            normalised(inverse(keyframe.to_reference) @ to_reference),
            self._limits,
            top_level=top_level,
            max_points=most or self._max_points,
            rule=self._keyframes.rule,
        )

    def near(
        self,
        images: Sequence[GreyArray],
        small: GreyArray,
        before: FloatArray,
        before_std: float,
        expected: FloatArray,
    ) -> KeyframeMatch | None:
        """The match with the current keyframe, by patches where most of them agree, else by the area.

        Its `share` is small where next to nothing agrees.

        Args:
            images: the frame.
            small: uint8[h, w], at working size.
            before: the previous frame.
            before_std: its predicted error, px.
            expected: the predicted homography.
        """
        active = self._keyframes.active
        if active is None:
            return None
        match = self.if_whole_frame(self.follow(active, images, expected))
        match = match or self.if_whole_frame(self.search(active, images, expected, _NEAR_LEVEL))
        if match is not None:
            if self._keyframes.rule.model is not MotionModel.HOMOGRAPHY is match.fit.model:
                self._keyframes.learn(match)
            if match.share >= _DOMINANT:
                return match
        return self.align(small, before, before_std, expected, match)

    def align(
        self,
        small: GreyArray,
        before: FloatArray,
        before_std: float,
        expected: FloatArray,
        followed: KeyframeMatch | None = None,
    ) -> KeyframeMatch | None:
        """Matches all of the area of uint8[h, w], at working size, see `DenseMatcher.match`."""
        active = self._keyframes.active
        if active is None or active.small.shape != small.shape:
            return followed
        to_key = inverse(active.to_reference)
        before, expected = normalised(to_key @ before), normalised(to_key @ expected)
        return self._dense.match(active, small, before, before_std, expected, followed)
