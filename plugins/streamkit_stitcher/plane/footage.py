"""What the frames of a stream are: a video, photographs taken one by one, or another scene after a cut."""

import enum
from collections import deque
from itertools import pairwise
from typing import Final

from streamkit.geometry.homography import IDENTITY, FloatArray, corner_shift
from streamkit_stitcher.registration.pairwise import WorkingImage, thumbnail_correlation

# Correlation of two frames in a row above which the second is neither a photograph nor another scene.
_ALIKE: Final = 0.7
# Frames that are alike before a cut.
_CALM_FRAMES: Final = 3
# Frames in a row, each continuing the one before, after which the stream is a video for good.
_SURE_FRAMES: Final = 8
# Part of the width that successive photographs are apart, and frames of a video are not.
_MIN_JUMP: Final = 0.15


class _Kind(enum.Enum):
    """What the last frames were: each continued the one before, or each was taken elsewhere."""

    UNKNOWN = enum.auto()
    VIDEO = enum.auto()
    PHOTOGRAPHS = enum.auto()


class Footage:
    """Tells a video from photographs, and a cut from a view that is covered.

    Photographs are far apart, and none is followed from one to the next. A cut is an abrupt change after calm
    frames; leaves or a hand before the camera change every frame.
    """

    def __init__(self) -> None:
        self._kind = _Kind.UNKNOWN
        self._continued = 0
        # The last frames, each with its motion to the one before.
        self._recent: deque[tuple[WorkingImage, FloatArray]] = deque(maxlen=_CALM_FRAMES)

    @property
    def is_video(self) -> bool:
        """Whether the last frame continued the one before it, or the stream is a video for good."""
        return self._kind is _Kind.VIDEO

    @property
    def is_calm(self) -> bool:
        """Whether the last frames are alike where they overlap: nothing hides the scene."""
        steps = pairwise(self._recent)
        return len(self._recent) == _CALM_FRAMES and all(
            _are_alike(earlier, later, motion) for (earlier, _), (later, motion) in steps
        )

    def is_abrupt(self, image: WorkingImage) -> bool:
        """Whether a frame is unlike the one before it, and the frames before are alike where they overlap."""
        return self.is_calm and not _are_alike(self._recent[-1][0], image)

    def add(self, image: WorkingImage, to_previous: FloatArray) -> None:
        """Adds a frame, registered or lost, with its motion to the one before, float64[3, 3]."""
        self._recent.append((image, to_previous))

    def restart(self) -> None:
        """Begins with another scene; what is known to be a video stays one."""
        self._recent.clear()
        self._forget()

    def continues(self, is_jump: bool) -> bool:
        """Whether a frame that matches where it is expected continues the one before it.

        One that has jumped does so in a video only: the overlap of two photographs does not fix the frame.
        """
        if is_jump and not self.is_video:
            return False
        self._kind, self._continued = _Kind.VIDEO, self._continued + 1
        return True

    def recognised(self, is_photograph: bool) -> None:
        """A frame was found by features: far from the one before it, or anywhere."""
        if is_photograph:
            self._kind, self._continued = _Kind.PHOTOGRAPHS, 0
        else:
            self._forget()

    def _forget(self) -> None:
        if self._continued < _SURE_FRAMES:
            self._kind, self._continued = _Kind.UNKNOWN, 0

    def is_photograph(self, last: WorkingImage, image: WorkingImage) -> bool:
        """Whether a frame that does not continue `last` is a photograph: after others, or unlike `last`."""
        if self._kind is _Kind.UNKNOWN:
            return not _are_alike(last, image)
        return self._kind is _Kind.PHOTOGRAPHS


def is_jump(step: FloatArray, shape: tuple[int, int]) -> bool:
    """Whether a motion of a frame of `shape`, float64[3, 3], is as large as between photographs."""
    return corner_shift(step, shape) > _MIN_JUMP * shape[1]


def _are_alike(earlier: WorkingImage, later: WorkingImage, to_earlier: FloatArray = IDENTITY) -> bool:
    return thumbnail_correlation(earlier, later, to_earlier) > _ALIKE
