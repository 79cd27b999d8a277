"""Matches frames with the current keyframe where they are expected: by patches, or by all of their area."""

from collections.abc import Sequence
from typing import Final

from streamkit.geometry.homography import FloatArray, GreyArray, corner_shift, inverse, normalised
from streamkit_stitcher.plane.dense_matching import DenseMatcher
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import KeyframeMatch
from streamkit_stitcher.plane.patch_matching import PatchMatching
from streamkit_stitcher.plane.recognition_pauses import CheckPauses
from streamkit_stitcher.registration.motion_models import MotionModel

# Patches that agree, as a part of those in view, which no mover can outvote.
_DOMINANT: Final = 0.75
_SEARCH_LEVEL: Final = 1
_SEARCH_POINTS: Final = 48


class NearMatching:
    """Registers frames to the current keyframe, where most of its patches agree by these, else by the area.

    All homographies given are to the plane.

    Args:
        keyframes: of the plane.
        patches: matches by patches.
    """

    def __init__(self, keyframes: KeyframeMap, patches: PatchMatching) -> None:
        self._keyframes = keyframes
        self._patches = patches
        self._dense = DenseMatcher()
        self._checks = CheckPauses()

    def restart(self) -> None:
        """Checks the patches of the next frames by their area again."""
        self._checks = CheckPauses()

    def match(
        self,
        images: Sequence[GreyArray],
        level: int,
        before: FloatArray,
        before_std: float,
        expected: FloatArray,
    ) -> KeyframeMatch | None:
        """The match near the prediction; its `share` is small where next to nothing agrees.

        Args:
            images: the frame; `images[level]` at working size.
            level: how often it is halved for that.
            before: the previous frame.
            before_std: its predicted error, px.
            expected: the predicted homography.
        """
        followed = self._follow(images, expected)
        if followed is not None and followed.share >= _DOMINANT:
            return followed
        if not self._checks.is_due() and followed is not None and self._is_usual(followed, before):
            return followed
        aligned = self.align(images[level], before, before_std, expected, followed)
        self._checks.add(aligned is followed)
        return aligned

    def align(
        self,
        small: GreyArray,
        before: FloatArray,
        before_std: float,
        expected: FloatArray,
        followed: KeyframeMatch | None = None,
        measured: FloatArray | None = None,
    ) -> KeyframeMatch | None:
        """Matches all of the area of uint8[h, w], at working size, see `DenseMatcher.match`."""
        active = self._keyframes.active
        if active is None or active.small.shape != small.shape:
            return followed
        to_key = inverse(active.to_reference)
        before, expected = normalised(to_key @ before), normalised(to_key @ expected)
        measured = None if measured is None else normalised(to_key @ measured)
        return self._dense.match(active, small, before, before_std, expected, followed, measured)

    def _follow(self, images: Sequence[GreyArray], expected: FloatArray) -> KeyframeMatch | None:
        """The match of the patches, if it fixes the whole frame."""
        active = self._keyframes.active
        if active is None:
            return None
        match = self._patches.certain(self._patches.follow(active, images, expected))
        if match is not None:
            if self._keyframes.rule.model is not MotionModel.HOMOGRAPHY is match.fit.model:
                self._keyframes.learn(match)
            return match
        return self._patches.certain(
            self._patches.match(active, images, expected, _SEARCH_LEVEL, coarse=_SEARCH_POINTS)
        )

    def _is_usual(self, match: KeyframeMatch, before: FloatArray) -> bool:
        """Whether the camera moved since the frame before as it did lately."""
        active = self._keyframes.active
        if active is None:
            return True
        step = normalised(inverse(before) @ active.to_reference @ match.fit.matrix)
        return self._dense.is_usual(corner_shift(step, active.shape) / active.factor)
