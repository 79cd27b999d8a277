"""Registration of a frame to the previous one, at working size."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    corner_shift,
    inverse,
    is_plausible,
    project,
    resized,
)
from streamkit_stitcher.registration.corners import even_corners
from streamkit_stitcher.registration.correlation import overlap_correlation, search_shift
from streamkit_stitcher.registration.motion_models import (
    NO_FIT,
    FitLimits,
    MotionFit,
    MotionModel,
    fit_motion,
)

_WINDOW: Final = (13, 13)
_TOP_LEVEL: Final = 2
_CRITERIA: Final = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.02)
_THUMBNAIL: Final = (80, 45)
_BLANK_DEVIATION: Final = 2.0
_BLANK_POINTS: Final = 8
_MIN_CORRELATION: Final = 0.1
_MIN_HEIGHT: Final = 64
_CUT_RATIO: Final = 0.3
# Correlation of thumbnails that show the same scene.
_ALIKE: Final = 0.5
_MIN_SHARE: Final = 0.05


@dataclass(frozen=True, eq=False)
class WorkingImage:
    """A frame at working size.

    Attributes:
        grey: uint8[h, w], reduced by `factor` on both sides.
        factor: the reduction, a power of two.
        max_points: about so many corners are found.
    """

    grey: GreyArray
    factor: int
    max_points: int

    @cached_property
    def points(self) -> FloatArray:
        """float64[n, 2], corners in reduced px."""
        height, width = self.grey.shape
        columns = max(1, round(math.sqrt(self.max_points * width / height)))
        return even_corners(self.grey, columns, max(1, self.max_points // columns))

    @cached_property
    def thumbnail(self) -> FloatArray:
        """float64[45, 80], for cut detection."""
        return cv2.resize(self.grey, _THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.float64)

    @property
    def is_blank(self) -> bool:
        """Whether the frame is black, flat, almost without corners, or noise."""
        return (
            len(self.points) < _BLANK_POINTS
            or float(self.thumbnail.std()) < _BLANK_DEVIATION
            or is_noise(self.thumbnail)
        )


@dataclass(frozen=True, eq=False)
class PairwiseMotion:
    """The motion of a frame relative to an earlier one.

    Attributes:
        matrix: float64[3, 3], full-size pixels of the frame to those of the earlier one; identity if unknown.
        model: the accepted motion model, or None.
        is_cut: whether the two frames show different scenes.
        matches: points tracked from the earlier frame.
        inliers: matches that agree with the motion.
        rmse: root mean square residual of the inliers, full-size px.
    """

    matrix: FloatArray
    model: MotionModel | None
    is_cut: bool
    matches: int
    inliers: int
    rmse: float

    def corner_std(self, shape: tuple[int, int]) -> float:
        """Predicted error at the worst corner, px: the corners that agree may be a mover's."""
        agreeing = self.inliers / max(1, self.matches)
        shift = corner_shift(self.matrix, shape)
        return self.rmse / max(agreeing, _MIN_SHARE) + (1 - agreeing) * shift


def working_level(shape: tuple[int, int], working_width: int) -> int:
    """How often to halve a frame: until it is `working_width` wide, but no lower than 64 px."""
    height, width = shape
    level = 0
    while width >> level > working_width and height >> (level + 1) >= _MIN_HEIGHT:
        level += 1
    return level


def is_noise(thumbnail: FloatArray) -> bool:
    """Whether neighbouring pixels of a thumbnail, float64[h, w], are uncorrelated.

    Each is the mean of many pixels: terrain of any texture stays correlated, noise does not.
    """
    apart = thumbnail - thumbnail.mean()
    power = float((apart**2).mean())
    across = float((apart[:, 1:] * apart[:, :-1]).mean())
    down = float((apart[1:] * apart[:-1]).mean())
    return max(across, down) < _MIN_CORRELATION * power


