"""Virtual views: how a labelled window would look a little shifted, turned, scaled or mirrored."""

from collections.abc import Iterator

import cv2
import numpy as np

from streamkit_wavelet_eigen.preprocessing import Preprocessing, prepare
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


def views_of(patches: FloatBatch, views: Views) -> Iterator[FloatBatch]:
    """The windows themselves, then each other view of all of them, one view at a time.

    A view is made when it is asked for: all of them together would be 18 times the windows.

    Args:
        patches: float32[n, h, w].
        views: `none`; `shifted` by 1/32 of the side in four directions, turned by 5 degrees and scaled by
            5 % either way; `mirrored` those and all of them left to right.

    Yields:
        float32[n, h, w], the windows in their order; uncovered pixels repeat the nearest.

    Source: Poggio and Vetter, Recognition and structure from one 2D model view, 1992 (virtual examples).
    """
    yield patches
    if views is Views.MIRRORED:
        yield patches[:, :, ::-1]
    if views is Views.NONE:
        return
    height, width = patches.shape[1:]
    for right, down, degrees, scale in _PLACES[1:]:
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, scale)
        matrix[:, 2] += (right * width, down * height)
        view = np.empty_like(patches)
        for patch, moved in zip(patches, view, strict=True):
            cv2.warpAffine(patch, matrix, (width, height), dst=moved, borderMode=cv2.BORDER_REPLICATE)
        yield view
        if views is Views.MIRRORED:
            yield view[:, :, ::-1]


def prepared_views(patches: FloatBatch, views: Views, how: Preprocessing) -> FloatBatch:
    """All views of windows float32[n, h, w], prepared, view by view: n * view_count(views) of them."""
    return np.concatenate([prepare(np.ascontiguousarray(view), how) for view in views_of(patches, views)])
