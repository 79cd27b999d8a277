"""Camera motion measured from the frames, for frames without registration: a mast that shakes, a slow pan.

Each frame is registered to a keyframe and not to the previous frame, so that errors do not accumulate while
the view stays. That the camera stands still is the first hypothesis: a motion must explain the texture of the
keyframe clearly better, because corners of traffic agree on a motion, too. A camera that stands still gives
the same matrix for every frame: nothing is resampled.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import cv2
import numpy as np

from streamkit_differencer.arrays import ByteImage, Flags, FloatArray, FloatImage
from streamkit_differencer.image_motion import (
    ENOUGH_SHARE,
    FEWEST_POINTS,
    INLIER_PX,
    PATCH_PX,
    WINDOW_PX,
    PointArray,
    corner_distance,
    corners,
    is_spread,
    normalised,
    similarity_or_homography,
    textured_patches,
    transformed,
)

# Largest step between two frames, as a share of the width.
LARGEST_STEP = 0.3
# A keyframe is renewed when its inlier ratio falls below, or the view moves by more of its width.
RENEWAL_RATIO = 0.5
RENEWAL_SHIFT = 0.12
# The camera stands still if the residuals without motion are hardly larger than those of the fit.
STILL_PX = 0.12
STILL_RATIO = 1.25
# Resampling by less costs more than it mends, px.
SMALLEST_STEP_PX = 0.5
# Nothing is fitted where most points moved by less.
QUICK_STILL_PX = 0.2
# A larger step may be that of traffic: it must explain this many times the patches of the keyframe that no
# step does. A patch is explained where the frame correlates with it.
LARGE_STEP_PX = 2.0
LEAST_GAIN = 1.25
LEAST_CORRELATION = 0.8
LEAST_EXPLAINED = 0.2
RENEWAL_FRAMES = 12
# Smaller changes of brightness do not disturb optical flow.
SMALLEST_SHIFT, SMALLEST_GAIN = 6.0, 0.1
MOST_MISSED_FRAMES = 12
# An image without texture may be a lens that is covered for a moment.
MOST_PLAIN_FRAMES = 75
_FLOW: dict[str, Any] = {
    "winSize": (WINDOW_PX, WINDOW_PX),
    "maxLevel": 2,
    "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01),
    "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    "minEigThreshold": 1e-3,
}


@dataclass(slots=True)
class CameraMotion:
    """Registers each frame to a keyframe.

    Attributes:
        plane: number of the plane that frames are placed on; goes up after a cut.
    """

    plane: int = 0
    _keyframe: ByteImage | None = None
    _patches: PointArray = field(default_factory=lambda: np.zeros((0, PATCH_PX**2, 2), np.float32))
    _texture: FloatImage = field(default_factory=lambda: np.zeros((0, PATCH_PX**2), np.float32))
    _rests: bool = True
    _points: PointArray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    _keyframe_to_plane: FloatArray = field(default_factory=lambda: np.eye(3))
    _placed: FloatArray = field(default_factory=lambda: np.eye(3))
    _missed: int = 0
    _age: int = 0

    def reset(self) -> None:
        """Starts a new plane with the next frame."""
        self.plane += 1
        self._missed, self._rests = 0, True
        self._placed, self._keyframe = np.eye(3), None

    def place(self, image: ByteImage) -> FloatArray | None:
        """Registers a frame.

        Args:
            image: uint8[h, w], all of one size until `reset`.

        Returns:
            float64[3, 3], frame pixels to the plane of the first frame; the last matrix while the camera
            stands still or nothing tells of a motion. None if the image is plain, or if a camera that moved
            is lost; after some of those a new plane begins.
        """
        if self._keyframe is None or len(self._points) == 0:
            # Without texture the camera counts as still.
            self._set_keyframe(image, self._placed)
            return self._placed
        fit = self._fit(image)
        if fit is None:
            return self._miss(image)
        self._missed = 0
        placed, ratio = fit
        # Frames of a camera that shakes are never at the same place.
        self._rests = placed is self._placed or placed is self._keyframe_to_plane
        self._placed = placed
        away = corner_distance(self._placed, self._keyframe_to_plane, image.shape)
        self._age += 1
        is_worn = ratio < RENEWAL_RATIO and self._age >= RENEWAL_FRAMES
        if is_worn or away > RENEWAL_SHIFT * max(image.shape):
            self._set_keyframe(image, placed)
        return self._placed

    def _miss(self, image: ByteImage) -> FloatArray | None:
        self._missed += 1
        is_plain = not len(corners(image))
        if self._rests and not is_plain:
            # What covers the view is no motion; the keyframe may have been taken of it.
            if self._missed > RENEWAL_FRAMES:
                self._missed = 0
                self._set_keyframe(image, self._placed)
            return self._placed
        if self._missed <= (MOST_PLAIN_FRAMES if is_plain else MOST_MISSED_FRAMES):
            return None
        self.reset()
        return self.place(image)

    def _set_keyframe(self, image: ByteImage, placed: FloatArray) -> None:
        self._keyframe, self._points, self._keyframe_to_plane = image.copy(), corners(image), placed
        self._age = 0
        self._patches = textured_patches(image)
        self._texture = normalised(self._patches, image)

    def _fit(self, image: ByteImage) -> tuple[FloatArray, float] | None:
        """The frame's homography and its inlier ratio, at the brightness of the keyframe."""
        assert self._keyframe is not None
        fit = self._fit_once(image)
        if fit is not None and fit[1] >= RENEWAL_RATIO:
            return fit
        key_mean, key_deviation = (float(value[0, 0]) for value in cv2.meanStdDev(self._keyframe))
        mean, deviation = (float(value[0, 0]) for value in cv2.meanStdDev(image))
        gain = key_deviation / max(deviation, 1.0)
        if abs(mean - key_mean) < SMALLEST_SHIFT and abs(gain - 1.0) < SMALLEST_GAIN:
            return fit
        equal = np.clip(gain * (image.astype(np.float32) - mean) + key_mean, 0, 255)
        other = self._fit_once(equal.astype(np.uint8))
        if fit is None or other is None:
            return fit or other
        return max(fit, other, key=lambda either: either[1])

    def _fit_once(self, image: ByteImage) -> tuple[FloatArray, float] | None:
        assert self._keyframe is not None
        before = self._points
        to_image = np.linalg.inv(self._placed) @ self._keyframe_to_plane
        still = transformed(to_image, before)
        flow, status, _ = cv2.calcOpticalFlowPyrLK(self._keyframe, image, before, still.copy(), **_FLOW)
        after = cast("PointArray", flow)
        height, width = image.shape
        inside = (after >= 0).all(axis=1) & (after < (width, height)).all(axis=1)
        found = (status.ravel() > 0) & inside
        before, after, still = before[found], after[found], still[found]
        if len(before) < FEWEST_POINTS:
            return None
        from_keyframe, from_last = (np.linalg.norm(after - old, axis=1) for old in (before, still))
        references = (self._keyframe_to_plane, from_keyframe), (self._placed, from_last)
        for place, distance in references:
            near = distance <= QUICK_STILL_PX
            if 2 * np.count_nonzero(near) > len(near) and is_spread(before[near], image.shape):
                return place, float(np.count_nonzero(distance <= INLIER_PX)) / len(self._points)
        placed, inliers, explained = self._best_motion(image, before, after)
        ratio = float(np.count_nonzero(inliers)) / len(self._points)
        if placed is not None:
            steps = [corner_distance(placed, place, image.shape) for place, _ in references]
            to_image = np.linalg.inv(placed) @ self._keyframe_to_plane
            left = np.median(np.linalg.norm(transformed(to_image, before) - after, axis=1))
            for (place, distance), step in zip(references, steps, strict=True):
                is_still = step <= LARGE_STEP_PX and np.median(distance) <= STILL_PX + STILL_RATIO * left
                if is_still or (self._rests and step <= SMALLEST_STEP_PX):
                    return place, ratio
            if min(steps) <= LARGE_STEP_PX:
                return placed, ratio
        usual = [(self._explained(image, place), place) for place, _ in references]
        most, place = max(usual, key=lambda pair: pair[0])
        gain = 1.0 if ratio >= ENOUGH_SHARE else LEAST_GAIN
        least = LEAST_EXPLAINED * len(self._patches)
        if placed is not None and explained >= max(gain * most, least):
            return placed, ratio
        if placed is None and most < least:
            return None
        return place, 1.0 if most >= least else 0.0

    def _best_motion(
        self, image: ByteImage, before: PointArray, after: PointArray
    ) -> tuple[FloatArray | None, Flags, int]:
        """Of the motions that points agree on, the one that explains the most texture.

        The points of one motion are left out of the search for the next: traffic may have more of them than
        the ground.

        Returns:
            The frame's place, its inliers among the points, and the number of patches that it explains.
        """
        best: tuple[FloatArray | None, Flags, int] = None, np.zeros(len(before), np.bool_), 0
        left = np.arange(len(before))
        while len(left) >= FEWEST_POINTS:
            to_keyframe, near = similarity_or_homography(after[left], before[left])
            inliers = np.zeros(len(before), np.bool_)
            inliers[left[near]] = True
            if to_keyframe is None or not is_spread(before[inliers], image.shape):
                break
            placed = self._keyframe_to_plane @ to_keyframe
            placed = placed / placed[2, 2]
            if corner_distance(placed, self._placed, image.shape) < LARGEST_STEP * max(image.shape):
                explained = self._explained(image, placed)
                if explained > best[2]:
                    best = placed, inliers, explained
            if 2 * np.count_nonzero(near) > len(left):
                break
            left = left[~near]
        return best

    def _explained(self, image: ByteImage, placed: FloatArray) -> int:
        """Number of the keyframe's patches that an image repeats, if it lies there."""
        to_image = np.linalg.inv(placed) @ self._keyframe_to_plane
        patches = transformed(to_image, self._patches.reshape(-1, 2)).reshape(self._patches.shape)
        found = normalised(patches, image)
        return int(np.count_nonzero((found * self._texture).sum(axis=1) > LEAST_CORRELATION))