def register(
    earlier: WorkingImage, current: WorkingImage, guess: FloatArray, limits: FitLimits
) -> PairwiseMotion:
    """Registers `current` to `earlier`: homography, else similarity, translation, nothing.

    A doubtful result is tried again with the exposure of `earlier` matched to `current`, for gain steps, and
    the motion started from cross-correlation, for shifts of more than a quarter of the width, as between
    survey photographs; a shift beyond `limits.max_step` counts where a homography confirms it. `guess`
    predicts the motion of full-size pixels, `current` to `earlier`; the threshold of `limits` is in px of the
    reduced images.

    Source: Lucas and Kanade 1981, Bouguet's pyramidal form.
    """
    start, shape = inverse(resized(guess, 1 / current.factor)), current.grey.shape[:2]
    first, best = _track_and_fit(earlier.grey, current.grey, earlier.points, start, limits)
    if first is not None and first.model is MotionModel.HOMOGRAPHY:
        return _motion(first, current.factor)
    shift = search_shift(earlier.grey, current.grey)
    back = IDENTITY if shift is None else shift
    exposed = _with_exposure_of(earlier.grey, current.grey, back)
    anywhere = replace(limits, max_step=1.0)
    second, second_best = _track_and_fit(exposed, current.grey, earlier.points, inverse(back), anywhere)
    if second is not None and second.model is not MotionModel.HOMOGRAPHY:
        second = second if is_plausible(second.matrix, shape, limits.max_step) else None
    fits = [fit for fit in (first, second) if fit is not None]
    if fits:
        return _motion(max(fits, key=lambda fit: fit.count), current.factor)
    best = max(best, second_best, key=lambda found: found.count)
    found, step = (resized(matrix, current.factor) for matrix in (best.matrix, back))
    likeness = thumbnail_correlation(earlier, current, step)
    if shift is not None and likeness >= _ALIKE and is_plausible(back, shape, limits.max_step):
        return PairwiseMotion(step, MotionModel.TRANSLATION, False, len(best.inliers), best.count, 0.0)
    is_other = max(likeness, thumbnail_correlation(earlier, current, found)) < _ALIKE
    is_cut = is_other and best.count < _CUT_RATIO * max(1, len(earlier.points))
    return PairwiseMotion(IDENTITY, None, is_cut, len(best.inliers), best.count, 0.0)


def thumbnail_correlation(earlier: WorkingImage, current: WorkingImage, matrix: FloatArray) -> float:
    """Correlation of two thumbnails over their overlap, -1 to 1, see `overlap_correlation`.

    `matrix` maps full-size pixels of `current` to those of `earlier`.
    """
    width, height = _THUMBNAIL
    rows, columns = current.grey.shape
    shrink = np.diag([width / (columns * current.factor), height / (rows * current.factor), 1.0])
    to_earlier = shrink @ matrix @ np.linalg.inv(shrink)
    return overlap_correlation(current.thumbnail, earlier.thumbnail, to_earlier)


def _motion(fit: MotionFit, factor: int) -> PairwiseMotion:
    matrix = resized(fit.matrix, factor)
    return PairwiseMotion(matrix, fit.model, False, len(fit.inliers), fit.count, fit.rmse * factor)


def _track_and_fit(
    earlier: GreyArray, current: GreyArray, points: FloatArray, start: FloatArray, limits: FitLimits
) -> tuple[MotionFit | None, MotionFit]:
    """The accepted motion and the best fit of points tracked from where `start` (earlier to current) leads.

    Pyramidal Lucas-Kanade.
    """
    height, width = current.shape
    expected = project(start, points)
    inside = ((expected >= 0) & (expected < (width, height))).all(axis=1)
    if not inside.any():
        return None, NO_FIT
    old = np.ascontiguousarray(points[inside], dtype=np.float32).reshape(-1, 1, 2)
    new, found, _ = cv2.calcOpticalFlowPyrLK(
        earlier,
        current,
        old,
        np.ascontiguousarray(expected[inside], dtype=np.float32).reshape(-1, 1, 2),
        winSize=_WINDOW,
        maxLevel=_TOP_LEVEL,
        criteria=_CRITERIA,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    kept = found.reshape(-1) == 1
    pair = new[kept, 0].astype(np.float64), old[kept, 0].astype(np.float64)
    return fit_motion(*pair, (height, width), limits)


def _with_exposure_of(image: GreyArray, model: GreyArray, shift: FloatArray) -> GreyArray:
    """`image` with the mean and deviation that `model` has where both show the same under a shift."""
    x, y = np.rint(shift[:2, 2]).astype(int).tolist()
    height, width = image.shape
    own = image[max(0, y) : height + min(0, y), max(0, x) : width + min(0, x)]
    other = model[max(0, -y) : height - max(0, y), max(0, -x) : width - max(0, x)]
    mean, deviation = cv2.meanStdDev(own)
    target_mean, target_deviation = cv2.meanStdDev(other)
    gain = float(target_deviation[0, 0]) / max(float(deviation[0, 0]), 1e-6)
    offset = float(target_mean[0, 0]) - gain * float(mean[0, 0])
    return np.asarray(np.clip(image * gain + offset, 0, 255), dtype=np.uint8)
