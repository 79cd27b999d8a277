"""Virtual views: labelled windows slightly shifted, rotated, scaled or mirrored."""

from collections.abc import Iterator

import cv2
import numpy as np

from streamkit_wavelet_eigen.preprocessing import prepare
from streamkit_wavelet_eigen.recipe import Preprocessing, Recipe, Views
from streamkit_wavelet_eigen.wavelet import FloatBatch

# Values of all prepared windows and views together: 256 MB of float32.
MAX_VALUES = 64 * 1024 * 1024
# Share of the side, degrees and relative size: the placement error of a detector's window.
SHIFT = 1 / 32
ROTATION_DEGREES = 5.0
SCALING = 0.05
# Right, down, degrees, scale.
_VARIATIONS = (
    (SHIFT, 0.0, 0.0, 1.0),
    (-SHIFT, 0.0, 0.0, 1.0),
    (0.0, SHIFT, 0.0, 1.0),
    (0.0, -SHIFT, 0.0, 1.0),
    (0.0, 0.0, ROTATION_DEGREES, 1.0),
    (0.0, 0.0, -ROTATION_DEGREES, 1.0),
    (0.0, 0.0, 0.0, 1.0 + SCALING),
    (0.0, 0.0, 0.0, 1.0 - SCALING),
)


def view_count(views: Views) -> int:
    """Number of views of a window, itself included."""
    shifted = 1 + len(_VARIATIONS)
    return {Views.NONE: 1, Views.SHIFTED: shifted, Views.MIRRORED: 2 * shifted}[views]


def virtual_views(patches: FloatBatch, views: Views) -> Iterator[FloatBatch]:
    """The windows themselves, then each other view of all of them.

    Views are made one at a time: all of them together take 18 times the memory of the windows.

    Args:
        patches: float32[n, h, w].
        views: `none`; `shifted` by 1/32 of the side in four directions, rotated by 5 degrees and scaled by
            5 % either way; `mirrored` adds the mirror image of each.

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
    for right, down, degrees, scale in _VARIATIONS:
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), degrees, scale)
        matrix[:, 2] += (right * width, down * height)
        view = np.empty_like(patches)
        for patch, warped in zip(patches, view, strict=True):
            cv2.warpAffine(patch, matrix, (width, height), dst=warped, borderMode=cv2.BORDER_REPLICATE)
        yield view
        if views is Views.MIRRORED:
            yield view[:, :, ::-1]


def prepared_views(patches: FloatBatch, views: Views, how: Preprocessing) -> FloatBatch:
    """All views of windows float32[n, h, w], prepared, view by view: float32[n * view_count(views), ...]."""
    return np.concatenate(
        [prepare(np.ascontiguousarray(view), how) for view in virtual_views(patches, views)]
    )


def check_gallery_size(windows: int, recipe: Recipe) -> None:
    """Raises ValueError when so many windows and their views need more than 256 MB."""
    values = windows * view_count(recipe.views) * recipe.block_values * recipe.blocks**2
    if values > MAX_VALUES:
        raise ValueError(
            f"labelled windows, their views and pixels make {values} values, the maximum is {MAX_VALUES}; "
            "give fewer windows, views=none or a higher approximation"
        )
