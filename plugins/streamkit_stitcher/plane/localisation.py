"""How well the place of a stream's frames is known, and what is tried where it is lost."""

from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    FloatArray,
    centre,
    corner_shift,
    inverse,
    normalised,
    translation,
)
from streamkit_stitcher.plane.frame_registration import OK_STD
from streamkit_stitcher.plane.placement import Placement
from streamkit_stitcher.plane.tie_checks import MAX_DRIFT
from streamkit_stitcher.registration.pairwise import PairwiseMotion

_MAX_LOST: Final = 25
# Predicted frames in a row after which the camera is taken to stand still, and part of the velocity that each
# placed frame replaces.
_MAX_PREDICTED: Final = 5
_GAIN: Final = 0.5
# Growth of the predicted error with each lost frame, px.
_LOST_STD: Final = 1.0
# Of the frames that no keyframe matches, features are tried at every second, and after so many more rarely.
_FREQUENT_TRIES: Final = 4
_RARE_PERIOD: Final = 16
# Searches by the corners, each of which has confirmed a weak match, after which they become rarer, too.
_MOST_VAIN: Final = 8
_VAIN_PERIOD: Final = 4


class Localisation:
    """The place of the previous frame, how well it is known, and where the next one is expected.

    A frame is measured, where a keyframe matches, or placed by its motion alone, or lost. Frames are adrift,
    their place unknown, from a step that may be off by more than ties correct until a match is better.

    Args:
        shape: (height, width) of the frames, px.
        std: predicted error of the first frame, px.

    Attributes:
        std: predicted error of the previous frame at the worst corner, px.
        is_adrift: whether the place is unknown, so that no keyframe may be made of a frame.
        predicted: frames since the last placed one, whose places are predictions.
    """

    def __init__(self, shape: tuple[int, int], std: float = 0.0) -> None:
        self._shape, self._max_drift = shape, MAX_DRIFT * shape[1]
        middle = centre(shape)
        self._to_centre, self._from_centre = translation(-middle), translation(middle)
        self._lost = self._unmeasured = self._vain = self._since_search = 0
        self.std = std
        self.is_adrift = False
        self.predicted = 0
        self._velocity: FloatArray = np.eye(3)

    @property
    def is_known(self) -> bool:
        """Whether the previous frame had a place that ties could correct."""
        return not self.predicted and self.std <= self._max_drift

    def expected(self, before: FloatArray) -> FloatArray:
        """The next frame's homography after `before`, by a smoothed velocity about the frame's centre."""
        if self.predicted >= _MAX_PREDICTED:
            return before
        return normalised(before @ self._from_centre @ self._velocity @ self._to_centre)

    def predicted_by(
        self, motion: PairwiseMotion, before: FloatArray, last_to_plane: FloatArray
    ) -> Placement:
        """Where the motion of the corners leads, or that of the frames before where it is unknown.

        Args:
            motion: since the last frame that was not lost.
            before: float64[3, 3], the previous frame to the plane.
            last_to_plane: float64[3, 3], the last frame that was not lost to the plane.
        """
        if motion.model is None:
            return Placement(self.expected(before), _LOST_STD + self.std, motion=motion)
        to_plane = normalised(last_to_plane @ motion.matrix)
        return Placement(to_plane, motion.corner_std(self._shape) + self.std, motion=motion)

    def lost_place(self, before: FloatArray) -> Placement:
        """The predicted place of a frame that is lost."""
        expected = self.expected(before)
        self.predicted += 1
        self.std += corner_shift(normalised(inverse(before) @ expected), self._shape) + _LOST_STD
        return Placement(expected, self.std)

    def stays_adrift(self, found: Placement, motion: PairwiseMotion) -> bool:
        """Notes whether the place of a frame is unknown; returns whether that of the last one was, too."""
        was_adrift = self.is_adrift
        is_step_doubtful = was_adrift or motion.corner_std(self._shape) > self._max_drift
        self.is_adrift = found.std > self._max_drift and is_step_doubtful
        return was_adrift and self.is_adrift

    def is_search_due(self, motion: PairwiseMotion) -> bool:
        """Whether features are compared with those of the keyframes.

        Where the motion is known but keyframes never match, as over relief, the tries become rarer.
        """
        is_rare = motion.model is not None and self._unmeasured > _FREQUENT_TRIES
        return motion.is_cut or self._unmeasured % (_RARE_PERIOD if is_rare else 2) == 0

    def is_corner_search_due(self) -> bool:
        """Whether the corners of a frame may place it better than a weak match does, and counts the frame.

        Where they have confirmed such matches many times, as over relief, the tries become rarer.
        """
        self._since_search += 1
        return self.is_adrift or self._vain < _MOST_VAIN or self._since_search >= _VAIN_PERIOD

    def searched(self, is_vain: bool) -> None:
        """Notes whether a search by the corners has confirmed a weak match."""
        self._vain, self._since_search = self._vain + 1 if is_vain else 0, 0

    def lose(self) -> bool:
        """Counts a frame that nothing places; whether they are so many that a plane begins."""
        self._lost += 1
        self._unmeasured += 1
        return self._lost > _MAX_LOST

    def place(self, to_previous: FloatArray, std: float, is_measured: bool) -> None:
        """Notes the motion of a placed frame, float64[3, 3], and its predicted error, px."""
        centred = normalised(self._to_centre @ to_previous @ self._from_centre)
        self._velocity = self._velocity + _GAIN * (centred - self._velocity)
        self.std = std
        self._lost = self.predicted = 0
        if std <= OK_STD:
            self._vain = 0
        self._unmeasured = 0 if is_measured else self._unmeasured + 1

    def leave_plane(self) -> None:
        """Forgets the motion: the next frame lies on another plane."""
        self._velocity, self.predicted = np.eye(3), 0
