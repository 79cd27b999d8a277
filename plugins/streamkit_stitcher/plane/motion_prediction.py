"""Prediction of the next frame's homography from a smoothed velocity."""

from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, centre, normalised, translation

_MAX_PREDICTED: Final = 5
_GAIN: Final = 0.5


class MotionPredictor:
    """Exponential smoothing of the frame-to-frame motion, about the frame's centre.

    Args:
        shape: (height, width) of the frames, px.

    Attributes:
        predicted: frames since the last measured one.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        middle = centre(shape)
        self._to_centre, self._from_centre = translation(-middle), translation(middle)
        self._velocity = np.eye(3)
        self.predicted = 0

    def update(self, to_previous: FloatArray) -> None:
        """Adds a measured motion, float64[3, 3]."""
        centred = normalised(self._to_centre @ to_previous @ self._from_centre)
        self._velocity = self._velocity + _GAIN * (centred - self._velocity)
        self.predicted = 0

    def expected(self, before: FloatArray) -> FloatArray:
        """The next frame's homography after `before`; the camera stands still after five predictions."""
        if self.predicted >= _MAX_PREDICTED:
            return before
        return normalised(before @ self._from_centre @ self._velocity @ self._to_centre)
