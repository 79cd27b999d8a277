"""Camera motion measured from the frames, for frames without registration: a mast that shakes, a slow pan.

Each frame is registered to a keyframe and not to the previous frame, so that errors do not accumulate while
the view stays. A camera that stands still gives the same matrix for every frame: nothing is resampled.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from streamkit_differencer.arrays import ByteImage, Flags, FloatArray

PointArray = NDArray[np.float32]

MOST_POINTS = 160
GRID = (12, 8)
MARGIN_PX = 10
FEWEST_POINTS = 16
CORNER_THRESHOLD = 8
WINDOW_PX = 17
# Smaller eigenvalue of the gradients in a window, as OpenCV scales it, at which noise of 3 grey levels
# moves a point by a sixth of a pixel.
LEAST_TEXTURE = 1.7e-4
# Cells of a 4 by 4 grid that points must lie in: a single moving object is no camera motion.
SPREAD_CELLS = 6
INLIER_PX = 1.0
LOWEST_RATIO = 0.3
# A keyframe is renewed when its inlier ratio falls below, or the view moves by more of its width.
RENEWAL_RATIO = 0.5
RENEWAL_SHIFT = 0.12
# The camera stands still if the residuals without motion are hardly larger than those of the fit.
STILL_PX = 0.12
STILL_RATIO = 1.25
# Nothing is fitted where most points moved by less.
QUICK_STILL_PX = 0.2
# A larger step may be that of traffic: the camera stands still if this share of its inliers would.
LARGE_STEP_PX = 2.0
LARGE_STEP_SHARE = 0.4
STANDING_PX = 0.4
FEWEST_STANDING = 8
RENEWAL_FRAMES = 12
# No homography is fitted where this share of the points are inliers of a similarity.
ENOUGH_SHARE = 0.8
# Smaller changes of brightness do not disturb optical flow.
SMALLEST_SHIFT, SMALLEST_GAIN = 6.0, 0.1
MOST_MISSED_FRAMES = 5
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
    _points: PointArray = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    _keyframe_to_plane: FloatArray = field(default_factory=lambda: np.eye(3))
    _placed: FloatArray = field(default_factory=lambda: np.eye(3))
    _missed: int = 0
    _age: int = 0

    def reset(self) -> None:
        """Starts a new plane with the next frame."""
        self._begin(None)

    def place(self, image: ByteImage) -> FloatArray | None:
        """Registers a frame.

        Args:
            image: uint8[h, w], all of one size until `reset`.

        Returns:
            float64[3, 3], frame pixels to the plane of the first frame; the last matrix while the camera
            stands still or the image has too little texture. None if the frame shows another scene; after
            some of those a new plane begins.
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
        self._placed = placed
        away = corner_distance(self._placed, self._keyframe_to_plane, image.shape)
        self._age += 1
        is_worn = ratio < RENEWAL_RATIO and self._age >= RENEWAL_FRAMES
        if is_worn or away > RENEWAL_SHIFT * max(image.shape):
            self._set_keyframe(image, placed)
        return self._placed

    def _begin(self, image: ByteImage | None) -> None:
        self.plane += 1
        self._missed = 0
        self._placed = np.eye(3)
        self._keyframe = None
        if image is not None:
            self._set_keyframe(image, self._placed)

    def _miss(self, image: ByteImage) -> FloatArray | None:
        self._missed += 1
        is_plain = not len(corners(image))
        if self._missed <= (MOST_PLAIN_FRAMES if is_plain else MOST_MISSED_FRAMES):
            return None
        self._begin(image)
        return self._placed

    def _set_keyframe(self, image: ByteImage, placed: FloatArray) -> None:
        self._keyframe, self._points, self._keyframe_to_plane = image.copy(), corners(image), placed
        self._age = 0

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
        to_keyframe, inliers = similarity_or_homography(after, before)
        count, total = int(np.count_nonzero(inliers)), len(self._points)
        placed: FloatArray | None = None
        left = 0.0
        if (
            to_keyframe is not None
            and count >= LOWEST_RATIO * total
            and is_spread(before[inliers], image.shape)
        ):
            placed = self._keyframe_to_plane @ to_keyframe
            placed /= placed[2, 2]
            left = float(np.median(np.linalg.norm(transformed(to_keyframe, after) - before, axis=1)))
        for place, distance in references:
            if placed is not None and corner_distance(placed, place, image.shape) <= LARGE_STEP_PX:
                if np.median(distance) <= STILL_PX + STILL_RATIO * left:
                    return place, count / total
                continue
            standing = int(np.count_nonzero(distance <= STANDING_PX))
            if standing >= max(FEWEST_STANDING, LARGE_STEP_SHARE * count):
                return place, standing / total
        return None if placed is None else (placed, count / total)


