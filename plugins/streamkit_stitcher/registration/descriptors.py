"""Registration without a guess: descriptors that are found again after any shift, turn or pause."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray
from streamkit_stitcher.registration.motion_models import MotionFit
from streamkit_stitcher.registration.wide_baseline import fit_wide_baseline

_FEATURES: Final = 2500
_CONTRAST: Final = 0.01
_RATIO: Final = 0.8
_LEAST_SHARE: Final = 0.25
# Enough for that share; more would only take longer to find that there is nothing.
_ITERATIONS: Final = 1000
# Wide enough for trees and roofs, which do not lie on the plane.
_THRESHOLD: Final = 4.0


@dataclass(frozen=True, eq=False)
class Description:
    """What a frame is recognised by.

    Attributes:
        points: float64[n, 2], px of the described image.
        descriptors: float32[n, 128].
    """

    points: FloatArray
    descriptors: npt.NDArray[np.float32]


def describe(grey: GreyArray) -> Description:
    """Finds the SIFT features of a frame, n of them, 0 for a flat one.

    Source: Lowe, Distinctive image features from scale-invariant keypoints, IJCV 2004; Arandjelovic and
    Zisserman, Three things everyone should know, CVPR 2012 (RootSIFT).
    """
    # OpenCV's plain enlargement puts every feature a quarter of a pixel too far right and down: between
    # frames of opposite headings, as of neighbouring strips, that is 0.7 px.
    detector = cv2.SIFT.create(nfeatures=_FEATURES, contrastThreshold=_CONTRAST, enable_precise_upscale=True)
    keypoints, found = detector.detectAndCompute(grey, None)
    if not keypoints or found is None:
        return Description(np.empty((0, 2)), np.empty((0, 128), dtype=np.float32))
    points = np.asarray(cv2.KeyPoint.convert(keypoints), dtype=np.float64).reshape(-1, 2)
    descriptors = np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-7))
    return Description(points, descriptors.astype(np.float32))


@dataclass(frozen=True, eq=False)
class Recognition:
    """A frame found in another by its descriptors.

    Attributes:
        fit: the homography from the source's points to the target's; all pairs below agree with it.
        source_points: float64[k, 2], px of the source.
        target_points: float64[k, 2], px of the target.
        target_indices: int64[k], which of the target's features they are.
    """

    fit: MotionFit
    source_points: FloatArray
    target_points: FloatArray
    target_indices: npt.NDArray[np.int64]


def matched(source: Description, target: Description) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Pairs of features that are each other's nearest and clearly nearer than the second nearest.

    Returns:
        int64[k] of the source and int64[k] of the target.
    """
    if len(source.points) < 2 or len(target.points) < 2:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    products = source.descriptors @ target.descriptors.T
    rows = np.arange(len(products))
    best = products.argmax(axis=1)
    nearest = products[rows, best]
    # Each other's nearest: the largest of its row is that of its column, too. Along columns the largest value
    # is found ten times faster than its place.
    back = nearest >= products.max(axis=0)[best]
    products[rows, best] = -1
    # The descriptors have unit length: the squared distance is 2 - 2 times their product.
    clear = 1 - nearest < _RATIO**2 * (1 - products.max(axis=1))
    kept = np.flatnonzero(back & clear)
    return kept, best[kept]


def recognise(source: Description, target: Description, min_inliers: int) -> Recognition | None:
    """Finds one frame in another, or None where they do not show the same ground.

    Args:
        source: of the frame to place.
        target: of the frame to place it on.
        min_inliers: fewest pairs that must agree.
    """
    own, other = matched(source, target)
    if len(own) < min_inliers:
        return None
    first, second = source.points[own], target.points[other]
    fit = fit_wide_baseline(first, second, _THRESHOLD, _ITERATIONS)
    if fit is None or fit.count < max(min_inliers, _LEAST_SHARE * len(own)):
        return None
    return Recognition(fit, first[fit.inliers], second[fit.inliers], other[fit.inliers])
