"""Fills in what hides the scene, such as a head-up display, so that motion is that of the scene."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from streamkit.geometry.homography import GreyArray

_CELL: Final = 8  # side of the squares that are averaged, px
_REACH: Final = 3.0  # standard deviation of the weights of the surroundings, cells
_MIN_WEIGHT: Final = 1e-3  # share of shown pixels below which the mean of the whole frame takes over


def without_hidden(grey: GreyArray, hidden: GreyArray) -> GreyArray:
    """Fills in the hidden pixels of a frame by the mean of what is shown around them.

    A display stands still while the ground moves. The filling is smooth: it has no corner to be tracked.

    Args:
        grey: uint8[h, w], the frame.
        hidden: uint8[h, w], 255 where the scene is hidden, else 0.

    Returns:
        A copy, uint8[h, w].

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