def corners(image: ByteImage) -> PointArray:
    """Corners spread over the image, float32[n, 2]; none where it has too little texture."""
    # Smoothed: corners of noise do not repeat.
    smooth = cv2.GaussianBlur(image, (5, 5), 1.0)
    keypoints = cv2.FastFeatureDetector.create(CORNER_THRESHOLD).detect(smooth)
    if len(keypoints) < FEWEST_POINTS:
        return np.zeros((0, 2), np.float32)
    points = np.asarray(cv2.KeyPoint.convert(keypoints), np.float32)
    strengths = np.array([keypoint.response for keypoint in keypoints])
    height, width = image.shape
    texture = cv2.cornerMinEigenVal(smooth, WINDOW_PX)
    columns, rows = np.round(points).astype(np.intp).T
    inside = texture[rows, columns] > LEAST_TEXTURE
    inside &= ((points >= MARGIN_PX) & (points < (width - MARGIN_PX, height - MARGIN_PX))).all(axis=1)
    points, strengths = points[inside], strengths[inside]
    columns, rows = GRID
    cell = (points[:, 0] * columns // width + columns * (points[:, 1] * rows // height)).astype(np.intp)
    order = np.lexsort((-strengths, cell))
    members = np.bincount(cell, minlength=columns * rows)
    rank = np.arange(len(order)) - (np.cumsum(members) - members)[cell[order]]
    kept = order[rank < max(1, MOST_POINTS // max(1, int(np.count_nonzero(members))))]
    chosen = points[kept]
    return chosen if is_spread(chosen, image.shape) else np.zeros((0, 2), np.float32)


def is_spread(points: PointArray, shape: tuple[int, ...]) -> bool:
    """Whether there are enough points in enough parts of the image."""
    if len(points) < FEWEST_POINTS:
        return False
    cells = np.floor(points * 4 / (shape[1], shape[0])).astype(int)
    return len(np.unique(cells[:, 0] + 4 * cells[:, 1])) >= SPREAD_CELLS


def similarity_or_homography(source: PointArray, target: PointArray) -> tuple[FloatArray | None, Flags]:
    """The motion with the most inliers: a homography only where it has clearly more than a similarity.

    A similarity is robust to few or unevenly spread points; a camera that tilts needs eight parameters.

    Returns:
        float64[3, 3], source to target, or None; and bool[n], its inliers.
    """
    best: FloatArray | None = None
    inliers: Flags = np.zeros(len(source), bool)
    score = 0.0
    for is_similarity in (True, False):
        if is_similarity:
            candidate, _ = cv2.estimateAffinePartial2D(
                source, target, ransacReprojThreshold=INLIER_PX, maxIters=200
            )
        else:
            candidate, _ = cv2.findHomography(source, target, cv2.RANSAC, INLIER_PX, maxIters=200)
        if candidate is None or not np.isfinite(candidate).all():
            continue
        matrix = np.eye(3)
        matrix[: candidate.shape[0]] = candidate
        error = np.linalg.norm(transformed(matrix, source) - target, axis=1)
        # Half the threshold: residuals of the wrong model often stay below the whole of it.
        near = np.count_nonzero(error <= 0.5 * INLIER_PX)
        if near > score:
            best, inliers, score = matrix, error <= INLIER_PX, 1.1 * near
        if score > ENOUGH_SHARE * len(source):
            break
    return best, inliers


def transformed(matrix: FloatArray, points: PointArray) -> PointArray:
    """float32[n, 2] points under a homography."""
    return cast("PointArray", cv2.perspectiveTransform(points[None], matrix)[0])


def corner_distance(first: FloatArray, second: FloatArray, shape: tuple[int, ...]) -> float:
    """Largest distance, along an axis, of an image corner under two homographies, px."""
    height, width = shape[:2]
    outline = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    return float(np.abs(transformed(first, outline) - transformed(second, outline)).max())
