"""Registration of frames to keyframes without a prediction, by features."""

import threading
from collections.abc import Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import from_reduced, is_plausible, overlap
from streamkit_stitcher.plane.keyframe_content import scene_level
from streamkit_stitcher.plane.keyframe_matcher import ANY_STEP, ANY_TILT
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.descriptors import FrameFeatures, describe, match_features, recognise
from streamkit_stitcher.registration.gauss_newton import corner_deviation
from streamkit_stitcher.registration.motion_models import MotionFit

# As many as keyframes are stored, and some that were dropped while a job ran: 100 MB.
_MOST_DESCRIPTIONS: Final = 160
# Features of each keyframe that are compared to find the likeliest, and matches below which none is likely.
_STRONGEST: Final = 600
_FEWEST_MATCHES: Final = 8
_FEWEST_INLIERS: Final = 20
_LEAST_OVERLAP: Final = 0.08
# Photographs from half or twice the height.
_LARGEST_AREA_SCALE: Final = 5.0
# Features stand for patches of the keyframe, with numbers beyond those of its real ones.
_FIRST_FEATURE: Final = 1 << 16


class Relocaliser:
    """Registers frames to keyframes without a prediction, by cached features; several threads may use it."""

    def __init__(self) -> None:
        self._descriptions: dict[int, FrameFeatures] = {}
        self._lock = threading.Lock()

    def description(self, keyframe: Keyframe) -> FrameFeatures:
        """The features of a keyframe."""
        with self._lock:
            found = self._descriptions.get(keyframe.index)
        if found is None:
            found = describe(keyframe.scene)
        self.remember(keyframe, found)
        return found

    def remember(self, keyframe: Keyframe, description: FrameFeatures) -> None:
        """Caches the features of a keyframe."""
        with self._lock:
            self._descriptions.pop(keyframe.index, None)
            self._descriptions[keyframe.index] = description
            if len(self._descriptions) > _MOST_DESCRIPTIONS:
                del self._descriptions[next(iter(self._descriptions))]

    def forget(self) -> None:
        """Releases the features."""
        with self._lock:
            self._descriptions.clear()

    def likeliest(self, frame: FrameFeatures, keyframes: Sequence[Keyframe], most: int) -> list[Keyframe]:
        """At most `most` keyframes, by their number of matches among a few hundred features each."""
        part = _strongest(frame)
        counts = [
            len(match_features(part, _strongest(self.description(keyframe)))[0]) for keyframe in keyframes
        ]
        order = np.argsort(-np.array(counts), kind="stable")[:most]
        return [keyframes[number] for number in order if counts[number] >= _FEWEST_MATCHES]

    def match(self, frame: FrameFeatures, keyframe: Keyframe) -> KeyframeMatch | None:
        """Registers a frame of the same size to a keyframe; None where it does not match."""
        known = self.description(keyframe)
        found = recognise(frame, known, _FEWEST_INLIERS)
        if found is None:
            return None
        fit, own, other = found
        factor = 2 ** scene_level(keyframe.shape)
        matrix, rmse, offset = from_reduced(fit.matrix, factor), fit.rmse * factor, (factor - 1) / 2
        if not (
            overlap(matrix, keyframe.shape) > _LEAST_OVERLAP
            and is_plausible(matrix, keyframe.shape, ANY_STEP, ANY_TILT, _LARGEST_AREA_SCALE)
        ):
            return None
        source = frame.points[own] * factor + offset
        return KeyframeMatch(
            MotionFit(matrix, fit.model, np.ones(fit.count, dtype=np.bool_), rmse),
            source,
            known.points[other] * factor + offset,
            other + _FIRST_FEATURE,
            corner_deviation(matrix, source, rmse, keyframe.shape),
        )


def _strongest(description: FrameFeatures) -> FrameFeatures:
    """The features of the highest contrast, which other views show most likely."""
    return FrameFeatures(description.points[:_STRONGEST], description.descriptors[:_STRONGEST])
