"""Ties across flight strips: key pictures of the same ground that the stream did not follow."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    from_reduced,
    inverse,
    is_plausible,
    normalised,
    overlap,
    to_reduced,
)
from streamkit_stitcher.plane.graph import Tie
from streamkit_stitcher.plane.key_picture import LEVELS
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch, KeyframeMatcher
from streamkit_stitcher.registration.descriptors import Description, describe, recognise
from streamkit_stitcher.registration.gauss_newton import corner_deviation
from streamkit_stitcher.registration.motion_models import FitLimits, MotionFit

KEPT_TIES: Final = 80
_POINTS: Final = 200
_DESCRIBED: Final = 24
_MIN_INLIERS: Final = 20
_LEAST_OVERLAP: Final = 0.08
_AGREEING: Final = 0.5
_FINE: Final = 1.5
_COARSE: Final = 8.0
FEATURES_FROM: Final = 1 << 16


class Recogniser:
    """Places pictures on key pictures without a guess, by what they show.

    Descriptions of the last few key pictures are kept.
    """

    def __init__(self) -> None:
        self._descriptions: dict[int, Description] = {}

    def description(self, keyframe: Keyframe) -> Description:
        """What a key picture is recognised by."""
        found = self._descriptions.get(keyframe.index)
        if found is None:
            found = describe(keyframe.small)
        self.remember(keyframe, found)
        return found

    def remember(self, keyframe: Keyframe, description: Description) -> None:
        """Keeps the description of a key picture that was made before."""
        self._descriptions.pop(keyframe.index, None)
        self._descriptions[keyframe.index] = description
        if len(self._descriptions) > _DESCRIBED:
            del self._descriptions[next(iter(self._descriptions))]

    def place(self, picture: Description, keyframe: Keyframe) -> KeyframeMatch | None:
        """Places a picture of the same working size on a key picture; None if that is not seen in it.

        The features stand for patches of the key picture, by numbers beyond those of its real ones.
        """
        found = recognise(picture, self.description(keyframe), _MIN_INLIERS)
        if found is None:
            return None
        factor = keyframe.factor
        matrix = from_reduced(found.fit.matrix, factor)
        if not (
            overlap(matrix, keyframe.shape) > _LEAST_OVERLAP and is_plausible(matrix, keyframe.shape, 10.0)
        ):
            return None
        offset = (factor - 1) / 2
        fit = MotionFit(
            matrix, found.fit.model, np.ones(found.fit.count, dtype=np.bool_), found.fit.rmse * factor
        )
        source = found.source_points * factor + offset
        return KeyframeMatch(
            fit,
            source,
            found.target_points * factor + offset,
            found.target_indices + FEATURES_FROM,
            corner_deviation(matrix, source, fit.rmse, keyframe.shape),
        )


def tie_of(keyframe: Keyframe, observer: int, match: KeyframeMatch, most: int = KEPT_TIES) -> Tie:
    """The tie that a match of the key picture `observer` on `keyframe` makes."""
    return Tie(
        keyframe.index, observer, match.patches, match.key_points, match.frame_points, match.fit.rmse
    ).thinned(most)


class LoopCloser:
    """Looks for a key picture in others that it should share ground with, to sub-pixel ties."""

    def __init__(self) -> None:
        self._recogniser = Recogniser()
        self._matcher = KeyframeMatcher()

    def close(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        candidates: Sequence[Keyframe],
        near: Collection[int] = (),
        description: Description | None = None,
    ) -> tuple[Tie, ...]:
        """The ties to those of `candidates` in which the key picture was found.

        Args:
            keyframe: the new key picture.
            images: its picture and halvings.
            candidates: key pictures to look in.
            near: those of them whose place is known to a few px; unless the new one had to be recognised
                itself, they are not searched for what is not seen there.
            description: of the new key picture, if there is one already.
        """
        if description is not None:
            self._recogniser.remember(keyframe, description)
        ties = []
        limits = replace(FitLimits(), max_step=1.0, threshold=2.0)
        for candidate in candidates:
            if candidate.shape != keyframe.shape:
                continue
            match = self._expected(keyframe, images, candidate, limits)
            if match is None:
                if description is None and candidate.index in near:
                    continue
                seen = self._recogniser.place(self._recogniser.description(keyframe), candidate)
                if seen is None:
                    continue
                aligned = self._matcher.match(
                    candidate, images, seen.fit.matrix, limits, top_level=LEVELS - 2, max_points=_POINTS
                )
                match = better(seen, aligned, candidate, _POINTS)
            tie = tie_of(candidate, keyframe.index, match)
            ties.append(replace(tie, likeness=likeness(keyframe, candidate, match.fit.matrix)))
        return tuple(ties)

    def _expected(
        self, keyframe: Keyframe, images: Sequence[GreyArray], candidate: Keyframe, limits: FitLimits
    ) -> KeyframeMatch | None:
        """The match near the place that the key pictures have by now, if most of the patches there agree.

        It costs a tenth of the recognition, and drift of less than 24 px does not need that.
        """
        to_candidate = normalised(inverse(candidate.to_reference) @ keyframe.to_reference)
        match = self._matcher.match(
            candidate, images, to_candidate, limits, top_level=LEVELS - 1, max_points=_POINTS
        )
        return match if match is not None and _is_wide(match, candidate, _POINTS) else None


def likeness(keyframe: Keyframe, other: Keyframe, matrix: FloatArray) -> float:
    """How much two key pictures look alike over all the ground that they would share, -1 to 1.

    Houses in a row match well enough at a false place, but what lies about them does not.

    Args:
        keyframe: the one.
        other: the other, of the same working size.
        matrix: float64[3, 3], full-size pixels of the one to those of the other.

    Returns:
        The correlation of their textures; 0 where they share nothing.
    """
    first = texture(keyframe.small)
    size = first.shape[1], first.shape[0]
    to_other = to_reduced(matrix, keyframe.factor)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    second = cv2.warpPerspective(texture(other.small), to_other, size, flags=flags)
    inside = np.full(other.small.shape, 255, dtype=np.uint8)
    shared = cv2.warpPerspective(inside, to_other, size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) > 0
    one, two = first[shared], second[shared]
    power = float(np.sqrt((one * one).sum() * (two * two).sum()))
    return float((one * two).sum()) / power if power > 0 else 0.0


def texture(small: GreyArray) -> npt.NDArray[np.float32]:
    """A picture without its light and shade and without its noise, float32[h, w]."""
    smooth = cv2.GaussianBlur(small.astype(np.float32), (0, 0), _FINE)
    return np.asarray(smooth - cv2.GaussianBlur(smooth, (0, 0), _COARSE), dtype=np.float32)


def better(seen: KeyframeMatch, match: KeyframeMatch | None, keyframe: Keyframe, most: int) -> KeyframeMatch:
    """The match of patches, ten times as exact, where they agree widely; relief leaves a corner only.

    Args:
        seen: the match of features on `keyframe`.
        match: that of at most `most` of its patches.
        keyframe: the key picture.
        most: see `match`.
    """
    return match if match is not None and _is_wide(match, keyframe, most) else seen


def _is_wide(match: KeyframeMatch, keyframe: Keyframe, most: int) -> bool:
    """Whether half of the patches agree, at most `most` in all, of those that the picture should show."""
    shown = overlap(inverse(match.fit.matrix), keyframe.shape) * min(most, len(keyframe.points))
    return match.fit.count >= _AGREEING * shown
