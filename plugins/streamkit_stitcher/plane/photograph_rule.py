"""Tells the photographs of a survey from the frames of a video."""

from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, corner_shift
from streamkit_stitcher.registration.pairwise import PairwiseMotion, WorkingImage

# Part of the width that successive photographs are apart, and frames of a video are not.
_JUMP: Final = 0.15
# Correlation with the previous frame above which a frame that nothing matches is not a photograph.
_LIKE: Final = 0.7


class PhotographRule:
    """Photographs are far apart, and none is followed from one to the next.

    Args:
        shape: (height, width) of the frames, px.

    Attributes:
        is_video: whether frames were followed since the last one of unknown motion.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._shape = shape
        self.is_video = False

    def is_jump(self, step: FloatArray) -> bool:
        """Whether a motion, float64[3, 3], is as large as between photographs."""
        return corner_shift(step, self._shape) > _JUMP * self._shape[1]

    def is_photograph(self, earlier: WorkingImage, image: WorkingImage, motion: PairwiseMotion) -> bool:
        """Whether a frame that no keyframe matches is one: unlike the earlier one, and not near it."""
        likeness = float(np.corrcoef(earlier.thumbnail.ravel(), image.thumbnail.ravel())[0, 1])
        is_near = motion.model is not None and not self.is_jump(motion.matrix)
        return not self.is_video and likeness < _LIKE and not is_near
