"""Ties across flight strips: keyframes of the same ground that were not matched while tracking."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    inverse,
    normalised,
    resized,
)
from streamkit_stitcher.plane.feature_matching import likeliest, match_by_features
from streamkit_stitcher.plane.keyframe_graph import Tie
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.plane.patch_matching import PatchMatcher
from streamkit_stitcher.registration.correlation import band_pass, overlap_correlation
from streamkit_stitcher.registration.motion_models import FitLimits

_MAX_TIE_POINTS: Final = 80
_PATCHES: Final = 200
_LIMITS: Final = FitLimits(ransac_threshold=2.0)
# Keyframes of likely features, of the same plane and of others, that are tried.
_RETRIEVED: Final = 3
# Standard deviations, px, of the smoothing between which textures are compared.
_FINE: Final = 1.5
_COARSE: Final = 8.0


def tie_of(keyframe: Keyframe, observer: int, match: KeyframeMatch) -> Tie:
    """The tie of a match of the keyframe `observer` on `keyframe`."""
    points = match.key_points, match.frame_points
    return Tie(keyframe.index, observer, match.patches, *points, match.share).thinned(_MAX_TIE_POINTS)


def close_loops(
    matcher: PatchMatcher,
    keyframe: Keyframe,
    images: Sequence[GreyArray],
    candidates: Sequence[Keyframe],
    others: Sequence[Keyframe],
    is_searched: bool,
) -> tuple[Tie, ...]:
    """The ties of a new keyframe to others that match it, to a fraction of a pixel.

    Args:
        matcher: matches patches.
        keyframe: the new keyframe.
        images: its frame.
        candidates: keyframes that should overlap it.
        others: keyframes whose features may match, wherever they are thought to lie.
        is_searched: whether candidates that the patches do not match are compared by features.
    """
    candidates = list(candidates)
    for same in (True, False):
        group = [other for other in others if (other.plane == keyframe.plane) is same]
        candidates += likeliest(keyframe.features, group, _RETRIEVED) if group else []
    ties = []
    for candidate in candidates:
        if candidate.shape != keyframe.shape:
            continue
        match, to_candidate = None, normalised(inverse(candidate.to_reference) @ keyframe.to_reference)
        if candidate.plane == keyframe.plane:
            # Costs a tenth of feature matching, and suffices for small drift.
            match = matcher.match(candidate, images, to_candidate, _LIMITS, _PATCHES)
        if match is None and is_searched:
            match = match_by_features(keyframe.features, candidate)
            if match is not None:
                # Patches are ten times as precise.
                match = matcher.match(candidate, images, match.fit.matrix, _LIMITS, _PATCHES) or match
        if match is not None:
            tie = tie_of(candidate, keyframe.index, match)
            ties.append(replace(tie, correlation=correlation(keyframe, candidate, match.fit.matrix)))
    return tuple(ties)


def correlation(keyframe: Keyframe, other: Keyframe, matrix: FloatArray) -> float:
    """Normalised correlation of two keyframes' textures over their overlap, -1 to 1; 0 without overlap.

    Houses in a row match well enough at a false shift, but their surroundings do not. `matrix` maps full-size
    pixels of the first keyframe to those of the other, of the same working size.
    """
    first, second = (band_pass(one.small, _FINE, _COARSE) for one in (keyframe, other))
    return overlap_correlation(first, second, resized(matrix, 1 / keyframe.factor))
