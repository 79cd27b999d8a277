"""Registration without a prediction, by SIFT features."""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import FloatArray, GreyArray

_FEATURES: Final = 2500
_CONTRAST: Final = 0.01
_RATIO: Final = 0.8


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """The features of a frame.

    Attributes:
        points: float64[n, 2], px of the full-size frame.
        descriptors: float16[n, 128], of unit length.
        factor: the reduction of the image in which they were found.
    """

    points: FloatArray
    descriptors: npt.NDArray[np.float16]
    factor: int = 1


def describe(grey: GreyArray, factor: int = 1) -> FrameFeatures:
    """Detects the SIFT features of a frame, those of the highest contrast first; none on a flat image.

    Args:
        grey: uint8[h, w], the frame reduced by `factor` on both sides.
        factor: the reduction.

    Source: Lowe, Distinctive image features from scale-invariant keypoints, IJCV 2004; Arandjelovic and
    Zisserman, Three things everyone should know, CVPR 2012 (RootSIFT).
    """
    # OpenCV's default enlargement shifts every feature by a quarter of a pixel right and down: 0.7 px between
    # frames of opposite headings.
    detector = cv2.SIFT.create(nfeatures=_FEATURES, contrastThreshold=_CONTRAST, enable_precise_upscale=True)
    keypoints, found = detector.detectAndCompute(grey, None)
    if not keypoints or found is None:
        return FrameFeatures(np.empty((0, 2)), np.empty((0, 128), dtype=np.float16), factor)
    order = np.argsort([-keypoint.response for keypoint in keypoints], kind="stable")
    points = np.asarray(cv2.KeyPoint.convert(keypoints), dtype=np.float64).reshape(-1, 2)[order]
    points = points * factor + (factor - 1) / 2
    descriptors = np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-7))[order]
    return FrameFeatures(points, descriptors.astype(np.float16), factor)


def match_features(
    source: FrameFeatures, target: FrameFeatures
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Pairs of mutually nearest features that pass the ratio test.

    Returns:
        int64[k] of the source and int64[k] of the target.
    """
    if len(source.points) < 2 or len(target.points) < 2:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    products = source.descriptors.astype(np.float32) @ target.descriptors.astype(np.float32).T
    rows = np.arange(len(products))
    best = products.argmax(axis=1)
    nearest = products[rows, best]
    # Mutually nearest: the maximum of a row is that of its column, too. A maximum along columns is
    # ten times faster than an argmax.
    mutual = nearest >= products.max(axis=0)[best]
    products[rows, best] = -1
    # Of unit vectors the squared distance is 2 - 2 times their product.
    distinct = 1 - nearest < _RATIO**2 * (1 - products.max(axis=1))
    kept = np.flatnonzero(mutual & distinct)
    return kept, best[kept]
