"""Matches frames with keyframes by patches: followed from where they are expected, or searched for."""

from collections.abc import Sequence

from streamkit.geometry.homography import FloatArray, GreyArray, inverse, normalised
from streamkit_stitcher.plane.following import KeyframeFollower, following_level
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframe_matcher import KeyframeMatcher
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.motion_models import FitLimits
from streamkit_stitcher.registration.patches import pyramid

COARSE_POINTS = 96


class PatchMatching:
    """Both ways of matching, with the limits and the motion model of a plane.

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

    def prepare(self, keyframe: Keyframe) -> None:
        """Prepares to follow the patches of a new keyframe."""
        self._follower.prepare(keyframe, self._keyframes.executor)

    def certain(self, match: KeyframeMatch | None) -> KeyframeMatch | None:
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

    def match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        top_level: int,
        most: int = 0,
        coarse: int = COARSE_POINTS,
    ) -> KeyframeMatch | None:
        """Searches for patches from coarse to fine, around where a homography to the plane expects them.

        Args:
            keyframe: to match with.
            images: the frame.
            to_reference: float64[3, 3], its expected homography to the plane.
            top_level: how often the frame is halved for the first search.
            most: patches at full size; 0 is all.
            coarse: patches of the first search.
        """
        return self._matcher.match(
            keyframe,
            pyramid(images, top_level + 1),
            normalised(inverse(keyframe.to_reference) @ to_reference),
            self._limits,
            top_level=top_level,
            max_points=most or self._max_points,
            rule=self._keyframes.rule,
            coarse_points=coarse,
        )
