"""Virtual views: how a labelled window would look a little shifted, turned, scaled or mirrored."""

import cv2
import numpy as np

from streamkit_wavelet_eigen.recipe import Views
from streamkit_wavelet_eigen.wavelet import FloatBatch

# Shares of the side, degrees and factors: the misplacement that a detector's window has anyway.
SHIFT = 1 / 32
TURN_DEGREES = 5.0
SCALE = 0.05
_PLACES = (
    (0.0, 0.0, 0.0, 1.0),
    (SHIFT, 0.0, 0.0, 1.0),
    (-SHIFT, 0.0, 0.0, 1.0),
    (0.0, SHIFT, 0.0, 1.0),
    (0.0, -SHIFT, 0.0, 1.0),
    (0.0, 0.0, TURN_DEGREES, 1.0),
    (0.0, 0.0, -TURN_DEGREES, 1.0),
    (0.0, 0.0, 0.0, 1.0 + SCALE),
    (0.0, 0.0, 0.0, 1.0 - SCALE),
)


def view_count(views: Views) -> int:
    """How many views there are of one window, itself among them."""
    return {Views.NONE: 1, Views.SHIFTED: len(_PLACES), Views.MIRRORED: 2 * len(_PLACES)}[views]


def with_views(patches: FloatBatch, views: Views) -> FloatBatch:
    """The windows themselves, then each other view of all of them.

    Args:
        patches: float32[n, h, w].
        views: `none`; `shifted` by 1/32 of the side in four directions, turned by 5 degrees and scaled by
            5 % either way; `mirrored` those and all of them left to right.

    Returns:
        float32[n * view_count(views), h, w]: view by view, the windows in their order; uncovered pixels
        repeat the nearest.

    Source: Poggio and Vetter, Recognition and structure from one 2D model view, 1992 (virtual examples).
    """
    if views is Views.NONE or not len(patches):
        return patches
    height, width = patches.shape[1:]
    placed = [patches]
    for right, down, degrees, scale in _PLACES[1:]:
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, scale)
        matrix[:, 2] += (right * width, down * height)
        placed.append(
            np.stack(
                [
                    cv2.warpAffine(patch, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
                    for patch in patches
                ]
            )
        )
    shifted = np.concatenate(placed)
    return shifted if views is Views.SHIFTED else np.concatenate([shifted, shifted[:, :, ::-1]])
