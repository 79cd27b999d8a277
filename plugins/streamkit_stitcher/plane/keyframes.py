"""Keyframes, their matches, and the store of those that frames can be matched with."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    centre,
    inverse,
    normalised,
    overlap,
    project,
    scale_change,
    tilt,
)
from streamkit_stitcher.plane.keyframe_content import KeyframeContent
from streamkit_stitcher.registration.motion_models import MotionFit

_SCALE_RANGE: Final = (0.7, 1.4)
# Distance of the middles of frames of these scales, in diagonals, beyond which they do not overlap.
_FAR: Final = 1.5
# A frame of another scale than its keyframe, or seen much more obliquely, becomes a keyframe.
_KEPT_SCALES: Final = (0.8, 1.25)
_MAX_TILT: Final = 0.5
_MANY: Final = 60
# Smallest deviation at a corner, px: lens, shutter and compression.
SMALLEST_CORNER_STD: Final = 0.3
_LEAST_SHARE: Final = 0.05
# Distance of keyframes of different planes, px: these stay while any two of one plane are nearer.
_ANOTHER_PLANE: Final = 1e12


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A keyframe.

    Attributes:
        index: number of the keyframe, never reused.
        to_reference: full-size pixels to the reference plane.
        shape: of the frame.
        factor: the reduction of `small`.
        content: returns what is kept of its pixels; waits until that is computed.
        corner_std: predicted error of a doubtful one when it was added, px; 0 for the others.
        plane: number of its reference plane.
    """

    index: int
    to_reference: FloatArray
    shape: tuple[int, int]
    factor: int
    content: Callable[[], KeyframeContent]
    corner_std: float = 0.0
    plane: int = 0

    @property
    def points(self) -> FloatArray:
        """float64[n, 2], patch centres, full-size px."""
        return self.content().points

    @property
    def patches(self) -> tuple[GreyArray, ...]:
        """One uint8[n, 17, 17] per pyramid level, finest first."""
        return self.content().patches

    @property
    def small(self) -> GreyArray:
        """uint8[h, w], the frame at working size."""
        return self.content().small

    @property
    def scene(self) -> GreyArray:
        """uint8[h, w], the frame at the size for feature matching."""
        return self.content().scene


