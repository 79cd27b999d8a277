"""Dense matching of frames with the current keyframe, with a prediction of how far the camera moves."""

import math
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    from_reduced,
    inverse,
    project,
    to_reduced,
)
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.dense_alignment import (
    STEP_RATIOS,
    DenseAlignment,
    DenseLevel,
    align_densely,
    levels_of,
)
from streamkit_stitcher.registration.motion_models import MotionFit, MotionModel

_CACHED: Final = 3
_FIRST_DEVIATION: Final = 2.0
_LEAST_DEVIATION: Final = 0.1
_LARGEST_DEVIATION: Final = 8.0
_GAIN: Final = 0.1
_OUTLIER: Final = 3.0
_EXPECTED: Final = 2
# Smallest deviation at a corner, px: lens, shutter and compression.
_FLOOR: Final = 0.2
# Deviation of a held position, as a part of its distance from the best motion.
_HELD: Final = 0.25
# Blocks stand for patches of the keyframe, with numbers beyond those of patches and features.
_FIRST_BLOCK: Final = 1 << 19


class DenseMatcher:
    """Registers frames to a keyframe by `align_densely`, and learns how steady the camera is.

    A steady camera makes large motions improbable: a mover must then show more of the frame than its own
    area to be taken for the world.
    """

    def __init__(self) -> None:
        self._levels: dict[int, tuple[DenseLevel, ...]] = {}
        self._deviation = _FIRST_DEVIATION
        self._covariance = np.zeros((8, 8))

    def match(
        self,
        keyframe: Keyframe,
        small: GreyArray,
        before: FloatArray,
        before_std: float,
        expected: FloatArray,
        followed: KeyframeMatch | None,
    ) -> KeyframeMatch:
        """The likeliest match with a keyframe; its `share` is small where next to nothing agrees.

        Where they explain the frame, the camera is preferred to be where it was at the keyframe, then where
        it was in the previous frame, then where the patches see it.

        Args:
            keyframe: the keyframe.
            small: uint8[h, w], the frame at working size.
            before: the previous frame to the keyframe.
            before_std: its predicted error, px.
            expected: the predicted homography to the keyframe.
            followed: the match of the patches, if any.
        """
        factor = keyframe.factor
        motions = [IDENTITY, before, expected, *([] if followed is None else [followed.fit.matrix])]
        found = align_densely(
            self._prepared(keyframe),
            small,
            [to_reduced(inverse(matrix), factor) for matrix in motions],
            self._covariance + np.diag((self._deviation * STEP_RATIOS) ** 2),
            preferred=[number for number in range(len(motions)) if number != _EXPECTED],
        )
        self._learn(found)
        kept = found.prediction
        if followed is not None and kept is not None and kept > _EXPECTED:
            return followed
        to_key = from_reduced(inverse(found.key_to_frame), factor) if kept is None else motions[kept]
        std = found.corner_std * factor
        if kept is not None:
            std = math.hypot(before_std if kept else 0.0, _HELD * found.away * factor)
        return _match(found, to_key, factor, math.hypot(_FLOOR * factor, std))

    def _learn(self, found: DenseAlignment) -> None:
        step = found.step[:4] / STEP_RATIOS[:4]
        size = min(float((step**2).mean()), (_OUTLIER * self._deviation) ** 2)
        deviation = np.sqrt((1 - _GAIN) * self._deviation**2 + _GAIN * size)
        self._deviation = float(np.clip(deviation, _LEAST_DEVIATION, _LARGEST_DEVIATION))
        self._covariance = found.covariance

    def _prepared(self, keyframe: Keyframe) -> tuple[DenseLevel, ...]:
        levels = self._levels.pop(keyframe.index, None)
        if levels is None:
            levels = tuple(DenseLevel(image) for image in levels_of(keyframe.small))
        self._levels[keyframe.index] = levels
        if len(self._levels) > _CACHED:
            del self._levels[next(iter(self._levels))]
        return levels


def _match(found: DenseAlignment, to_key: FloatArray, factor: int, std: float) -> KeyframeMatch:
    key_points = found.key_points * factor + (factor - 1) / 2
    inliers = np.arange(found.compared) < len(key_points)
    return KeyframeMatch(
        MotionFit(to_key, MotionModel.HOMOGRAPHY, inliers, found.rmse),
        project(inverse(to_key), key_points),
        key_points,
        found.blocks + _FIRST_BLOCK,
        std,
        share=found.agreement,
        std=std,
    )
