"""Frames without what hides the scene, for measuring motion."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import GreyArray

_CELL: Final = 8  # px
_REACH: Final = 3.0  # cells
_MIN_WEIGHT: Final = 1e-3


def without_hidden(grey: GreyArray, hidden: GreyArray) -> GreyArray:
    """The frame, uint8[h, w], with the mean of the surroundings where `hidden`, uint8[h, w], is 255.

    So even a surface has no corner and no gradient that stands still while the ground moves.

    Source: Knutsson and Westin, Normalized and differential convolution, CVPR 1993.
    """
    height, width = grey.shape
    cells = -(-width // _CELL), -(-height // _CELL)
    shown = cv2.bitwise_not(hidden)
    reduced = (
        cv2.resize(one, cells, interpolation=cv2.INTER_AREA) for one in (shown, cv2.bitwise_and(grey, shown))
    )
    weight, total = (cv2.GaussianBlur(one.astype(np.float32), (0, 0), _REACH) for one in reduced)
    least = _MIN_WEIGHT * 255
    mean = (total * 255 + least * float(total.mean())) / (weight + least)
    smooth = cv2.resize(np.clip(mean, 0, 255).astype(np.uint8), (width, height))
    return np.asarray(cv2.copyTo(smooth, hidden, grey.copy()), np.uint8)