@dataclass(frozen=True, eq=False)
class KeyframeMatch:
    """A frame registered to a keyframe.

    Attributes:
        fit: the homography from the frame's pixels to the keyframe's, with its inliers.
        frame_points: float64[n, 2], the inliers in the frame, px.
        key_points: float64[n, 2], the same points in the keyframe, px.
        patches: int64[n], numbers of the keyframe's patches.
        deviation: standard deviation of the fit at the worst corner of the frame, px.
        variances: float64[n], of each patch's position, in any unit, infinite off the plane; None if unknown.
        share: patches that agree, as a part of those in view.
        std: predicted error at the worst corner, px, systematic errors included; None to derive it.
        at_rest: whether the camera stayed where it was at the keyframe or in the previous frame.
    """

    fit: MotionFit
    frame_points: FloatArray
    key_points: FloatArray
    patches: npt.NDArray[np.int64]
    deviation: float = 0.0
    variances: FloatArray | None = None
    share: float = 1.0
    std: float | None = None
    at_rest: bool = False

    @property
    def corner_std(self) -> float:
        """Predicted error at the worst corner, px: the fit's, larger as fewer patches agree."""
        if self.std is not None:
            return self.std
        return math.hypot(SMALLEST_CORNER_STD, self.deviation / max(_LEAST_SHARE, self.share) ** 2)

    def on_plane(self) -> "KeyframeMatch":
        """The match without the patches off the plane."""
        return self if self.variances is None else self._part(np.flatnonzero(np.isfinite(self.variances)))

    def most_precise(self) -> "KeyframeMatch":
        """The match with the more precise half of the patches on the plane, if there are many."""
        part = self.on_plane()
        if part.variances is None or len(part.patches) <= _MANY:
            return part
        best = np.argsort(part.variances, kind="stable")[: max(_MANY, len(part.patches) // 2)]
        return part._part(np.sort(best))

    def _part(self, kept: npt.NDArray[np.int64]) -> "KeyframeMatch":
        if len(kept) == len(self.patches):
            return self
        return replace(
            self,
            frame_points=self.frame_points[kept],
            key_points=self.key_points[kept],
            patches=self.patches[kept],
            variances=None if self.variances is None else self.variances[kept],
        )


class KeyframeStore:
    """A bounded set of keyframes, of one reference plane or several.

    A full store drops the older of the two nearest keyframes of a plane: their ground stays covered.
    """

    def __init__(self, capacity: int = 128) -> None:
        self._capacity = capacity
        self._keyframes: list[Keyframe] = []
        self._next_index = 0

    def __len__(self) -> int:
        return len(self._keyframes)

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The stored keyframes, oldest first."""
        return tuple(self._keyframes)

    def add(
        self,
        content: Callable[[], KeyframeContent],
        to_reference: FloatArray,
        shape: tuple[int, int],
        level: int,
        corner_std: float = 0.0,
        plane: int = 0,
    ) -> Keyframe:
        """Stores a keyframe that was halved `level` times to working size."""
        keyframe = Keyframe(self._next_index, to_reference, shape, 2**level, content, corner_std, plane)
        self._next_index += 1
        self._keyframes.append(keyframe)
        if len(self._keyframes) > self._capacity:
            self._keyframes.pop(self._most_redundant())
        return keyframe

    def overlapping(
        self, to_reference: FloatArray, shape: tuple[int, int], least: float, plane: int = 0
    ) -> list[tuple[float, Keyframe]]:
        """Keyframes of a plane that overlap a frame by `least` (0 to 1) at a similar scale, most first."""
        found = []
        to_frame, middle = inverse(to_reference), centre(shape)
        for keyframe in self._keyframes:
            if keyframe.plane != plane:
                continue
            apart = project(to_frame @ keyframe.to_reference, middle[np.newaxis]) - middle
            # Most of a hundred are far away, and an exact overlap takes a tenth of a millisecond.
            if np.hypot(*apart[0]) > _FAR * np.hypot(*shape):
                continue
            to_key = inverse(keyframe.to_reference) @ to_reference
            share = overlap(to_key, shape)
            if share >= least and _SCALE_RANGE[0] < scale_change(to_key, shape) < _SCALE_RANGE[1]:
                found.append((share, keyframe))
        return sorted(found, key=lambda item: (-item[0], item[1].index))

    def move(self, homographies: Mapping[int, FloatArray], planes: Mapping[int, int] | None = None) -> None:
        """Replaces the homographies and planes of keyframes, by their indices."""
        numbers = planes or {}
        self._keyframes = [
            replace(
                keyframe,
                to_reference=homographies[keyframe.index],
                plane=numbers.get(keyframe.index, keyframe.plane),
            )
            if keyframe.index in homographies
            else keyframe
            for keyframe in self._keyframes
        ]

    def _most_redundant(self) -> int:
        """Position of the older of the two nearest keyframes; the newest and the first always stay."""
        middles = np.array(
            [project(item.to_reference, centre(item.shape)[np.newaxis])[0] for item in self._keyframes]
        )
        distances = np.hypot(*(middles[:, np.newaxis] - middles[np.newaxis]).transpose(2, 0, 1))
        planes = np.array([item.plane for item in self._keyframes])
        distances[planes[:, np.newaxis] != planes] = _ANOTHER_PLANE
        distances[np.tril_indices(len(middles))] = np.inf
        distances[0] = np.inf
        return int(np.unravel_index(int(np.argmin(distances)), distances.shape)[0])


def is_leaving(keyframe: Keyframe, to_reference: FloatArray, least: float) -> bool:
    """Whether overlap, tilt or scale of a frame differ too much from its keyframe."""
    to_key = normalised(inverse(keyframe.to_reference) @ to_reference)
    tilted = tilt(to_key, keyframe.shape) > _MAX_TILT
    scale = scale_change(to_key, keyframe.shape)
    return overlap(to_key, keyframe.shape) < least or tilted or not _KEPT_SCALES[0] < scale < _KEPT_SCALES[1]
