"""Ties across flight strips: keyframes of the same ground that were not matched while tracking."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    inverse,
    normalised,
    overlap,
    to_reduced,
)
from streamkit_stitcher.plane.keyframe_content import LEVELS
from streamkit_stitcher.plane.keyframe_graph import Tie
from streamkit_stitcher.plane.keyframe_matcher import KeyframeMatcher
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.plane.relocaliser import Relocaliser
from streamkit_stitcher.registration.descriptors import FrameFeatures
from streamkit_stitcher.registration.motion_models import FitLimits

_MOST_TIE_POINTS: Final = 80
# Patches of each keyframe that are matched, and the part of those in view that has to agree.
_PATCHES: Final = 200
_AGREEING: Final = 0.5
# Keyframes of likely features, of the same plane and of others, that are tried.
_RETRIEVED: Final = 3
# Standard deviations, px, of the smoothing between which textures are compared.
_FINE: Final = 1.5
_COARSE: Final = 8.0


def tie_of(keyframe: Keyframe, observer: int, match: KeyframeMatch) -> Tie:
    """The tie of a match of the keyframe `observer` on `keyframe`."""
    tie = Tie(keyframe.index, observer, match.patches, match.key_points, match.frame_points)
    return tie.thinned(_MOST_TIE_POINTS)


class LoopCloser:
    """Matches a keyframe with others that it should overlap, to sub-pixel ties."""

    def __init__(self, relocaliser: Relocaliser) -> None:
        self._relocaliser = relocaliser
        self._matcher = KeyframeMatcher()

    def close(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        candidates: Sequence[Keyframe],
        near: Collection[int] = (),
        description: FrameFeatures | None = None,
        others: Sequence[Keyframe] = (),
    ) -> tuple[Tie, ...]:
        """The ties to those of `candidates` that match the new keyframe.

        Args:
            keyframe: the new keyframe.
            images: its frame.
            candidates: keyframes to match with.
            near: those whose homography is known to a few px; they are not searched by features, unless the
                new one had to be relocalised itself.
            description: features of the new keyframe, if they exist already.
            others: keyframes whose features may match, wherever they are thought to lie.
        """
        if description is not None:
            self._relocaliser.remember(keyframe, description)
        if others:
            known = self._relocaliser.description(keyframe)
            for same in (True, False):
                group = [other for other in others if (other.plane == keyframe.plane) is same]
                candidates = [*candidates, *self._relocaliser.likeliest(known, group, _RETRIEVED)]
        ties = []
        limits = replace(FitLimits(), max_step=1.0, ransac_threshold=2.0)
        for candidate in candidates:
            if candidate.shape != keyframe.shape:
                continue
            is_known = candidate.plane == keyframe.plane
            match = self._predicted(keyframe, images, candidate, limits) if is_known else None
            if match is None:
                if description is None and candidate.index in near:
                    continue
                coarse = self._relocaliser.match(self._relocaliser.description(keyframe), candidate)
                if coarse is None:
                    continue
                aligned = self._matcher.match(
                    candidate, images, coarse.fit.matrix, limits, top_level=LEVELS - 2, max_points=_PATCHES
                )
                match = better(coarse, aligned, candidate, _PATCHES)
            tie = tie_of(candidate, keyframe.index, match)
            ties.append(replace(tie, correlation=correlation(keyframe, candidate, match.fit.matrix)))
        return tuple(ties)

    def _predicted(
        self, keyframe: Keyframe, images: Sequence[GreyArray], candidate: Keyframe, limits: FitLimits
    ) -> KeyframeMatch | None:
        """The match near the present homographies, if most patches agree.

        Costs a tenth of feature matching, and suffices for drift below 24 px.
        """
        to_candidate = normalised(inverse(candidate.to_reference) @ keyframe.to_reference)
        match = self._matcher.match(
            candidate, images, to_candidate, limits, top_level=LEVELS - 1, max_points=_PATCHES
        )
        return match if match is not None and _is_wide(match, candidate, _PATCHES) else None


def correlation(keyframe: Keyframe, other: Keyframe, matrix: FloatArray) -> float:
    """Normalised correlation of two keyframes' textures over their overlap, -1 to 1; 0 without overlap.

    Houses in a row match well enough at a false shift, but their surroundings do not. `matrix` maps full-size
    pixels of the first keyframe to those of the other, of the same working size.
    """
    first = _texture(keyframe.small)
    size = first.shape[1], first.shape[0]
    to_other = to_reduced(matrix, keyframe.factor)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    second = cv2.warpPerspective(_texture(other.small), to_other, size, flags=flags)
    inside = np.full(other.small.shape, 255, dtype=np.uint8)
    shared = cv2.warpPerspective(inside, to_other, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) > 0
    one, two = first[shared], second[shared]
    power = float(np.sqrt((one * one).sum() * (two * two).sum()))
    return float((one * two).sum()) / power if power > 0 else 0.0


def _texture(small: GreyArray) -> npt.NDArray[np.float32]:
    """Band-pass filtered image, float32[h, w]."""
    smooth = cv2.GaussianBlur(small.astype(np.float32), (0, 0), _FINE)
    return np.asarray(smooth - cv2.GaussianBlur(smooth, (0, 0), _COARSE), dtype=np.float32)


def better(
    features: KeyframeMatch, patches: KeyframeMatch | None, keyframe: Keyframe, max_points: int
) -> KeyframeMatch:
    """The match of patches, ten times as precise, where they agree over the frame; else that of features."""
    return patches if patches is not None and _is_wide(patches, keyframe, max_points) else features


def _is_wide(match: KeyframeMatch, keyframe: Keyframe, max_points: int) -> bool:
    """Whether half of the patches in view agree; terrain relief leaves only those of a corner."""
    visible = overlap(inverse(match.fit.matrix), keyframe.shape) * min(max_points, len(keyframe.points))
    return match.fit.count >= _AGREEING * visible
